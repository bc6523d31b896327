#include "rotdrift_protocol.h"

/* Declared, not included: bare cross compilers have no string.h. */
extern void *memcpy(void *to, const void *from, size_t n);

/* ------------------------------------------------------------------------------------------------------- packets
 * The layouts come from the schema by the RD_LAYOUT macros; the structs are those of the header. One table, one byte a
 * number, serves both directions: for every packet its type, size and number of fields, then the fields. */

enum { KIND_U8 = 1, KIND_U16 = 2, KIND_I16 = 2, KIND_U8_U16 = 3, KIND_U32 = 4, KIND_F32 = 4, KIND_U64 = 8 };

typedef struct {
    uint8_t type_or_offset, bytes_or_kind, count;
} layout_row; /* a kind is the size on the wire; only a weight has 3 bytes */

#define COUNT(S, name, kind, n) +1 /* NOLINT(bugprone-macro-parentheses): one term of a sum */
#define FIELD(S, name, kind, n) {(uint8_t)offsetof(S, name), KIND_##kind, n},
#define LAYOUT(NAME, S) {RD_##NAME, RD_##NAME##_BYTES, 0 RD_LAYOUT_##NAME(COUNT, S)}, RD_LAYOUT_##NAME(FIELD, S)

static const layout_row LAYOUTS[] = {
    LAYOUT(ORIENTATION, rd_orientation)
    LAYOUT(STATUS, rd_status)
    LAYOUT(RAW_IMU, rd_raw_imu)
    LAYOUT(ACK, rd_ack)
    LAYOUT(TIME_REPLY, rd_time_reply)
    LAYOUT(EVENT, rd_event)
    LAYOUT(GET_INFO, rd_command)
    LAYOUT(START, rd_start)
    LAYOUT(STOP, rd_command)
    LAYOUT(SET_RATE, rd_set_rate)
    LAYOUT(IDENTIFY, rd_identify)
    LAYOUT(CALIBRATE, rd_command)
    LAYOUT(TIME_REQUEST, rd_command)
    LAYOUT(MARK, rd_mark)
    LAYOUT(INFO, rd_info)
};

/* Offsets fit a byte, and every member is as wide as in the schema: else these arrays have a negative size. */
#define SIZE(kind) ((kind) == KIND_U8_U16 ? sizeof(rd_weight) : (size_t)(kind))
#define SAME_SIZE(S, name, kind, n) \
    typedef char S##_##name##_has_the_size_of_the_schema[sizeof(((S *)0)->name) == (n) * SIZE(KIND_##kind) ? 1 : -1];
typedef char offsets_fit_a_byte[sizeof(rd_info) <= 256 ? 1 : -1];
RD_LAYOUT_INFO(SAME_SIZE, rd_info)
RD_LAYOUT_ORIENTATION(SAME_SIZE, rd_orientation)
RD_LAYOUT_STATUS(SAME_SIZE, rd_status)
RD_LAYOUT_RAW_IMU(SAME_SIZE, rd_raw_imu)
RD_LAYOUT_ACK(SAME_SIZE, rd_ack)
RD_LAYOUT_TIME_REPLY(SAME_SIZE, rd_time_reply)
RD_LAYOUT_EVENT(SAME_SIZE, rd_event)
RD_LAYOUT_GET_INFO(SAME_SIZE, rd_command)
RD_LAYOUT_START(SAME_SIZE, rd_start)
RD_LAYOUT_SET_RATE(SAME_SIZE, rd_set_rate)
RD_LAYOUT_IDENTIFY(SAME_SIZE, rd_identify)
RD_LAYOUT_MARK(SAME_SIZE, rd_mark)

static const layout_row *layout_of(uint8_t type)
{
    const layout_row *row = LAYOUTS;
    while (row < LAYOUTS + sizeof LAYOUTS / sizeof *LAYOUTS) {
        if (row->type_or_offset == type)
            return row;
        row += 1 + row->count;
    }
    return NULL;
}

size_t rd_packet_bytes(uint8_t type)
{
    const layout_row *row = layout_of(type);
    return row ? row->bytes_or_kind : 0;
}

/* One number to the wire, little endian by shifts; returns where the next one goes. The copies make it independent of
 * the member's signedness, alignment, and of it being a float. */
static uint8_t *put(uint8_t *at, const void *member, unsigned size)
{
    uint16_t half;
    uint32_t word;
    uint64_t number;
    if (size == 1) {
        *at = *(const uint8_t *)member;
        return at + 1;
    }
    if (size == 2) {
        memcpy(&half, member, sizeof half);
        number = half;
    } else if (size == 4) {
        memcpy(&word, member, sizeof word);
        number = word;
    } else {
        memcpy(&number, member, sizeof number);
    }
    for (; size; size--, number >>= 8)
        *at++ = (uint8_t)number;
    return at;
}

/* The opposite of put. */
static const uint8_t *get(const uint8_t *at, void *member, unsigned size)
{
    uint64_t number = 0;
    for (unsigned k = size; k--;)
        number = number << 8 | at[k];
    const uint16_t half = (uint16_t)number;
    const uint32_t word = (uint32_t)number;
    if (size == 1)
        *(uint8_t *)member = (uint8_t)number;
    else if (size == 2)
        memcpy(member, &half, sizeof half);
    else if (size == 4)
        memcpy(member, &word, sizeof word);
    else
        memcpy(member, &number, sizeof number);
    return at + size;
}

/* A float of INFO: NaN for unknown, else finite, and where asked not below 0. Judged on the bits: no arithmetic. */
static bool is_known_or_nan(float value, bool may_be_negative)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const uint32_t magnitude = bits & 0x7FFFFFFFu;
    if (magnitude >= 0x7F800000u)
        return magnitude > 0x7F800000u;
    return may_be_negative || bits == magnitude || magnitude == 0;
}

static bool are_in_range(const rd_info *info)
{
    /* In double the squares are exact, so that this agrees with the host on every float. */
    double square = 0;
    bool good = info->rate_hz >= RD_MIN_RATE_HZ && info->rate_hz <= RD_MAX_RATE_HZ;
    good = good && (info->shape <= RD_SHAPE_SPHERE || info->shape == RD_SHAPE_OTHER);
    good = good && info->weight_count <= RD_MAX_WEIGHTS && is_known_or_nan(info->mass_g, false);
    for (int k = 0; k < 3; k++)
        good = good && is_known_or_nan(info->size_mm[k], false) && is_known_or_nan(info->com_mm[k], true);
    for (int k = 0; k < 4; k++)
        square += (double)info->mounting_q_body_sensor[k] * (double)info->mounting_q_body_sensor[k];
    return good && square >= 0.9801 && square <= 1.0201; /* NaN is neither */
}

/* Whether every value is inside its table and range: judged before sending as well as on receiving. */
static bool is_valid(const rd_packet *packet)
{
    const int16_t *q = packet->as.orientation.q_wxyz;
    uint32_t square = 0; /* of four times -32768 it wraps to 0, which is out of range too */
    switch (packet->type) {
    case RD_ORIENTATION:
        for (int k = 0; k < 4; k++)
            square += (uint32_t)((int32_t)q[k] * q[k]);
        return square >= RD_Q15_MIN_SQUARE && square <= RD_Q15_MAX_SQUARE;
    case RD_INFO:
        return are_in_range(&packet->as.info);
    case RD_STATUS:
        return packet->as.status.state <= RD_STATE_FAULT;
    case RD_ACK:
        return packet->as.ack.code <= RD_ACK_HARDWARE_FAULT;
    case RD_EVENT:
        return packet->as.event.kind <= RD_EVENT_MARKER;
    case RD_START:
        return packet->as.start.with_raw_imu <= 1;
    default:
        return true;
    }
}

size_t rd_encode(uint8_t *bytes, const rd_packet *packet)
{
    const layout_row *row = layout_of(packet->type);
    if (!row || !is_valid(packet))
        return 0;
    uint8_t *at = bytes;
    *at++ = packet->type;
    for (unsigned n = row->count; n--;) {
        const uint8_t *member = (const uint8_t *)&packet->as + (++row)->type_or_offset;
        const unsigned size = row->bytes_or_kind;
        if (size == KIND_U8_U16) {
            const rd_weight *weight = packet->as.info.weights;
            for (unsigned k = row->count; k--; weight++)
                at = put(put(at, &weight->slot, 1), &weight->mass_cg, 2);
        } else {
            for (unsigned k = row->count; k--; member += size)
                at = put(at, member, size);
        }
    }
    return (size_t)(at - bytes);
}

rd_result rd_decode(rd_packet *packet, const uint8_t *bytes, size_t n)
{
    if (n == 0)
        return RD_MALFORMED;
    const layout_row *row = layout_of(*bytes);
    packet->type = *bytes;
    if (!row)
        return RD_UNKNOWN_TYPE;
    if (*bytes == RD_INFO && n > RD_INFO_PROTOCOL_MINOR_AT && bytes[RD_INFO_PROTOCOL_MAJOR_AT] != RD_PROTOCOL_MAJOR) {
        packet->as.info.protocol_major = bytes[RD_INFO_PROTOCOL_MAJOR_AT];
        packet->as.info.protocol_minor = bytes[RD_INFO_PROTOCOL_MINOR_AT];
        return RD_UNSUPPORTED_VERSION;
    }
    if (n < row->bytes_or_kind)
        return RD_MALFORMED;
    const uint8_t *at = bytes + 1;
    for (unsigned fields = row->count; fields--;) {
        uint8_t *member = (uint8_t *)&packet->as + (++row)->type_or_offset;
        const unsigned size = row->bytes_or_kind;
        if (size == KIND_U8_U16) {
            rd_weight *weight = packet->as.info.weights;
            for (unsigned k = row->count; k--; weight++)
                at = get(get(at, &weight->slot, 1), &weight->mass_cg, 2);
        } else {
            for (unsigned k = row->count; k--; member += size)
                at = get(at, member, size);
        }
    }
    return is_valid(packet) ? RD_PACKET : RD_MALFORMED;
}

/* -------------------------------------------------------------------------------------------------------- values */

float rd_inverse_root(float square)
{
    /* Newton's method from 1: it comes from below and squares the error each time, 0.5 at worst at the ends. */
    float root = 1.5f - 0.5f * square;
    for (int k = 0; k < 5; k++)
        root *= 1.5f - 0.5f * square * root * root;
    return root;
}

bool rd_normalise(float unit[4], const float q[4])
{
    const float lowest = 1.0f - RD_NORM_TOLERANCE, highest = 1.0f + RD_NORM_TOLERANCE;
    float square = 0.0f;
    for (int k = 0; k < 4; k++)
        square += q[k] * q[k];
    if (!(square >= lowest * lowest && square <= highest * highest)) /* NaN is neither */
        return false;
    const float scale = rd_inverse_root(square);
    for (int k = 0; k < 4; k++)
        unit[k] = q[k] * scale;
    return true;
}

int16_t rd_counts(float counts, int16_t lowest)
{
    if (counts >= 32767.0f)
        return 32767;
    if (counts <= (float)lowest)
        return lowest;
    if (counts != counts) /* NaN */
        return 0;
    return (int16_t)(counts < 0.0f ? counts - 0.5f : counts + 0.5f);
}

bool rd_quantise(int16_t q_wxyz[4], const float q[4])
{
    float unit[4];
    if (!rd_normalise(unit, q))
        return false;
    for (int k = 0; k < 4; k++)
        q_wxyz[k] = rd_counts(unit[k] * (float)RD_Q15_SCALE, -RD_Q15_SCALE);
    return true;
}

/* ------------------------------------------------------------------------------------------------- serial frames */

uint16_t rd_crc16(const uint8_t *bytes, size_t n)
{
    uint32_t crc = 0xFFFF;
    while (n--) {
        crc ^= (uint32_t)*bytes++ << 8;
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
    }
    return (uint16_t)crc;
}

size_t rd_frame(uint8_t *frame, const uint8_t *packet, size_t n)
{
    if (n < 1 || n > RD_MAX_PACKET_BYTES)
        return 0;
    const uint16_t crc = rd_crc16(packet, n);
    uint8_t *code = frame + 1; /* where the distance to the next zero is written once that is met */
    uint8_t *at = frame + 2;
    frame[0] = 0;
    for (size_t k = 0; k < n + 2; k++) {
        const uint8_t byte = (uint8_t)(k < n ? packet[k] : k == n ? crc : crc >> 8);
        if (byte) {
            *at++ = byte;
        } else {
            *code = (uint8_t)(at - code);
            code = at++;
        }
    }
    *code = (uint8_t)(at - code);
    *at++ = 0;
    return (size_t)(at - frame);
}

static rd_result skip(rd_receiver *receiver, uint32_t *cause)
{
    /* In front of the first delimiter it may be the rest of a frame: the link was opened in the middle of one. */
    *(receiver->started ? cause : &receiver->counters.partial_starts) += 1;
    receiver->counters.skipped_bytes += receiver->filled;
    return RD_NOTHING;
}

/* A piece is complete: undo COBS in place, check the sum, read the packet. */
static rd_result receive_piece(rd_receiver *receiver, rd_packet *packet)
{
    rd_counters *counters = &receiver->counters;
    uint8_t *piece = receiver->piece;
    const size_t size = receiver->filled;
    size_t at = 0;
    while (at < size) { /* every code but the first stands for a zero; 255 can only be the first of so short a piece */
        const uint8_t code = piece[at];
        piece[at] = 0;
        at += code;
    }
    if (at != size)
        return skip(receiver, &counters->cobs_errors);
    if (size < 3 || rd_crc16(piece + 1, size - 3) != ((uint32_t)piece[size - 1] << 8 | piece[size - 2]))
        return skip(receiver, &counters->crc_errors);
    counters->frames++;
    counters->frame_bytes += receiver->filled;
    receiver->packet = piece + 1;
    receiver->length = (uint16_t)(size - 3);
    const rd_result result = rd_decode(packet, receiver->packet, receiver->length);
    switch (result) {
    case RD_PACKET:
        counters->packets++;
        counters->extended += receiver->length > rd_packet_bytes(packet->type);
        break;
    case RD_UNKNOWN_TYPE:
        counters->unknown_types++;
        break;
    case RD_UNSUPPORTED_VERSION:
        counters->unsupported_versions++;
        break;
    default:
        counters->malformed++;
    }
    return result;
}

rd_result rd_receive(rd_receiver *receiver, uint8_t byte, rd_packet *packet)
{
    rd_result result = RD_NOTHING;
    receiver->counters.bytes++;
    if (byte == 0) {
        receiver->counters.delimiters++;
        if (receiver->filled)
            result = receive_piece(receiver, packet);
        receiver->filled = 0;
        receiver->skipping = false;
        receiver->started = true;
    } else if (receiver->skipping) {
        receiver->counters.skipped_bytes++;
    } else if (receiver->filled < RD_MAX_PIECE_BYTES) {
        receiver->piece[receiver->filled++] = byte;
    } else { /* longer than any frame: skip all of it, up to the next delimiter */
        receiver->filled++;
        skip(receiver, &receiver->counters.oversize);
        receiver->filled = 0;
        receiver->skipping = true;
    }
    return result;
}
