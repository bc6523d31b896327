"""Packets as CAN frames: arbitration ids, their priorities, and what stands in each frame.

**Arbitration id** (11 bits): bit 10 = whole packet in one CAN FD frame; bits 5-9 = :class:`CanFunction`; bits 0-4 =
node id, 1-31. Lower ids win the bus, so functions stand in order of urgency; node 0 addresses every object (commands
only). 29-bit ids, ids below 0x020 and functions not listed belong to other devices.

**Classic frames.** A packet of at most 8 bytes travels as it is, type byte first (commands, ACK, EVENT). The others:

- ORIENTATION: byte 0 = sample counter modulo 256, bytes 1-7 = 56-bit smallest-three quaternion, little endian (the
  component left out in bits 62-63, then 18 bits each; :mod:`firmware_protocol.quantization`). All ones: the object has
  no orientation just now.
- SAMPLE_STATE: sample counter u32, flags u8, rate u16 Hz, boot tag u8. "From this sample on": the flags of a sample are
  those of the last SAMPLE_STATE, so it is sent whenever they change, and before every TIME that is due.
- TIME: sample counter u32 and the device time u32 µs of the sample with that counter. Sent before that sample, due at
  least every :func:`time_interval` samples, so that the eight bits above are never ambiguous for longer than that.
- STATUS: five frames, byte 0 = page. RAW_IMU: one frame for the gyro and one for the accelerometer.
  TIME_REPLY: one frame for each reading. So everything but INFO needs no flow control, and a listener that never sends
  sees it.
- Longer packets (INFO, and what newer versions add): ISO-TP (ISO 15765-2), normal addressing, in both directions.

**Device time** of a sample between two TIME frames follows from its counter: :func:`sample_times_us`. An object whose
samples leave that grid by more than ``GRID_TOLERANCE_US`` sends another TIME, alone.

**CAN FD frames** (bit 10 set, bit rate switch on) carry whole packets: a length byte, the packet, zeros to the next
length that CAN FD has. TIME and SAMPLE_STATE stay, classic in form, at the same intervals; boots differ in them.
"""

from __future__ import annotations

import binascii
import enum
import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_protocol.errors import PacketValueError
from firmware_protocol.packets import MAX_RATE_HZ, MIN_RATE_HZ

MIN_NODE = 1
MAX_NODE = 31
ALL_NODES = 0
"""Node id of a command for every object."""
NODE_BITS = 5
NODE_MASK = (1 << NODE_BITS) - 1
FUNCTION_MASK = 0x1F
FD_BIT = 0x400
"""Set in the arbitration id of a frame that carries a whole packet (CAN FD)."""
WHOLE = FD_BIT >> NODE_BITS
"""The same bit in bits 5-10, where the function stands."""

COUNTER_MODULUS = 2**32
"""The sample counter of TIME wraps after this many samples (49.7 days at 1000 Hz)."""
SEQUENCE_MODULUS = 256
"""The counter's part in every ORIENTATION frame."""
TIME_FRAMES_PER_S = 5
MAX_TIME_INTERVAL = 64
"""Samples between TIME frames at high rates: a quarter of what the eight bits can distinguish."""
GRID_TOLERANCE_US = 1
"""Device time of a sample, as the host computes it, is exact within this; exactly right where the rate divides 10^6."""


class CanFunction(enum.IntEnum):
    """What a frame is for: bits 5-9 of its arbitration id. The lower, the more urgent."""

    COMMAND = 1  # host -> object
    ACK = 2
    TIME_REPLY_RECEIVE = 3  # CAN FD: the whole TIME_REPLY
    TIME_REPLY_TRANSMIT = 4
    EVENT = 5
    SAMPLE_STATE = 8
    TIME = 9
    ORIENTATION = 12
    STATUS = 16
    RAW_GYRO = 20  # CAN FD: the whole RAW_IMU
    RAW_ACCELERATION = 21
    LONG_TO_OBJECT = 24  # ISO-TP, and flow control for LONG_FROM_OBJECT
    LONG_FROM_OBJECT = 25  # ISO-TP, and flow control for LONG_TO_OBJECT


HOST_FUNCTIONS = frozenset({CanFunction.COMMAND, CanFunction.LONG_TO_OBJECT})
"""Functions of frames that the host sends."""

EXACT_LENGTHS: dict[CanFunction, int] = {
    CanFunction.TIME_REPLY_RECEIVE: 8,
    CanFunction.TIME_REPLY_TRANSMIT: 8,
    CanFunction.SAMPLE_STATE: 8,
    CanFunction.TIME: 8,
    CanFunction.ORIENTATION: 8,
    CanFunction.STATUS: 8,
    CanFunction.RAW_GYRO: 7,
    CanFunction.RAW_ACCELERATION: 7,
}
"""Lengths of classic frames; the others carry packets as they are, 1-8 bytes."""
NO_ORIENTATION = (1 << 56) - 1
"""Quaternion bits of an object whose filter failed: three components that no unit quaternion has, so it is rejected."""
WHOLE_ORIENTATION_BYTES = 20
"""Length byte, 16 bytes of ORIENTATION, 3 zeros."""


@dataclass(frozen=True, slots=True)
class CanId:
    """An arbitration id of this protocol, parsed."""

    function: CanFunction
    node: int
    """0-31."""
    whole_packet: bool = False
    """Whether the frame is a CAN FD one with a whole packet."""


def arbitration_id(function: CanFunction, node: int, whole_packet: bool = False) -> int:
    """Return the 11-bit id of a frame.

    Raises
    ------
    PacketValueError
        The node is not 0-31.
    """
    if not ALL_NODES <= node <= MAX_NODE:
        raise PacketValueError(f"node id {node} is not from {MIN_NODE} to {MAX_NODE}")
    return (FD_BIT if whole_packet else 0) | int(function) << NODE_BITS | node


def split_id(identifier: int) -> CanId | None:
    """Return an 11-bit id parsed; None where it is not one of this protocol."""
    try:
        function = CanFunction(identifier >> NODE_BITS & FUNCTION_MASK)
    except ValueError:
        return None
    if not 0 <= identifier < 2048:
        return None
    return CanId(function, identifier & NODE_MASK, bool(identifier & FD_BIT))


def time_interval(rate_hz: int) -> int:
    """Return after how many samples the next TIME frame is due: a power of two, at most ``MAX_TIME_INTERVAL``.

    There are at least ``TIME_FRAMES_PER_S`` a second; TIME stands before each sample whose counter is a multiple.
    """
    interval = 1
    while interval * 2 <= min(MAX_TIME_INTERVAL, rate_hz // TIME_FRAMES_PER_S):
        interval *= 2
    return interval


def sample_times_us(
    counter: npt.NDArray[np.int64], anchor_counter: npt.ArrayLike, anchor_time_us: npt.ArrayLike, rate_hz: npt.ArrayLike
) -> npt.NDArray[np.int64]:
    """Return the device time of samples, µs, not wrapped: anchor + round((counter - anchor counter) * 10^6 / rate).

    Parameters
    ----------
    counter : (n,) int64
        Sample counters.
    anchor_counter, anchor_time_us : (n,) or scalar
        Of a TIME frame.
    rate_hz : (n,) or scalar
        Samples per second between the anchor and the sample.
    """
    rate = np.asarray(rate_hz, dtype=np.int64)
    steps = (counter - np.asarray(anchor_counter, dtype=np.int64)) * 1_000_000
    return np.asarray(np.asarray(anchor_time_us, dtype=np.int64) + (2 * steps + rate) // (2 * rate), dtype=np.int64)


def boot_tag(device_id: int, boot_id: int) -> int:
    """Return eight bits that differ between objects and between boots, but for one pair in 255; never 0.

    0 means that the object does not know its own identity.
    """
    crc = binascii.crc_hqx(struct.pack("<QI", device_id, boot_id), 0xFFFF)
    return crc % 255 + 1


def time_data(counter: int, device_time_us: int) -> bytes:
    """Return the eight bytes of TIME: the sample with this counter was measured at this device time, µs, wrapped."""
    return struct.pack("<II", counter % COUNTER_MODULUS, device_time_us)


def sample_state_data(counter: int, flags: int, rate_hz: int, tag: int) -> bytes:
    """Return the eight bytes of SAMPLE_STATE: from the sample with this counter on, flags, rate and boot tag hold.

    Raises
    ------
    PacketValueError
        The rate is out of range.
    """
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise PacketValueError(f"rate {rate_hz} Hz is not from {MIN_RATE_HZ} to {MAX_RATE_HZ}")
    return struct.pack("<IBHB", counter % COUNTER_MODULUS, flags, rate_hz, tag)


def orientation_data(counter: int, code: int) -> bytes:
    """Return the eight bytes of a classic ORIENTATION frame: the counter's low eight bits, the quaternion's code."""
    return (code << 8 | counter % SEQUENCE_MODULUS).to_bytes(8, "little")


STATUS_PAGES = 5
"""Frames of one classic STATUS, sent one behind the other."""


def status_pages(values: tuple[int, ...]) -> tuple[bytes, ...]:
    """Return the classic frames of a STATUS from its wire values.

    The two u64 travel as 56 bits: 2283 years of microseconds.
    """
    uptime, state, produced, dropped, battery, temperature, bias_x, bias_y, bias_z, errors = values
    return (
        b"\x00" + (uptime & (1 << 56) - 1).to_bytes(7, "little"),
        b"\x01" + (produced & (1 << 56) - 1).to_bytes(7, "little"),
        struct.pack("<BIBH", 2, dropped, state, errors),
        struct.pack("<BHhhB", 3, battery, temperature, bias_x, 0),
        struct.pack("<BhhBH", 4, bias_y, bias_z, 0, 0),
    )


def status_values(pages: tuple[bytes, ...]) -> tuple[int, ...]:
    """Return the wire values of a STATUS from its five classic frames; the opposite of :func:`status_pages`."""
    _, dropped, state, errors = struct.unpack("<BIBH", pages[2])
    _, battery, temperature, bias_x, _ = struct.unpack("<BHhhB", pages[3])
    _, bias_y, bias_z, _, _ = struct.unpack("<BhhBH", pages[4])
    uptime = int.from_bytes(pages[0][1:8], "little")
    produced = int.from_bytes(pages[1][1:8], "little")
    return uptime, state, produced, dropped, battery, temperature, bias_x, bias_y, bias_z, errors


IMU_LAYOUT = struct.Struct("<B3h")
"""Classic RAW_GYRO and RAW_ACCELERATION: sequence (low eight bits), x, y, z."""


def reading_data(command_id: int, uptime_us: int) -> bytes:
    """Return the eight bytes of TIME_REPLY_RECEIVE or TIME_REPLY_TRANSMIT: command id u8, device clock 56 bits."""
    return bytes([command_id]) + (uptime_us & (1 << 56) - 1).to_bytes(7, "little")
