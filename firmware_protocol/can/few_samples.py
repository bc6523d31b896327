"""A few samples in a row, nothing unusual about them: decoded without the fixed cost of array operations.

A live capture mostly gets one frame at a time, for which numpy's calls cost ten times what they do. Whatever is not
plainly the next sample is left to the arrays; a test holds both ways equal to the last bit.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np

from firmware_protocol.can.frames import BATCH_HEAD, CLASSIC_BYTES, FD_BYTES, RECORD_HEAD, FrameFlag, batch_head
from firmware_protocol.can.mapping import WHOLE_ORIENTATION_BYTES
from firmware_protocol.can.numbering import SILENCE_SAMPLES, Numbering
from firmware_protocol.can.timeline import Timeline
from firmware_protocol.codec import STREAMED
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US, OrientationBatch, PacketType
from firmware_protocol.quantization import (
    Q15_MAX_SQUARE,
    Q15_MIN_SQUARE,
    SMALLEST_THREE_BITS,
    SMALLEST_THREE_OFFSET,
    SMALLEST_THREE_SCALE,
)

MAX_FAST_FRAMES = 8
"""Above it, arrays are faster."""

_PACKET = STREAMED[PacketType.ORIENTATION]
_RECORD = struct.Struct(RECORD_HEAD.format + "Q")
_WHOLE_RECORD = struct.Struct(RECORD_HEAD.format + "B" + _PACKET.format.lstrip("<"))
"""The head, and a whole ORIENTATION behind its length byte."""
_WHOLE_RECORD_BYTES = RECORD_HEAD.size + FD_BYTES
_COUNTS = range(1, MAX_FAST_FRAMES + 1)
_CLASSIC_HEADS = {BATCH_HEAD.size + n * _RECORD.size: batch_head(CLASSIC_BYTES, n) for n in _COUNTS}
"""Length of a batch of 1 to 8 classic frames -> its head."""
_FD_HEADS = {BATCH_HEAD.size + n * _WHOLE_RECORD_BYTES: batch_head(FD_BYTES, n) for n in _COUNTS}
"""The same for CAN FD frames."""
MAX_FAST_BYTES = max(_FD_HEADS)
"""Longest frame batch that may be one of a few frames."""
_FD_FLAGS = frozenset({int(FrameFlag.FD), int(FrameFlag.FD | FrameFlag.BITRATE_SWITCH)})
_MASK = (1 << SMALLEST_THREE_BITS) - 1
_MAX_THREE_SQUARE = 0.75
"""A code near the limit is left to the arrays, which judge it."""


def plain_samples(data: bytes, identifier: int) -> list[tuple[int, int]] | None:
    """Return (host time, data as u64) of each frame if all are classic, have this id and 8 bytes; else None."""
    if data[: BATCH_HEAD.size] != _CLASSIC_HEADS.get(len(data)):
        return None
    found = []
    for host_ns, _, arbitration_id, length, flags, _, code in _RECORD.iter_unpack(data[BATCH_HEAD.size :]):
        if arbitration_id != identifier or length != CLASSIC_BYTES or flags:
            return None
        found.append((host_ns, code))
    return found


def whole_samples(data: bytes, identifier: int) -> OrientationBatch | None:
    """Decode the frames of a batch if all are good ORIENTATION packets in CAN FD frames with this id; else None."""
    if data[: BATCH_HEAD.size] != _FD_HEADS.get(len(data)):
        return None
    sequences, times, quats, sample_flags = [], [], [], []
    for place in range(BATCH_HEAD.size, len(data), _WHOLE_RECORD_BYTES):
        _, _, arbitration_id, length, frame_flags, _, size, kind, sequence, time_us, w, x, y, z, flags = (
            _WHOLE_RECORD.unpack_from(data, place)
        )
        square = w * w + x * x + y * y + z * z
        if (
            arbitration_id != identifier
            or length != WHOLE_ORIENTATION_BYTES
            or frame_flags not in _FD_FLAGS
            or size != _PACKET.size
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
    numbering, timeline : Numbering, Timeline
        Where the object stands; the numbering is moved on.
    """
    expected, newest = numbering.expected, timeline.newest
    if expected is None or newest is None:
        return None
    mark_counter, mark_time_us, state_counter, flags, rate_hz = newest
    if expected < mark_counter or expected < state_counter:
        return None
    longest_ns = SILENCE_SAMPLES * 1e9 / rate_hz
    heard_ns = numbering.silence.heard_ns
    quats = []
    for number, (host_ns, code) in enumerate(frames, expected):
        if code & 0xFF != number & 0xFF or host_ns - heard_ns > longest_ns:
            return None
        heard_ns = host_ns
        q_wxyz = _quaternion(code >> 8)
        if q_wxyz is None:
            return None
        quats.append(q_wxyz)
    numbering.deliver_next(host_ns for host_ns, _ in frames)
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
