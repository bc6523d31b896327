/* The C library as a filter: a question a line, an answer a line, for tests in Python. The same program runs on this
 * machine and, with semihosting, on an emulated Cortex-M: driver [questions [answers]]. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rotdrift_can.h"
#include "rotdrift_protocol.h"
#include "rotdrift_sequence.h"

enum { MAX_LINE = 1 << 17 };

static FILE *answers;
static char line[MAX_LINE];
static uint8_t data[MAX_LINE / 2];

/* ---- words of a line */

static char *word(void)
{
    return strtok(NULL, " \n");
}

static uint64_t number(void)
{
    const char *text = word();
    return text ? (uint64_t)(*text == '-' ? strtoll(text, NULL, 10) : (long long)strtoull(text, NULL, 10)) : 0;
}

static float real(void)
{
    const char *text = word();
    return text ? strtof(text, NULL) : 0.0f;
}

static unsigned nibble(char c)
{
    return (unsigned)(c <= '9' ? c - '0' : c - 'a' + 10);
}

static size_t hex(uint8_t *to)
{
    const char *text = word();
    size_t n = 0;
    for (; text && text[2 * n] && text[2 * n + 1]; n++)
        to[n] = (uint8_t)(nibble(text[2 * n]) << 4 | nibble(text[2 * n + 1]));
    return n;
}

static void print_hex(const uint8_t *bytes, size_t n)
{
    while (n--)
        fprintf(answers, "%02x", *bytes++);
}

/* ---- fields, flat and in wire order: integers as they are, floats by their bits */

#define ACCESS(KIND, type, carrier) \
    static void show_##KIND(const void *at, int n) \
    { \
        for (int k = 0; k < n; k++) \
            fprintf(answers, " %lld", (long long)((const type *)at)[k]); \
    } \
    static void fill_##KIND(void *at, int n) \
    { \
        for (int k = 0; k < n; k++) \
            ((type *)at)[k] = (type)(carrier)number(); \
    }

ACCESS(U8, uint8_t, uint64_t)
ACCESS(U16, uint16_t, uint64_t)
ACCESS(I16, int16_t, int64_t)
ACCESS(U32, uint32_t, uint64_t)

static void show_U64(const void *at, int n)
{
    for (int k = 0; k < n; k++)
        fprintf(answers, " %llu", (unsigned long long)((const uint64_t *)at)[k]);
}

static void fill_U64(void *at, int n)
{
    for (int k = 0; k < n; k++)
        ((uint64_t *)at)[k] = number();
}

static void show_F32(const void *at, int n)
{
    for (int k = 0; k < n; k++) {
        uint32_t bits;
        memcpy(&bits, (const float *)at + k, sizeof bits);
        fprintf(answers, " %" PRIu32, bits);
    }
}

static void fill_F32(void *at, int n)
{
    for (int k = 0; k < n; k++) {
        const uint32_t bits = (uint32_t)number();
        memcpy((float *)at + k, &bits, sizeof bits);
    }
}

static void show_U8_U16(const void *at, int n)
{
    for (const rd_weight *weight = at; n--; weight++)
        fprintf(answers, " %d %d", weight->slot, weight->mass_cg);
}

static void fill_U8_U16(void *at, int n)
{
    for (rd_weight *weight = at; n--; weight++) {
        weight->slot = (uint8_t)number();
        weight->mass_cg = (uint16_t)number();
    }
}

#define SHOW(S, name, kind, n) show_##kind(&((const S *)fields)->name, n);
#define FILL(S, name, kind, n) fill_##kind(&((S *)fields)->name, n);
#define EACH(DO, fields_type) \
    fields_type *fields = (fields_type *)&packet->as; \
    switch (packet->type) { \
    case RD_INFO: RD_LAYOUT_INFO(DO, rd_info) break; \
    case RD_ORIENTATION: RD_LAYOUT_ORIENTATION(DO, rd_orientation) break; \
    case RD_STATUS: RD_LAYOUT_STATUS(DO, rd_status) break; \
    case RD_RAW_IMU: RD_LAYOUT_RAW_IMU(DO, rd_raw_imu) break; \
    case RD_ACK: RD_LAYOUT_ACK(DO, rd_ack) break; \
    case RD_TIME_REPLY: RD_LAYOUT_TIME_REPLY(DO, rd_time_reply) break; \
    case RD_EVENT: RD_LAYOUT_EVENT(DO, rd_event) break; \
    case RD_START: RD_LAYOUT_START(DO, rd_start) break; \
    case RD_SET_RATE: RD_LAYOUT_SET_RATE(DO, rd_set_rate) break; \
    case RD_IDENTIFY: RD_LAYOUT_IDENTIFY(DO, rd_identify) break; \
    case RD_MARK: RD_LAYOUT_MARK(DO, rd_mark) break; \
    default: RD_LAYOUT_STOP(DO, rd_command) break; \
    }

static void show_fields(const rd_packet *packet)
{
    EACH(SHOW, const void)
}

static void fill_fields(rd_packet *packet)
{
    EACH(FILL, void)
}

/* ---- the questions */

static void print_packet(const rd_packet *packet)
{
    uint8_t bytes[RD_MAX_PACKET_BYTES];
    const size_t n = rd_encode(bytes, packet);
    print_hex(bytes, n);
    if (n == 0)
        fputc('-', answers);
}

static void decode(void)
{
    rd_packet packet;
    const size_t n = hex(data);
    const rd_result result = rd_decode(&packet, data, n);
    fprintf(answers, "%d ", (int)result);
    if (result == RD_PACKET) {
        print_packet(&packet);
        show_fields(&packet);
    }
}

static void build(void)
{
    rd_packet packet;
    memset(&packet, 0, sizeof packet);
    packet.type = (uint8_t)number();
    fill_fields(&packet);
    print_packet(&packet);
}

static void stream(void)
{
    rd_receiver receiver;
    rd_sequence sequence;
    rd_packet packet;
    uint32_t boot_id = 0;
    bool met = false;
    const size_t n = hex(data);
    memset(&receiver, 0, sizeof receiver);
    memset(&sequence, 0, sizeof sequence);
    for (size_t k = 0; k < n; k++) {
        const rd_result result = rd_receive(&receiver, data[k], &packet);
        if (result == RD_UNSUPPORTED_VERSION)
            fprintf(answers, "v%d.%d ", packet.as.info.protocol_major, packet.as.info.protocol_minor);
        if (result != RD_PACKET)
            continue;
        print_packet(&packet);
        fputc(' ', answers);
        if (packet.type == RD_ORIENTATION)
            rd_sequence_feed(&sequence, packet.as.orientation.sequence);
        if (packet.type == RD_INFO) {
            if (met && packet.as.info.boot_id != boot_id)
                rd_sequence_restart(&sequence);
            met = true;
            boot_id = packet.as.info.boot_id;
        }
    }
#define COUNTER(from, name) fprintf(answers, " " #name "=%" PRIu32, (from).name);
    const rd_counters *counters = &receiver.counters;
    fputc('|', answers);
    COUNTER(*counters, bytes) COUNTER(*counters, delimiters) COUNTER(*counters, frame_bytes)
    COUNTER(*counters, skipped_bytes) COUNTER(*counters, frames) COUNTER(*counters, oversize)
    COUNTER(*counters, cobs_errors) COUNTER(*counters, crc_errors) COUNTER(*counters, partial_starts)
    COUNTER(*counters, malformed) COUNTER(*counters, unknown_types) COUNTER(*counters, unsupported_versions)
    COUNTER(*counters, extended) COUNTER(*counters, packets)
    COUNTER(sequence, sequence_gaps) COUNTER(sequence, samples_lost) COUNTER(sequence, duplicates)
    COUNTER(sequence, reordered) COUNTER(sequence, sequence_restarts)
    fprintf(answers, " pending_bytes=%d", receiver.filled);
}

static void quantise(void)
{
    int16_t q15[4] = {0};
    float q[4];
    for (int k = 0; k < 4; k++)
        q[k] = real();
    const bool good = rd_quantise(q15, q);
    fprintf(answers, "%d %d %d %d %d", good, q15[0], q15[1], q15[2], q15[3]);
}

static void smallest_three(void)
{
    uint64_t code;
    float q[4], back[4] = {0};
    for (int k = 0; k < 4; k++)
        q[k] = real();
    const bool good = rd_to_smallest_three(&code, q);
    const bool valid = rd_from_smallest_three(back, code);
    fprintf(answers, "%d %014llx %d", good, (unsigned long long)code, valid);
    show_F32(back, 4);
}

static void from_smallest_three(void)
{
    float q[4] = {0};
    const bool good = rd_from_smallest_three(q, strtoull(word(), NULL, 16));
    fprintf(answers, "%d", good);
    show_F32(q, 4);
}

static void counts(void)
{
    const float value = real();
    fprintf(answers, "%d", rd_counts(value, (int16_t)(int64_t)number()));
}

/* ---- CAN: one object, and a queue with room for some frames */

static rd_can can;
static uint8_t info[RD_MAX_PACKET_BYTES];
static unsigned long room = 1000000;

static bool take_frame(void *context, uint16_t id, const uint8_t *bytes, uint8_t length)
{
    (void)context;
    if (room == 0)
        return false;
    room--;
    fprintf(answers, "%03x:", id);
    print_hex(bytes, length);
    fputc(' ', answers);
    return true;
}

static void can_new(void)
{
    memset(&can, 0, sizeof can);
    can.node = (uint8_t)number();
    can.fd = number() != 0;
    const uint64_t device_id = number();
    can.boot_tag = rd_boot_tag(device_id, (uint32_t)number());
    can.send = take_frame;
    room = 1000000;
    fprintf(answers, "%d", can.boot_tag);
}

static void can_sample(void)
{
    float q[4];
    const uint32_t counter = (uint32_t)number(), time_us = (uint32_t)number();
    const uint16_t rate_hz = (uint16_t)number();
    for (int k = 0; k < 4; k++)
        q[k] = real();
    const bool good = rd_can_sample(&can, counter, time_us, rate_hz, q, (uint8_t)number());
    fprintf(answers, "%d", good);
}

static void can_packet(void)
{
    const uint32_t clock_us = (uint32_t)number();
    const size_t n = hex(data);
    memcpy(info, data, n < sizeof info ? n : sizeof info);
    const bool good = rd_can_packet(&can, info, n, clock_us);
    fprintf(answers, "%d", good);
}

static void can_frame(void)
{
    const uint32_t clock_us = (uint32_t)number();
    const uint16_t id = (uint16_t)number();
    const uint8_t *packet;
    const size_t n = hex(data);
    const size_t size = rd_can_receive(&can, id, data, (uint8_t)n, &packet, clock_us);
    print_hex(packet, size);
}

static void can_poll(void)
{
    rd_can_poll(&can, (uint32_t)number());
    fprintf(answers, "%d", can.sending.packet != NULL);
}

int main(int argc, char **argv)
{
    FILE *questions = argc > 1 ? fopen(argv[1], "r") : stdin;
    answers = argc > 2 ? fopen(argv[2], "w") : stdout;
    if (!questions || !answers)
        return 2;
    while (fgets(line, sizeof line, questions)) {
        const char *what = strtok(line, " \n");
        if (!what)
            continue;
        if (!strcmp(what, "decode"))
            decode();
        else if (!strcmp(what, "build"))
            build();
        else if (!strcmp(what, "stream"))
            stream();
        else if (!strcmp(what, "quantise"))
            quantise();
        else if (!strcmp(what, "smallest"))
            smallest_three();
        else if (!strcmp(what, "widen"))
            from_smallest_three();
        else if (!strcmp(what, "counts"))
            counts();
        else if (!strcmp(what, "crc"))
            fprintf(answers, "%04x", rd_crc16(data, hex(data)));
        else if (!strcmp(what, "frame")) {
            uint8_t frame[RD_MAX_FRAME_BYTES];
            print_hex(frame, rd_frame(frame, data, hex(data)));
        } else if (!strcmp(what, "can-new"))
            can_new();
        else if (!strcmp(what, "can-room"))
            room = (unsigned long)number();
        else if (!strcmp(what, "can-sample"))
            can_sample();
        else if (!strcmp(what, "can-packet"))
            can_packet();
        else if (!strcmp(what, "can-frame"))
            can_frame();
        else if (!strcmp(what, "can-poll"))
            can_poll();
        else
            return 3;
        fputc('\n', answers);
    }
    return fclose(answers) ? 4 : 0;
}
