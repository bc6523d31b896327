/* The protocol of docs/protocol.md in C99: packets, serial frames, and a receiver with its counters.
 *
 * Freestanding: no allocation, no static data, nothing of libc but memcpy. Any byte order, any alignment. Nothing here
 * waits or sends: bytes go in and bytes come out, the caller owns every buffer.
 *
 * README.md has an example.
 */
#ifndef ROTDRIFT_PROTOCOL_H
#define ROTDRIFT_PROTOCOL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "rotdrift_constants.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ------------------------------------------------------------------------------------------------------- packets
 * Fields have the names, the units and the steps of the tables in docs/protocol.md: numbers are the counts that stand
 * on the wire. Texts are UTF-8, filled up with zeros. Unknown numbers of INFO are NaN. */

typedef struct {
    uint8_t slot;
    uint16_t mass_cg;
} rd_weight;

typedef struct {
    uint8_t protocol_major, protocol_minor;
    uint64_t device_id;
    uint32_t boot_id;
    uint8_t firmware_version[3];
    uint16_t rate_hz;
    char name[32], sensor[24], filter[24];
    uint8_t shape;
    float size_mm[3];
    char surface[32];
    float mass_g;
    float com_mm[3];
    uint8_t weight_count;
    rd_weight weights[RD_MAX_WEIGHTS];
    float mounting_q_body_sensor[4];
} rd_info;

typedef struct {
    uint16_t sequence;
    uint32_t device_time_us;
    int16_t q_wxyz[4]; /* rd_quantise */
    uint8_t flags;
} rd_orientation;

typedef struct {
    uint64_t uptime_us;
    uint8_t state;
    uint64_t samples_produced;
    uint32_t samples_dropped;
    uint16_t battery_mv;
    int16_t temperature_c;    /* rd_counts(celsius * 100.0f, -32767), or RD_TEMPERATURE_UNKNOWN */
    int16_t gyro_bias_dps[3]; /* rd_counts(dps * 1000.0f, -32767) */
    uint16_t errors;
} rd_status;

typedef struct {
    uint16_t sequence;
    uint32_t device_time_us;
    int16_t gyro_dps[3];       /* rd_counts(dps * RD_GYRO_COUNTS_PER_DPS, -32768) */
    int16_t acceleration_g[3]; /* rd_counts(g * RD_ACCELERATION_COUNTS_PER_G, -32768) */
} rd_raw_imu;

typedef struct {
    uint8_t command_type, command_id, code;
} rd_ack;

typedef struct {
    uint8_t command_id;
    uint64_t receive_uptime_us, transmit_uptime_us;
} rd_time_reply;

typedef struct {
    uint32_t device_time_us;
    uint8_t kind;
    uint16_t value;
} rd_event;

typedef struct {
    uint8_t command_id;
} rd_command; /* GET_INFO, STOP, CALIBRATE, TIME_REQUEST */

typedef struct {
    uint8_t command_id, with_raw_imu;
} rd_start;

typedef struct {
    uint8_t command_id;
    uint16_t rate_hz;
} rd_set_rate;

typedef struct {
    uint8_t command_id, duration_s;
} rd_identify;

typedef struct {
    uint8_t command_id;
    uint16_t marker;
} rd_mark;

typedef struct {
    uint8_t type; /* RD_INFO ... RD_MARK; which of these it is */
    union {
        rd_info info;
        rd_orientation orientation;
        rd_status status;
        rd_raw_imu raw_imu;
        rd_ack ack;
        rd_time_reply time_reply;
        rd_event event;
        rd_command command;
        rd_start start;
        rd_set_rate set_rate;
        rd_identify identify;
        rd_mark mark;
    } as;
} rd_packet;

typedef enum {
    RD_NOTHING,            /* rd_receive: this byte ends no good frame */
    RD_PACKET,             /* a packet of this version */
    RD_MALFORMED,          /* too short, or a value outside its table or range */
    RD_UNKNOWN_TYPE,       /* of a newer minor version */
    RD_UNSUPPORTED_VERSION /* INFO of another major version; type, protocol_major and protocol_minor are set, no more */
} rd_result;

/* Size of a packet of this version with its type byte; 0 where there is no such type. */
size_t rd_packet_bytes(uint8_t type);

/* Write a packet, type byte first: rd_packet_bytes(packet->type) bytes, which are returned. 0, and nothing is written,
 * where there is no such type or a value is outside its table or range. */
size_t rd_encode(uint8_t *bytes, const rd_packet *packet);

/* Read a packet of n bytes. Bytes behind the fields known here belong to a newer minor version and are ignored. */
rd_result rd_decode(rd_packet *packet, const uint8_t *bytes, size_t n);

/* -------------------------------------------------------------------------------------------------------- values */

/* 1 / sqrt(square) for 0.25 <= square <= 1.05, to float precision, without libm. */
float rd_inverse_root(float square);

/* Make a quaternion exactly unit. False, and nothing is written, where its norm is off by more than RD_NORM_TOLERANCE,
 * NaN included: then the filter has failed, and there is no orientation to send. */
bool rd_normalise(float unit[4], const float q[4]);

/* A quaternion as the four int16 of ORIENTATION, normalised first: a norm of 1.0001, as fast inverse square roots leave
 * it, times 32767 would leave int16 and send the mirrored rotation. False like rd_normalise. */
bool rd_quantise(int16_t q_wxyz[4], const float q[4]);

/* A measured value as an int16 count: rounded to nearest, lowest or 32767 where beyond, 0 for NaN. */
int16_t rd_counts(float counts, int16_t lowest);

/* ------------------------------------------------------------------------------------------------- serial frames */

enum { RD_FRAME_OVERHEAD = RD_MAX_FRAME_BYTES - RD_MAX_PACKET_BYTES };

/* CRC-16/CCITT-FALSE. */
uint16_t rd_crc16(const uint8_t *bytes, size_t n);

/* Write the frame of a packet, both delimiters included: n + RD_FRAME_OVERHEAD bytes, which are returned; 0 where n is
 * not 1 to RD_MAX_PACKET_BYTES. The packet must not overlap the frame. */
size_t rd_frame(uint8_t *frame, const uint8_t *packet, size_t n);

/* What became of the bytes and frames, as docs/protocol.md names and defines it. u32, wrapping. */
typedef struct {
    uint32_t bytes, delimiters, frame_bytes, skipped_bytes;
    uint32_t frames, oversize, cobs_errors, crc_errors, partial_starts;
    uint32_t packets, malformed, unknown_types, unsupported_versions, extended;
} rd_counters;

/* All zeros is a receiver ready for its first byte. */
typedef struct {
    rd_counters counters;
    const uint8_t *packet; /* bytes of the last good frame's packet, until the next byte is received */
    uint16_t length;       /* of it: with them a command that is unknown or malformed can be answered */
    uint16_t filled;       /* bytes pending: the start of a piece */
    bool skipping;         /* inside a piece already counted as oversize */
    bool started;          /* a delimiter has been met */
    uint8_t piece[RD_MAX_PIECE_BYTES];
} rd_receiver;

/* Receive one byte. Where it ends a good frame: what its packet is, and the packet itself where it is RD_PACKET. */
rd_result rd_receive(rd_receiver *receiver, uint8_t byte, rd_packet *packet);

#ifdef __cplusplus
}
#endif

#endif
