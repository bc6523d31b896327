/* libFuzzer: any bytes as a serial stream, as packets, and as CAN frames to an object. What must hold whatever came:
 * every byte and frame is accounted for, what was decoded encodes to itself, and what was framed is received. */
#include <stdlib.h>
#include <string.h>

#include "rotdrift_can.h"
#include "rotdrift_protocol.h"
#include "rotdrift_sequence.h"

static void demand(bool holds)
{
    if (!holds)
        abort();
}

static void check_packet(const rd_packet *packet, const uint8_t *bytes, size_t n)
{
    uint8_t encoded[RD_MAX_PACKET_BYTES], frame[RD_MAX_FRAME_BYTES];
    const size_t size = rd_encode(encoded, packet);
    demand(size > 0 && size == rd_packet_bytes(packet->type) && size <= n && !memcmp(encoded, bytes, size));
    rd_receiver receiver;
    rd_packet received;
    memset(&receiver, 0, sizeof receiver);
    const size_t length = rd_frame(frame, encoded, size);
    demand(length == size + RD_FRAME_OVERHEAD && !memchr(frame + 1, 0, length - 2));
    rd_result result = RD_NOTHING;
    for (size_t k = 0; k < length; k++) {
        demand(result == RD_NOTHING);
        result = rd_receive(&receiver, frame[k], &received);
    }
    demand(result == RD_PACKET && receiver.length == size && !memcmp(receiver.packet, encoded, size));
}

static void check_stream(const uint8_t *data, size_t n)
{
    rd_receiver receiver;
    rd_sequence sequence;
    rd_packet packet;
    uint32_t samples = 0;
    memset(&receiver, 0, sizeof receiver);
    memset(&sequence, 0, sizeof sequence);
    const rd_counters *c = &receiver.counters;
    for (size_t k = 0; k < n; k++) {
        const rd_result result = rd_receive(&receiver, data[k], &packet);
        if (result == RD_PACKET) {
            check_packet(&packet, receiver.packet, receiver.length);
            if (packet.type == RD_ORIENTATION) {
                rd_sequence_feed(&sequence, packet.as.orientation.sequence);
                samples++;
            }
        }
        demand(c->bytes == c->delimiters + c->frame_bytes + c->skipped_bytes + receiver.filled);
        demand(c->frames == c->packets + c->malformed + c->unknown_types + c->unsupported_versions);
        demand(receiver.filled <= RD_MAX_PIECE_BYTES);
    }
    demand(c->bytes == n && c->extended <= c->packets);
    demand(sequence.duplicates + sequence.reordered + sequence.sequence_restarts <= samples);
}

static bool take_frame(void *context, uint16_t id, const uint8_t *bytes, uint8_t length)
{
    unsigned *room = context;
    uint32_t sum = id;
    for (uint8_t k = 0; k < length; k++) /* read all of it: the sanitizer watches */
        sum += bytes[k];
    demand(length > 0 && length <= ((id & RD_CAN_WHOLE_PACKET) ? RD_CAN_MAX_BYTES : 8) && sum < 1u << 20);
    return *room && (*room)--;
}

static void check_can(const uint8_t *data, size_t n)
{
    unsigned room = 3000;
    rd_can can;
    memset(&can, 0, sizeof can);
    can.node = 5;
    can.fd = n % 2;
    can.boot_tag = 1;
    can.send = take_frame;
    can.context = &room;
    static const uint8_t INFO[RD_INFO_BYTES] = {RD_INFO};
    uint32_t clock_us = 0;
    for (size_t at = 0; at + 4 <= n; clock_us += 1000u * data[at + 3], at += 4 + (data[at + 2] & 0x1F)) {
        const size_t rest = n - at - 4, wanted = data[at + 2] & 0x1F;
        const uint8_t length = (uint8_t)(wanted < rest ? wanted : rest);
        uint8_t frame[32]; /* a copy of exactly its length, for the sanitizer */
        uint8_t *exact = malloc(length ? length : 1);
        const uint8_t *packet = NULL;
        memcpy(frame, data + at + 4, length);
        memcpy(exact, frame, length);
        rd_can_packet(&can, INFO, sizeof INFO, clock_us);
        const uint16_t id = (uint16_t)((data[at] << 8 | data[at + 1]) & 0x7FF);
        const size_t size = rd_can_receive(&can, id, exact, length, &packet, clock_us);
        demand(size == 0 || (packet >= exact && packet + size <= exact + length));
        rd_can_poll(&can, clock_us);
        float q[4] = {0};
        memcpy(q, frame, length < sizeof q ? length : sizeof q);
        rd_can_sample(&can, clock_us / 3000, clock_us, 333, q, data[at]);
        if (length)
            rd_can_packet(&can, exact, length, clock_us);
        free(exact);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n)
{
    rd_packet packet;
    check_stream(data, n);
    check_can(data, n);
    if (n <= RD_MAX_PACKET_BYTES && rd_decode(&packet, data, n) == RD_PACKET)
        check_packet(&packet, data, n);
    /* The same as the contents of a frame, so that the fuzzer need not find a checksum to reach the packets. */
    uint8_t frame[RD_MAX_FRAME_BYTES];
    const size_t length = rd_frame(frame, data, n);
    if (length)
        check_stream(frame, length);
    return 0;
}
