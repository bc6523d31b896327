/* Made by `python -m tests.c_library.constants`; not written by hand. */
#ifndef ROTDRIFT_CONSTANTS_H
#define ROTDRIFT_CONSTANTS_H

enum {
    RD_PROTOCOL_MAJOR = 1,
    RD_PROTOCOL_MINOR = 0,
    RD_MIN_RATE_HZ = 10,
    RD_MAX_RATE_HZ = 1000,
    RD_MAX_PACKET_BYTES = 252,
    RD_MAX_FRAME_BYTES = 257,
    RD_MAX_PIECE_BYTES = 255,
    RD_LATE_WINDOW = 256,
    RD_MAX_WEIGHTS = 8,
    RD_TEMPERATURE_UNKNOWN = -32768,
    RD_Q15_SCALE = 32767,
    RD_SMALLEST_THREE_BITS = 18,
    RD_MIN_NODE = 1,
    RD_MAX_NODE = 31,
    RD_CAN_WHOLE_PACKET = 1024,
    RD_CAN_TIME_FRAMES_PER_S = 5,
    RD_CAN_MAX_TIME_INTERVAL = 64,
    RD_CAN_GRID_TOLERANCE_US = 1,
};

#define RD_Q15_MIN_SQUARE 1052310131u
#define RD_Q15_MAX_SQUARE 1095257182u
#define RD_NORM_TOLERANCE 0.01f
#define RD_SMALLEST_THREE_SCALE 185362.386f
#define RD_SMALLEST_THREE_MAX_SQUARE 25772846482ull
#define RD_GYRO_COUNTS_PER_DPS 16.384f
#define RD_ACCELERATION_COUNTS_PER_G 2048.0f

enum {
    RD_INFO = 1,
    RD_ORIENTATION = 2,
    RD_STATUS = 3,
    RD_RAW_IMU = 4,
    RD_ACK = 5,
    RD_TIME_REPLY = 6,
    RD_EVENT = 7,
    RD_GET_INFO = 129,
    RD_START = 130,
    RD_STOP = 131,
    RD_SET_RATE = 132,
    RD_IDENTIFY = 133,
    RD_CALIBRATE = 134,
    RD_TIME_REQUEST = 135,
    RD_MARK = 136,
};

enum {
    RD_INFO_BYTES = 202,
    RD_ORIENTATION_BYTES = 16,
    RD_STATUS_BYTES = 34,
    RD_RAW_IMU_BYTES = 19,
    RD_ACK_BYTES = 4,
    RD_TIME_REPLY_BYTES = 18,
    RD_EVENT_BYTES = 8,
    RD_GET_INFO_BYTES = 2,
    RD_START_BYTES = 3,
    RD_STOP_BYTES = 2,
    RD_SET_RATE_BYTES = 4,
    RD_IDENTIFY_BYTES = 3,
    RD_CALIBRATE_BYTES = 2,
    RD_TIME_REQUEST_BYTES = 2,
    RD_MARK_BYTES = 4,
};

enum {
    RD_INFO_PROTOCOL_MAJOR_AT = 1,
    RD_INFO_PROTOCOL_MINOR_AT = 2,
    RD_INFO_DEVICE_ID_AT = 3,
    RD_INFO_BOOT_ID_AT = 11,
    RD_INFO_FIRMWARE_VERSION_AT = 15,
    RD_INFO_RATE_HZ_AT = 18,
    RD_INFO_NAME_AT = 20,
    RD_INFO_SENSOR_AT = 52,
    RD_INFO_FILTER_AT = 76,
    RD_INFO_SHAPE_AT = 100,
    RD_INFO_SIZE_MM_AT = 101,
    RD_INFO_SURFACE_AT = 113,
    RD_INFO_MASS_G_AT = 145,
    RD_INFO_COM_MM_AT = 149,
    RD_INFO_WEIGHT_COUNT_AT = 161,
    RD_INFO_WEIGHTS_AT = 162,
    RD_INFO_MOUNTING_Q_BODY_SENSOR_AT = 186,
};

enum {
    RD_ORIENTATION_SEQUENCE_AT = 1,
    RD_ORIENTATION_DEVICE_TIME_US_AT = 3,
    RD_ORIENTATION_Q_WXYZ_AT = 7,
    RD_ORIENTATION_FLAGS_AT = 15,
};

enum {
    RD_STATUS_UPTIME_US_AT = 1,
    RD_STATUS_STATE_AT = 9,
    RD_STATUS_SAMPLES_PRODUCED_AT = 10,
    RD_STATUS_SAMPLES_DROPPED_AT = 18,
    RD_STATUS_BATTERY_MV_AT = 22,
    RD_STATUS_TEMPERATURE_C_AT = 24,
    RD_STATUS_GYRO_BIAS_DPS_AT = 26,
    RD_STATUS_ERRORS_AT = 32,
};

enum {
    RD_RAW_IMU_SEQUENCE_AT = 1,
    RD_RAW_IMU_DEVICE_TIME_US_AT = 3,
    RD_RAW_IMU_GYRO_DPS_AT = 7,
    RD_RAW_IMU_ACCELERATION_G_AT = 13,
};

enum {
    RD_ACK_COMMAND_TYPE_AT = 1,
    RD_ACK_COMMAND_ID_AT = 2,
    RD_ACK_CODE_AT = 3,
};

enum {
    RD_TIME_REPLY_COMMAND_ID_AT = 1,
    RD_TIME_REPLY_RECEIVE_UPTIME_US_AT = 2,
    RD_TIME_REPLY_TRANSMIT_UPTIME_US_AT = 10,
};

enum {
    RD_EVENT_DEVICE_TIME_US_AT = 1,
    RD_EVENT_KIND_AT = 5,
    RD_EVENT_VALUE_AT = 6,
};

enum {
    RD_GET_INFO_COMMAND_ID_AT = 1,
};

enum {
    RD_START_COMMAND_ID_AT = 1,
    RD_START_WITH_RAW_IMU_AT = 2,
};

enum {
    RD_STOP_COMMAND_ID_AT = 1,
};

enum {
    RD_SET_RATE_COMMAND_ID_AT = 1,
    RD_SET_RATE_RATE_HZ_AT = 2,
};

enum {
    RD_IDENTIFY_COMMAND_ID_AT = 1,
    RD_IDENTIFY_DURATION_S_AT = 2,
};

enum {
    RD_CALIBRATE_COMMAND_ID_AT = 1,
};

enum {
    RD_TIME_REQUEST_COMMAND_ID_AT = 1,
};

enum {
    RD_MARK_COMMAND_ID_AT = 1,
    RD_MARK_MARKER_AT = 2,
};

enum {
    RD_SHAPE_UNKNOWN = 0,
    RD_SHAPE_CUBE = 1,
    RD_SHAPE_CYLINDER = 2,
    RD_SHAPE_SPHERE = 3,
    RD_SHAPE_OTHER = 255,
};

enum {
    RD_FLAG_STILL = 1,
    RD_FLAG_OVERRANGE = 2,
    RD_FLAG_SATURATED = 4,
    RD_FLAG_CALIBRATED = 8,
};

enum {
    RD_STATE_IDLE = 0,
    RD_STATE_STREAMING = 1,
    RD_STATE_CALIBRATING = 2,
    RD_STATE_FAULT = 3,
};

enum {
    RD_ERROR_SENSOR = 1,
    RD_ERROR_CALIBRATION = 2,
    RD_ERROR_TRANSMIT_OVERFLOW = 4,
    RD_ERROR_LOW_BATTERY = 8,
    RD_ERROR_OVER_TEMPERATURE = 16,
};

enum {
    RD_ACK_OK = 0,
    RD_ACK_UNKNOWN_COMMAND = 1,
    RD_ACK_INVALID_ARGUMENT = 2,
    RD_ACK_WRONG_STATE = 3,
    RD_ACK_NOT_STILL = 4,
    RD_ACK_BUSY = 5,
    RD_ACK_HARDWARE_FAULT = 6,
};

enum {
    RD_EVENT_BUTTON = 0,
    RD_EVENT_MARKER = 1,
};

enum {
    RD_CAN_COMMAND = 1,
    RD_CAN_ACK = 2,
    RD_CAN_TIME_REPLY_RECEIVE = 3,
    RD_CAN_TIME_REPLY_TRANSMIT = 4,
    RD_CAN_EVENT = 5,
    RD_CAN_SAMPLE_STATE = 8,
    RD_CAN_TIME = 9,
    RD_CAN_ORIENTATION = 12,
    RD_CAN_STATUS = 16,
    RD_CAN_RAW_GYRO = 20,
    RD_CAN_RAW_ACCELERATION = 21,
    RD_CAN_LONG_TO_OBJECT = 24,
    RD_CAN_LONG_FROM_OBJECT = 25,
};

#define RD_LAYOUT_INFO(FIELD, S) \
    FIELD(S, protocol_major, U8, 1) \
    FIELD(S, protocol_minor, U8, 1) \
    FIELD(S, device_id, U64, 1) \
    FIELD(S, boot_id, U32, 1) \
    FIELD(S, firmware_version, U8, 3) \
    FIELD(S, rate_hz, U16, 1) \
    FIELD(S, name, U8, 32) \
    FIELD(S, sensor, U8, 24) \
    FIELD(S, filter, U8, 24) \
    FIELD(S, shape, U8, 1) \
    FIELD(S, size_mm, F32, 3) \
    FIELD(S, surface, U8, 32) \
    FIELD(S, mass_g, F32, 1) \
    FIELD(S, com_mm, F32, 3) \
    FIELD(S, weight_count, U8, 1) \
    FIELD(S, weights, U8_U16, 8) \
    FIELD(S, mounting_q_body_sensor, F32, 4)

#define RD_LAYOUT_ORIENTATION(FIELD, S) \
    FIELD(S, sequence, U16, 1) \
    FIELD(S, device_time_us, U32, 1) \
    FIELD(S, q_wxyz, I16, 4) \
    FIELD(S, flags, U8, 1)

#define RD_LAYOUT_STATUS(FIELD, S) \
    FIELD(S, uptime_us, U64, 1) \
    FIELD(S, state, U8, 1) \
    FIELD(S, samples_produced, U64, 1) \
    FIELD(S, samples_dropped, U32, 1) \
    FIELD(S, battery_mv, U16, 1) \
    FIELD(S, temperature_c, I16, 1) \
    FIELD(S, gyro_bias_dps, I16, 3) \
    FIELD(S, errors, U16, 1)

#define RD_LAYOUT_RAW_IMU(FIELD, S) \
    FIELD(S, sequence, U16, 1) \
    FIELD(S, device_time_us, U32, 1) \
    FIELD(S, gyro_dps, I16, 3) \
    FIELD(S, acceleration_g, I16, 3)

#define RD_LAYOUT_ACK(FIELD, S) \
    FIELD(S, command_type, U8, 1) \
    FIELD(S, command_id, U8, 1) \
    FIELD(S, code, U8, 1)

#define RD_LAYOUT_TIME_REPLY(FIELD, S) \
    FIELD(S, command_id, U8, 1) \
    FIELD(S, receive_uptime_us, U64, 1) \
    FIELD(S, transmit_uptime_us, U64, 1)

#define RD_LAYOUT_EVENT(FIELD, S) \
    FIELD(S, device_time_us, U32, 1) \
    FIELD(S, kind, U8, 1) \
    FIELD(S, value, U16, 1)

#define RD_LAYOUT_GET_INFO(FIELD, S) \
    FIELD(S, command_id, U8, 1)

#define RD_LAYOUT_START(FIELD, S) \
    FIELD(S, command_id, U8, 1) \
    FIELD(S, with_raw_imu, U8, 1)

#define RD_LAYOUT_STOP(FIELD, S) \
    FIELD(S, command_id, U8, 1)

#define RD_LAYOUT_SET_RATE(FIELD, S) \
    FIELD(S, command_id, U8, 1) \
    FIELD(S, rate_hz, U16, 1)

#define RD_LAYOUT_IDENTIFY(FIELD, S) \
    FIELD(S, command_id, U8, 1) \
    FIELD(S, duration_s, U8, 1)

#define RD_LAYOUT_CALIBRATE(FIELD, S) \
    FIELD(S, command_id, U8, 1)

#define RD_LAYOUT_TIME_REQUEST(FIELD, S) \
    FIELD(S, command_id, U8, 1)

#define RD_LAYOUT_MARK(FIELD, S) \
    FIELD(S, command_id, U8, 1) \
    FIELD(S, marker, U16, 1)

#endif
