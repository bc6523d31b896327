#include "rotdrift_can.h"

extern void *memcpy(void *to, const void *from, size_t n);

enum {
    CLASSIC_BYTES = 8,
    OFFSET = 1 << (RD_SMALLEST_THREE_BITS - 1), /* a code is this plus the component's steps: code 0 is never sent */
    /* First byte of an ISO-TP frame, upper four bits; the lower four of flow control are its kind. */
    FIRST_FRAME = 0x10,
    CONSECUTIVE_FRAME = 0x20,
    FLOW_CONTROL = 0x30,
    CLEAR_TO_SEND = 0,
    WAIT = 1,
    PADDING = 0xCC,
    UNLIMITED_BLOCK = 0xFFFF
};

static void put(uint8_t *at, uint64_t number, unsigned size) /* little endian */
{
    for (; size; size--, number >>= 8)
        *at++ = (uint8_t)number;
}

/* The next length that a CAN FD frame can have. */
static uint8_t fd_length(unsigned n)
{
    const unsigned step = n <= 8 ? 1 : n <= 24 ? 4 : 16; /* 8, 12 ... 24, 32, 48, 64 */
    return (uint8_t)((n + step - 1) / step * step);
}

/* Send the first n bytes of can->frame, filled up where the kind of frame has fixed lengths. */
static bool send_frame(rd_can *can, unsigned function, bool is_whole, unsigned n, uint8_t filling)
{
    const unsigned id = (is_whole ? RD_CAN_WHOLE_PACKET : 0u) | function << 5 | can->node;
    const unsigned length = is_whole ? fd_length(n) : filling ? CLASSIC_BYTES : n;
    while (n < length)
        can->frame[n++] = filling;
    return can->send(can->context, (uint16_t)id, can->frame, (uint8_t)length);
}

static bool send_classic(rd_can *can, unsigned function, unsigned n)
{
    return send_frame(can, function, false, n, 0);
}

/* A classic frame: a byte, then n more. */
static bool send_part(rd_can *can, unsigned function, unsigned first, const uint8_t *bytes, unsigned n)
{
    can->frame[0] = (uint8_t)first;
    memcpy(can->frame + 1, bytes, n);
    return send_classic(can, function, n + 1);
}

/* ------------------------------------------------------------------------------------------------------- samples */

uint8_t rd_boot_tag(uint64_t device_id, uint32_t boot_id)
{
    uint8_t identity[12];
    put(identity, device_id, 8);
    put(identity + 8, boot_id, 4);
    return (uint8_t)(rd_crc16(identity, sizeof identity) % 255 + 1);
}

bool rd_to_smallest_three(uint64_t *code, const float q[4])
{
    float unit[4];
    int largest = 0;
    *code = (1ull << (2 + 3 * RD_SMALLEST_THREE_BITS)) - 1;
    if (!rd_normalise(unit, q))
        return false;
    for (int k = 1; k < 4; k++)
        if ((unit[k] < 0 ? -unit[k] : unit[k]) > (unit[largest] < 0 ? -unit[largest] : unit[largest]))
            largest = k;
    const float scale = unit[largest] < 0 ? -RD_SMALLEST_THREE_SCALE : RD_SMALLEST_THREE_SCALE;
    *code = (uint64_t)largest;
    for (int k = 0; k < 4; k++) {
        if (k == largest)
            continue;
        const float steps = unit[k] * scale;
        /* No component but the largest is beyond 1 / sqrt(2), 131071 steps, by more than a rounding of single
         * precision, 0.02 steps: the result fits its 18 bits. */
        const int32_t rounded = (int32_t)(steps < 0 ? steps - 0.5f : steps + 0.5f);
        *code = *code << RD_SMALLEST_THREE_BITS | (uint32_t)(rounded + OFFSET);
    }
    return true;
}

bool rd_from_smallest_three(float q[4], uint64_t code)
{
    const unsigned largest = (unsigned)(code >> 3 * RD_SMALLEST_THREE_BITS);
    uint64_t square = 0; /* in steps, where it is exact */
    unsigned shift = 3 * RD_SMALLEST_THREE_BITS;
    if (largest > 3)
        return false;
    for (unsigned k = 0; k < 4; k++) {
        if (k == largest)
            continue;
        shift -= RD_SMALLEST_THREE_BITS;
        const int32_t steps = (int32_t)(code >> shift & (2 * OFFSET - 1)) - OFFSET;
        if (steps == -OFFSET)
            return false;
        square += (uint64_t)((int64_t)steps * steps);
        q[k] = (float)steps / RD_SMALLEST_THREE_SCALE;
    }
    if (square > RD_SMALLEST_THREE_MAX_SQUARE)
        return false;
    const float rest = 1.0f - (float)square / (RD_SMALLEST_THREE_SCALE * RD_SMALLEST_THREE_SCALE);
    q[largest] = rest * rd_inverse_root(rest);
    return true;
}

/* Samples between two TIME frames: a power of two, at least RD_CAN_TIME_FRAMES_PER_S of them a second. */
static uint32_t time_interval(uint16_t rate_hz)
{
    uint32_t interval = 1;
    while (2 * interval <= RD_CAN_MAX_TIME_INTERVAL && 2 * interval <= rate_hz / RD_CAN_TIME_FRAMES_PER_S)
        interval *= 2;
    return interval;
}

/* Whether the host, which counts on from the last TIME frame, would be wrong by more than it may. */
static bool is_off_grid(const rd_can *can, uint32_t counter, uint32_t time_us)
{
    const uint32_t rate_hz = can->published.rate_hz;
    const uint32_t since = counter - can->published.counter; /* below RD_CAN_MAX_TIME_INTERVAL: TIME is not due */
    const uint32_t expected_us = can->published.time_us + (2000000u * since + rate_hz) / (2u * rate_hz);
    const int32_t off_us = (int32_t)(time_us - expected_us);
    return off_us > RD_CAN_GRID_TOLERANCE_US || off_us < -RD_CAN_GRID_TOLERANCE_US;
}

/* Send SAMPLE_STATE and TIME where the listeners need them before this sample. What is noted as published changes only
 * once all of it is sent: else the next sample tries again. */
static bool publish(rd_can *can, uint32_t counter, uint32_t time_us, uint16_t rate_hz, uint8_t flags)
{
    const uint32_t interval = time_interval(rate_hz);
    const bool due = !can->published.known || can->published.rate_hz != rate_hz
                     || counter / interval != can->published.counter / interval;
    const bool time_due = due || is_off_grid(can, counter, time_us);
    uint8_t *data = can->frame;
    if (due || can->published.flags != flags) {
        put(data, counter, 4);
        data[4] = flags;
        put(data + 5, rate_hz, 2);
        data[7] = can->boot_tag;
        if (!send_classic(can, RD_CAN_SAMPLE_STATE, CLASSIC_BYTES))
            return false;
    }
    if (time_due) {
        put(data, counter, 4);
        put(data + 4, time_us, 4);
        if (!send_classic(can, RD_CAN_TIME, CLASSIC_BYTES))
            return false;
        can->published.counter = counter;
        can->published.time_us = time_us;
    }
    can->published.flags = flags;
    can->published.rate_hz = rate_hz;
    can->published.known = true;
    return true;
}

bool rd_can_sample(rd_can *can, uint32_t counter, uint32_t time_us, uint16_t rate_hz, const float q[4], uint8_t flags)
{
    uint64_t code;
    const bool good = rd_to_smallest_three(&code, q);
    if (rate_hz < RD_MIN_RATE_HZ || rate_hz > RD_MAX_RATE_HZ || (can->fd && !good)
        || !publish(can, counter, time_us, rate_hz, flags))
        return false;
    uint8_t *at = can->frame;
    if (!can->fd) {
        *at = (uint8_t)counter;
        put(at + 1, code, 7);
        return send_classic(can, RD_CAN_ORIENTATION, CLASSIC_BYTES);
    }
    int16_t q15[4];
    rd_quantise(q15, q);
    *at++ = RD_ORIENTATION_BYTES;
    *at = RD_ORIENTATION;
    put(at + RD_ORIENTATION_SEQUENCE_AT, counter, 2);
    put(at + RD_ORIENTATION_DEVICE_TIME_US_AT, time_us, 4);
    for (size_t k = 0; k < 4; k++)
        put(at + RD_ORIENTATION_Q_WXYZ_AT + 2 * k, (uint16_t)q15[k], 2);
    at[RD_ORIENTATION_FLAGS_AT] = flags;
    return send_frame(can, RD_CAN_ORIENTATION, true, 1 + RD_ORIENTATION_BYTES, 0);
}

/* ------------------------------------------------------------------------------------------------- other packets */

/* STATUS as five frames; the fields are copied as they stand in the packet, which has the same byte order. */
static bool send_status(rd_can *can, const uint8_t *packet)
{
    uint8_t *data = can->frame;
    if (!send_part(can, RD_CAN_STATUS, 0, packet + RD_STATUS_UPTIME_US_AT, 7)
        || !send_part(can, RD_CAN_STATUS, 1, packet + RD_STATUS_SAMPLES_PRODUCED_AT, 7))
        return false;
    data[0] = 2;
    memcpy(data + 1, packet + RD_STATUS_SAMPLES_DROPPED_AT, 4);
    data[5] = packet[RD_STATUS_STATE_AT];
    memcpy(data + 6, packet + RD_STATUS_ERRORS_AT, 2);
    if (!send_classic(can, RD_CAN_STATUS, CLASSIC_BYTES))
        return false;
    data[0] = 3;
    memcpy(data + 1, packet + RD_STATUS_BATTERY_MV_AT, 2);
    memcpy(data + 3, packet + RD_STATUS_TEMPERATURE_C_AT, 2);
    memcpy(data + 5, packet + RD_STATUS_GYRO_BIAS_DPS_AT, 2);
    data[7] = 0;
    if (!send_classic(can, RD_CAN_STATUS, CLASSIC_BYTES))
        return false;
    data[0] = 4;
    memcpy(data + 1, packet + RD_STATUS_GYRO_BIAS_DPS_AT + 2, 4);
    put(data + 5, 0, 3);
    return send_classic(can, RD_CAN_STATUS, CLASSIC_BYTES);
}

/* INFO: its first frame; what follows waits for the host's flow control. */
static bool start_info(rd_can *can, const uint8_t *packet, size_t n, uint32_t clock_us)
{
    const unsigned size = (can->fd ? RD_CAN_MAX_BYTES : CLASSIC_BYTES) - 2;
    if (can->sending.packet || n < RD_INFO_BYTES || n > 4095)
        return false;
    can->frame[0] = (uint8_t)(FIRST_FRAME | n >> 8);
    can->frame[1] = (uint8_t)n;
    memcpy(can->frame + 2, packet, size);
    if (!send_frame(can, RD_CAN_LONG_FROM_OBJECT, can->fd, size + 2, PADDING))
        return false;
    can->sending.packet = packet;
    can->sending.length = (uint16_t)n;
    can->sending.sent = (uint16_t)size;
    can->sending.sequence = 1;
    can->sending.block = 0;
    can->sending.since_us = clock_us;
    return true;
}

bool rd_can_packet(rd_can *can, const uint8_t *packet, size_t n, uint32_t clock_us)
{
    if (n == 0 || n < rd_packet_bytes(packet[0]))
        return false;
    if (packet[0] == RD_INFO)
        return start_info(can, packet, n, clock_us);
    unsigned function;
    switch (packet[0]) {
    case RD_STATUS:
        function = RD_CAN_STATUS;
        break;
    case RD_RAW_IMU:
        function = RD_CAN_RAW_GYRO;
        break;
    case RD_ACK:
        function = RD_CAN_ACK;
        break;
    case RD_TIME_REPLY:
        function = RD_CAN_TIME_REPLY_RECEIVE;
        break;
    case RD_EVENT:
        function = RD_CAN_EVENT;
        break;
    default:
        return false;
    }
    if (can->fd) {
        if (n >= RD_CAN_MAX_BYTES)
            return false;
        can->frame[0] = (uint8_t)n;
        memcpy(can->frame + 1, packet, n);
        return send_frame(can, function, true, (unsigned)n + 1, 0);
    }
    switch (packet[0]) {
    case RD_STATUS:
        return send_status(can, packet);
    case RD_RAW_IMU: /* with the low eight bits of the sequence */
        return send_part(can, RD_CAN_RAW_GYRO, packet[RD_RAW_IMU_SEQUENCE_AT], packet + RD_RAW_IMU_GYRO_DPS_AT, 6)
               && send_part(can, RD_CAN_RAW_ACCELERATION, packet[RD_RAW_IMU_SEQUENCE_AT],
                            packet + RD_RAW_IMU_ACCELERATION_G_AT, 6);
    case RD_TIME_REPLY: /* a clock in 56 bits: 2283 years */
        return send_part(can, RD_CAN_TIME_REPLY_RECEIVE, packet[RD_TIME_REPLY_COMMAND_ID_AT],
                         packet + RD_TIME_REPLY_RECEIVE_UPTIME_US_AT, 7)
               && send_part(can, RD_CAN_TIME_REPLY_TRANSMIT, packet[RD_TIME_REPLY_COMMAND_ID_AT],
                            packet + RD_TIME_REPLY_TRANSMIT_UPTIME_US_AT, 7);
    default:
        return n <= CLASSIC_BYTES && send_part(can, function, packet[0], packet + 1, (unsigned)n - 1);
    }
}

/* ------------------------------------------------------------------------------------------------- from the host */

static void receive_flow_control(rd_can *can, const uint8_t *data, uint8_t length, uint32_t clock_us)
{
    if (!can->sending.packet || length < 3 || (data[0] & 0xF0) != FLOW_CONTROL)
        return;
    if ((data[0] & 0x0F) == CLEAR_TO_SEND) {
        can->sending.block = data[1] ? data[1] : UNLIMITED_BLOCK;
        can->sending.separation = data[2];
    } else if ((data[0] & 0x0F) != WAIT) { /* the host has no room */
        can->sending.packet = NULL;
    }
    can->sending.since_us = clock_us;
}

size_t rd_can_receive(rd_can *can, uint16_t id, const uint8_t *data, uint8_t length, const uint8_t **packet,
                      uint32_t clock_us)
{
    const bool is_whole = (id & RD_CAN_WHOLE_PACKET) != 0;
    const unsigned function = id >> 5 & 0x1F, node = id & 0x1F;
    if (id > 0x7FF || length == 0 || (node != can->node && node != 0))
        return 0;
    if (function == RD_CAN_LONG_TO_OBJECT && node == can->node && is_whole == can->fd)
        receive_flow_control(can, data, length, clock_us);
    if (function != RD_CAN_COMMAND || (is_whole && (data[0] == 0 || data[0] >= length)))
        return 0;
    *packet = data + is_whole;
    return is_whole ? data[0] : length;
}

/* Separation time of ISO 15765-2 in us: ms up to 0x7F, hundreds of us from 0xF1 to 0xF9, else the longest there is. */
static uint32_t separation_us(uint8_t code)
{
    if (code >= 0xF1 && code <= 0xF9)
        return 100u * (code - 0xF0u);
    return 1000u * (code <= 0x7F ? code : 0x7Fu);
}

void rd_can_poll(rd_can *can, uint32_t clock_us)
{
    while (can->sending.packet) {
        const uint32_t waited_us = clock_us - can->sending.since_us;
        const unsigned room = can->fd ? RD_CAN_MAX_BYTES - 1 : CLASSIC_BYTES - 1;
        const unsigned left = (unsigned)(can->sending.length - can->sending.sent);
        const unsigned size = left < room ? left : room;
        if (can->sending.block == 0) {
            if (waited_us >= RD_CAN_FLOW_CONTROL_US)
                can->sending.packet = NULL;
            return;
        }
        if (waited_us < separation_us(can->sending.separation))
            return;
        can->frame[0] = (uint8_t)(CONSECUTIVE_FRAME | (can->sending.sequence & 0x0F));
        memcpy(can->frame + 1, can->sending.packet + can->sending.sent, size);
        if (!send_frame(can, RD_CAN_LONG_FROM_OBJECT, can->fd, size + 1, PADDING))
            return;
        can->sending.sent = (uint16_t)(can->sending.sent + size);
        can->sending.sequence++;
        can->sending.since_us = clock_us;
        if (can->sending.block != UNLIMITED_BLOCK)
            can->sending.block--;
        if (can->sending.sent == can->sending.length)
            can->sending.packet = NULL;
    }
}
