/* A decoder of the serial stream, hand-written in C: the practical limit that the Python one is measured against, and
 * a second opinion in the conformance tests. It knows the wire from docs/protocol.md and shares nothing with the
 * package. COBS in place, CRC-16/CCITT-FALSE eight bytes at a time (slicing), int16 quaternions to unit doubles.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { ORIENTATION = 2, SAMPLE_BYTES = 16, CRC_BYTES = 2, MAX_PIECE = 255 };

/* (0.99 * 32767)^2 rounded up and (1.01 * 32767)^2 rounded down */
#define MIN_SQUARE 1052310131.0
#define MAX_SQUARE 1095257182.0

typedef struct {
    uint64_t delimiters, frames, frame_bytes, skipped_bytes, pending_bytes;
    uint64_t cobs_errors, crc_errors, oversize, partial_starts, malformed, samples;
    uint64_t others[256]; /* frames with the right checksum that are no ORIENTATION, by type byte */
} counters_t;

static uint16_t table[8][256];

void rd_init(void)
{
    for (int byte = 0; byte < 256; byte++) {
        uint16_t crc = (uint16_t)(byte << 8);
        for (int bit = 0; bit < 8; bit++) crc = (uint16_t)((crc & 0x8000) ? (crc << 1) ^ 0x1021 : crc << 1);
        table[0][byte] = crc;
    }
    for (int byte = 0; byte < 256; byte++)
        for (int k = 1; k < 8; k++)
            table[k][byte] = (uint16_t)(table[k - 1][byte] << 8) ^ table[0][table[k - 1][byte] >> 8];
}

uint16_t rd_crc(const uint8_t *data, size_t n)
{
    uint16_t crc = 0xFFFF;
    while (n >= 8) {
        crc = table[7][(crc >> 8) ^ data[0]] ^ table[6][(crc & 0xFF) ^ data[1]] ^ table[5][data[2]] ^ table[4][data[3]]
            ^ table[3][data[4]] ^ table[2][data[5]] ^ table[1][data[6]] ^ table[0][data[7]];
        data += 8;
        n -= 8;
    }
    while (n--) crc = (uint16_t)(crc << 8) ^ table[0][(crc >> 8) ^ *data++];
    return crc;
}

/* Undo COBS in place; the content then begins at piece[1]. Every code of so short a piece but the first stands for a
 * zero. Returns 0 where a code points past the end. */
static int uncobs(uint8_t *piece, size_t n)
{
    size_t at = 0;
    while (at < n) {
        size_t code = piece[at];
        piece[at] = 0;
        at += code;
    }
    return at == n;
}

/* Decode n bytes from the start of a link. Arrays must have room for n / 20 + 1 samples. Returns the samples. */
size_t rd_decode(const uint8_t *bytes, size_t n, uint16_t *sequence, uint32_t *device_time_us, double *quats_wxyz,
                 uint8_t *flags, counters_t *c)
{
    const uint8_t *at = bytes, *end = bytes + n;
    size_t samples = 0;
    uint8_t piece[MAX_PIECE + 1];

    memset(c, 0, sizeof *c);
    for (;;) {
        const uint8_t *stop = memchr(at, 0, (size_t)(end - at));
        const int at_start = at == bytes;
        if (stop == NULL) break;
        const size_t size = (size_t)(stop - at);
        c->delimiters++;
        if (size == 0) {
            at = stop + 1;
            continue;
        }
        if (size > MAX_PIECE) {
            *(at_start ? &c->partial_starts : &c->oversize) += 1;
            c->skipped_bytes += size;
            at = stop + 1;
            continue;
        }
        memcpy(piece, at, size);
        at = stop + 1;
        if (!uncobs(piece, size)) {
            *(at_start ? &c->partial_starts : &c->cobs_errors) += 1;
            c->skipped_bytes += size;
            continue;
        }
        const uint8_t *packet = piece + 1;
        const size_t length = size - 1 - CRC_BYTES;
        if (size < 1 + CRC_BYTES || rd_crc(packet, length) != (packet[length] | packet[length + 1] << 8)) {
            *(at_start ? &c->partial_starts : &c->crc_errors) += 1;
            c->skipped_bytes += size;
            continue;
        }
        c->frames++;
        c->frame_bytes += size;
        if (length == 0) {
            c->malformed++;
            continue;
        }
        if (packet[0] != ORIENTATION) {
            c->others[packet[0]]++;
            continue;
        }
        if (length < SAMPLE_BYTES) {
            c->malformed++;
            continue;
        }
        int16_t q[4];
        memcpy(q, packet + 7, 8);
        const double w = q[0], x = q[1], y = q[2], z = q[3];
        const double square = w * w + x * x + y * y + z * z;
        if (square < MIN_SQUARE || square > MAX_SQUARE) {
            c->malformed++;
            continue;
        }
        const double scale = 1.0 / sqrt(square);
        memcpy(&sequence[samples], packet + 1, 2);
        memcpy(&device_time_us[samples], packet + 3, 4);
        quats_wxyz[4 * samples] = w * scale;
        quats_wxyz[4 * samples + 1] = x * scale;
        quats_wxyz[4 * samples + 2] = y * scale;
        quats_wxyz[4 * samples + 3] = z * scale;
        flags[samples] = packet[15];
        samples++;
    }
    const size_t rest = (size_t)(end - at);
    if (rest > MAX_PIECE) {
        *(at == bytes ? &c->partial_starts : &c->oversize) += 1;
        c->skipped_bytes += rest;
    } else {
        c->pending_bytes = rest;
    }
    c->samples = samples;
    return samples;
}
