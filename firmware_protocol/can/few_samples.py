"""A few samples in a row, nothing unusual about them: decoded without the fixed cost of array operations.

A live capture mostly gets one frame at a time, for which numpy's calls cost ten times what they do. Whatever is not
plainly the next sample is left to the arrays; a test holds both ways equal to the last bit.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np

from firmware_protocol.can.frames import CLASSIC_BYTES, FD_BYTES, FrameFlag
from firmware_protocol.can.mapping import WHOLE_ORIENTATION_BYTES
from firmware_protocol.can.numbering import SILENCE_SAMPLES, Numbering
from firmware_protocol.can.timeline import Timeline
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US, OrientationBatch, PacketType
from firmware_protocol.quantization import (
    Q15_MAX_SQUARE,
    Q15_MIN_SQUARE,
    SMALLEST_THREE_BITS,
    SMALLEST_THREE_OFFSET,
    SMALLEST_THREE_SCALE,
)

MAX_QUICK_FRAMES = 8
"""Above it, arrays are faster."""

_RECORD = struct.Struct("<qdIBBHQ")
_HEAD = b"CF\x01" + bytes([CLASSIC_BYTES])
_HEAD_BYTES = 8
_WHOLE_RECORD = struct.Struct("<qdIBBHBBHI4hB")
"""The same, and a whole ORIENTATION: size, type, sequence, device time, quaternion, flags."""
_WHOLE_RECORD_BYTES = 24 + FD_BYTES
_WHOLE_HEAD = b"CF\x01" + bytes([FD_BYTES])
_WHOLE_SIZE = 16
_WHOLE_FLAGS = frozenset({int(FrameFlag.FD), int(FrameFlag.FD | FrameFlag.BITRATE_SWITCH)})
MAX_QUICK_BYTES = _HEAD_BYTES + _WHOLE_RECORD_BYTES * MAX_QUICK_FRAMES
"""Longest frame batch that may be one of a few frames."""
_MASK = (1 << SMALLEST_THREE_BITS) - 1
_MAX_THREE_SQUARE = 0.75
"""A code near the limit is left to the arrays, which judge it."""


def plain_samples(data: bytes, identifier: int) -> list[tuple[int, int]] | None:
    """Return (host time, data as u64) of each frame if all are classic, have this id and 8 bytes; else None."""
    count, rest = divmod(len(data) - _HEAD_BYTES, _RECORD.size)
    if rest or not 0 < count <= MAX_QUICK_FRAMES or data[:4] != _HEAD or data[4:8] != count.to_bytes(4, "little"):
        return None
    found = []
    for host_ns, _, arbitration_id, length, flags, _, code in _RECORD.iter_unpack(data[_HEAD_BYTES:]):
        if arbitration_id != identifier or length != CLASSIC_BYTES or flags:
            return None
        found.append((host_ns, code))
    return found


def whole_samples(data: bytes, identifier: int) -> OrientationBatch | None:
    """Decode the frames of a batch if all are good ORIENTATION packets in CAN FD frames with this id; else None."""
    count, rest = divmod(len(data) - _HEAD_BYTES, _WHOLE_RECORD_BYTES)
    if rest or not 0 < count <= MAX_QUICK_FRAMES or data[:4] != _WHOLE_HEAD or data[4:8] != count.to_bytes(4, "little"):
        return None
    sequences, times, quats, sample_flags = [], [], [], []
    for place in range(_HEAD_BYTES, len(data), _WHOLE_RECORD_BYTES):
        _, _, arbitration_id, length, frame_flags, _, size, kind, sequence, time_us, w, x, y, z, flags = (
            _WHOLE_RECORD.unpack_from(data, place)
        )
        square = w * w + x * x + y * y + z * z
        if (
            arbitration_id != identifier
            or length != WHOLE_ORIENTATION_BYTES
            or frame_flags not in _WHOLE_FLAGS
            or size != _WHOLE_SIZE
            or kind != PacketType.ORIENTATION
            or not Q15_MIN_SQUARE <= square <= Q15_MAX_SQUARE
        ):
            return None
        scale = 1.0 / math.sqrt(square)
        sequences.append(sequence)
        times.append(time_us)
        quats.append((w * scale, x * scale, y * scale, z * scale))
        sample_flags.append(flags)
    return OrientationBatch(
        np.array(sequences, np.uint16), np.array(times, np.uint32), np.array(quats), np.array(sample_flags, np.uint8)
    )


def next_samples(
    frames: Sequence[tuple[int, int]], numbering: Numbering, timeline: Timeline
) -> OrientationBatch | None:
    """Decode frames that are plainly the next samples; None, and nothing changed, where they are not.

    Parameters
    ----------
    frames : sequence of (int, int)
        Host time in ns, and data as u64.
    numbering, timeline
        Where the node stands; the numbering is moved on.
    """
    expected, newest = numbering.expected, timeline.newest
    if expected is None or newest is None:
        return None
    mark_counter, mark_time_us, state_counter, flags, rate_hz = newest
    if expected < mark_counter or expected < state_counter:
        return None
    longest_ns = SILENCE_SAMPLES * 1e9 / rate_hz
    heard_ns = numbering.heard_ns
    quats = []
    for number, (host_ns, code) in enumerate(frames, expected):
        if code & 0xFF != number & 0xFF or host_ns - heard_ns > longest_ns:
            return None
        heard_ns = host_ns
        q_wxyz = _quaternion(code >> 8)
        if q_wxyz is None:
            return None
        quats.append(q_wxyz)
    for host_ns, _ in frames:
        silence_ns = host_ns - numbering.heard_ns
        if silence_ns > numbering.longest_silence_ns:
            numbering.longest_silence_ns = silence_ns
            numbering.given_since_silence = 0
        numbering.given_since_silence += 1
        numbering.heard_ns = host_ns
    numbering.expected = expected + len(frames)
    numbering.newest = expected + len(frames) - 1
    counters = range(expected, expected + len(frames))
    times = [
        (mark_time_us + (2_000_000 * (counter - mark_counter) + rate_hz) // (2 * rate_hz)) % DEVICE_CLOCK_MODULUS_US
        for counter in counters
    ]
    return OrientationBatch(
        np.array([counter & 0xFFFF for counter in counters], np.uint16),
        np.array(times, np.uint32),
        np.array(quats),
        np.full(len(frames), flags, np.uint8),
    )


def _quaternion(code: int) -> list[float] | None:
    a = (code >> 2 * SMALLEST_THREE_BITS & _MASK) - SMALLEST_THREE_OFFSET
    b = (code >> SMALLEST_THREE_BITS & _MASK) - SMALLEST_THREE_OFFSET
    c = (code & _MASK) - SMALLEST_THREE_OFFSET
    q_wxyz = [a / SMALLEST_THREE_SCALE, b / SMALLEST_THREE_SCALE, c / SMALLEST_THREE_SCALE]
    square = q_wxyz[0] * q_wxyz[0] + q_wxyz[1] * q_wxyz[1] + q_wxyz[2] * q_wxyz[2]
    if square > _MAX_THREE_SQUARE or min(a, b, c) <= -SMALLEST_THREE_OFFSET:
        return None
    q_wxyz.insert(code >> 3 * SMALLEST_THREE_BITS, math.sqrt(1.0 - square))
    return q_wxyz
