"""Many ORIENTATION frames at once, as numpy arrays: the same results as one by one, some thirty times as fast.

A block of bytes is split at its delimiters. The pieces of the commonest length become columns, one array per
byte position, so that COBS and CRC become a few operations per position on all frames together. Whatever is not an
ORIENTATION frame of that length is handed back for the slow path, with its place among the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.codec import ORIENTATION_DTYPE
from firmware_protocol.packets import Orientation, OrientationBatch, PacketType
from firmware_protocol.quantization import Q15_MAX_SQUARE, Q15_MIN_SQUARE
from firmware_protocol.serial.framing import CRC_BYTES, CRC_INITIAL
from firmware_protocol.serial.overlapping import overlapping

ByteArray = npt.NDArray[np.uint8]
IntArray = npt.NDArray[np.int64]

BLOCK_BYTES = 1 << 19
"""Bytes handled together: enough to drown numpy's cost per call, few enough to stay in the second-level cache."""
SAMPLED_EVERY = 31
"""The commonest length is that of every so many pieces; odd, because every other piece is empty, between two zeros."""
FEW_PACKETS = 3000
"""Up to so many packets a table for their CRC is faster than shifts. Measured."""
ORIENTATION_BYTES = ORIENTATION_DTYPE.itemsize
SHORTEST_PIECE = ORIENTATION_BYTES + CRC_BYTES + 1
LONGEST_PIECE = SHORTEST_PIECE + 32
"""ORIENTATION of a newer minor version may be longer; beyond this the frames are read one by one."""
_FIELDS = dict(ORIENTATION_DTYPE.fields or {})
_SEQUENCE, _TIME, _Q, _FLAGS = (_FIELDS[name][1] for name in ("sequence", "device_time_us", "q", "flags"))
"""Rows of the columns of a packet at which its fields start."""

_SET_SEQUENCE, _SET_TIME, _SET_QUATS, _SET_FLAGS = (
    vars(OrientationBatch)[name].__set__ for name in ("sequence", "device_time_us", "quats_wxyz", "flags")
)


def new_batch(
    sequence: npt.NDArray[np.uint16],
    device_time_us: npt.NDArray[np.uint32],
    quats_wxyz: npt.NDArray[np.float64],
    flags: npt.NDArray[np.uint8],
) -> OrientationBatch:
    """Return the batch of these arrays, without the constructor: a frozen dataclass's is half as fast.

    Live, when each read brings one sample, that is a good part of the sample's cost.
    """
    batch = object.__new__(OrientationBatch)
    _SET_SEQUENCE(batch, sequence)
    _SET_TIME(batch, device_time_us)
    _SET_QUATS(batch, quats_wxyz)
    _SET_FLAGS(batch, flags)
    return batch


class SampleArrays:
    """Growing arrays of samples, allocated once for the most that so many bytes can hold.

    Parameters
    ----------
    n_bytes : int
        Bytes of pieces, delimiters included, that will be decoded into these arrays.
    located : bool
        Whether the place of each sample is wanted.
    """

    def __init__(self, n_bytes: int, *, located: bool = False) -> None:
        capacity = n_bytes // (SHORTEST_PIECE + 1) + 1
        self.sequence = np.empty(capacity, dtype=np.uint16)
        self.device_time_us = np.empty(capacity, dtype="<u4")
        self.quats_wxyz = np.empty((capacity, 4), dtype=np.float64)
        self.flags = np.empty(capacity, dtype=np.uint8)
        self.ends = np.empty(capacity, dtype=np.int64) if located else None
        """Where the delimiter behind each sample stands in the bytes; None where not wanted."""
        self.n = 0
        """Samples held."""

    def insert(self, positions: list[int], samples: list[Orientation], ends: list[int]) -> None:
        """Insert samples, and where their frames end, in front of those at ``positions`` now (ascending)."""
        first = positions[0]
        places = np.array(positions) - first
        columns: list[tuple[npt.NDArray[Any], list[Any]]] = [
            (self.sequence, [sample.sequence for sample in samples]),
            (self.device_time_us, [sample.device_time_us for sample in samples]),
            (self.quats_wxyz, [sample.q_wxyz for sample in samples]),
            (self.flags, [int(sample.flags) for sample in samples]),
        ]
        if self.ends is not None:
            columns.append((self.ends, ends))
        for array, values in columns:
            moved = np.insert(array[first : self.n], places, np.array(values, dtype=array.dtype), axis=0)
            array[first : self.n + len(samples)] = moved
        self.n += len(samples)

    def batch(self) -> OrientationBatch:
        """Return the samples held as a batch, without copying."""
        return new_batch(
            self.sequence[: self.n], self.device_time_us[: self.n], self.quats_wxyz[: self.n], self.flags[: self.n]
        )


@dataclass(frozen=True)
class BlockReport:
    """What became of one block, apart from the samples."""

    delimiters: int
    """0x00 bytes."""
    frames: int
    """Frames of good samples of the common length."""
    frame_bytes: int
    """Bytes inside these frames."""
    extended: int
    """Of the samples, those with fields of a newer minor version."""
    others: list[tuple[int, bytes, int]]
    """All other pieces, in order: the number of the sample each stands in front of, its bytes, its end."""


def block_end(pieces: bytes, start: int) -> int:
    """Return where the block from ``start`` ends: at a delimiter, after some ``BLOCK_BYTES``, or with all."""
    if len(pieces) - start < 1.5 * BLOCK_BYTES:  # a short rest would cost as many calls as a block
        return len(pieces)
    end = pieces.rfind(b"\0", start, start + BLOCK_BYTES) + 1
    return end or pieces.index(b"\0", start) + 1


def _columns(block: memoryview, starts: IntArray, length: int) -> ByteArray:
    """Return the bytes of n pieces of one length as (length, n)."""
    rows = overlapping(block, length)[starts].view(np.uint8).reshape(-1, length)
    return np.ascontiguousarray(rows.T)


def _uncobs(columns: ByteArray) -> npt.NDArray[np.bool_]:
    """Undo COBS in place on (length, n): the data is in rows 1 and on. Return which pieces were COBS.

    A code is the distance to the next code. A code that points past the end leaves the pointer where no row is. So does
    one whose sum overflows, because it then points backwards.
    """
    pointer = columns[0].copy()
    code = np.empty_like(pointer)
    for row in range(1, len(columns)):
        column = columns[row]
        np.multiply(column, pointer == row, out=code)
        np.bitwise_xor(column, code, out=column)  # where a code stood, a zero
        np.add(pointer, code, out=pointer)
    is_cobs: npt.NDArray[np.bool_] = pointer == len(columns)
    return is_cobs


def crc_columns(columns: ByteArray) -> tuple[ByteArray, ByteArray]:
    """Return the CRC-16/CCITT-FALSE of n packets of one length, columns (length, n): low and high bytes (n,)."""
    length, n = columns.shape
    if n <= FEW_PACKETS and length % 2 == 0 and length:
        return _crc_by_words(columns)
    return _crc_by_bytes(columns)


@cache
def _word_table() -> npt.NDArray[np.uint16]:
    """Return the CRC register after two more bytes, by the register exclusive-or those bytes."""
    table = np.arange(1 << 16, dtype=np.uint16)
    for _ in range(16):
        table = np.where(table & 0x8000, table << 1 ^ 0x1021, table << 1).astype(np.uint16)
    return table


def _crc_by_words(columns: ByteArray) -> tuple[ByteArray, ByteArray]:
    """Compute two bytes a step by a table: the fewest numpy calls, which is what a few hundred packets cost."""
    words = np.multiply(columns[0::2], 256, dtype=np.uint16)
    np.bitwise_or(words, columns[1::2], out=words)
    table = _word_table()
    crc = np.full(columns.shape[1], CRC_INITIAL, dtype=np.uint16)
    for word in words:
        crc = table[np.bitwise_xor(crc, word, out=word)]
    return (crc & 0xFF).astype(np.uint8), (crc >> 8).astype(np.uint8)


def _crc_by_bytes(columns: ByteArray) -> tuple[ByteArray, ByteArray]:
    """Compute one step per byte position by shifts alone, no table: the fastest where packets are many.

    With x = high ⊕ byte and x ⊕= x >> 4, the new CRC is (low << 8) ⊕ (x << 12) ⊕ (x << 5) ⊕ x. numpy multiplies and
    divides bytes several times as fast as it shifts them.
    """
    n = columns.shape[1]
    high = np.full(n, CRC_INITIAL >> 8, dtype=np.uint8)
    low = np.full(n, CRC_INITIAL & 0xFF, dtype=np.uint8)
    x = np.empty(n, dtype=np.uint8)
    shifted = np.empty(n, dtype=np.uint8)
    for column in columns:
        np.bitwise_xor(high, column, out=x)
        np.floor_divide(x, 16, out=shifted)
        np.bitwise_xor(x, shifted, out=x)
        np.multiply(x, 16, out=shifted)
        np.bitwise_xor(low, shifted, out=high)
        np.floor_divide(x, 8, out=shifted)
        np.bitwise_xor(high, shifted, out=high)
        np.multiply(x, 32, out=shifted)
        np.bitwise_xor(x, shifted, out=low)
    return low, high


def decode_block(block: memoryview, samples: SampleArrays, offset: int = 0) -> BlockReport:
    """Append the samples in a block of whole pieces, each ended by its delimiter, to ``samples``.

    Parameters
    ----------
    block : memoryview
        The bytes of the pieces.
    samples : SampleArrays
        Where the samples go.
    offset : int
        Where the block starts in all bytes; ends are counted from there.
    """
    ends = np.flatnonzero(np.frombuffer(block, dtype=np.uint8) == 0)
    lengths = ends.copy()
    lengths[1:] -= ends[:-1] + 1
    # Only pieces of one length can become columns: the commonest that ORIENTATION can have.
    counts = np.bincount(lengths[::SAMPLED_EVERY], minlength=LONGEST_PIECE + 1)
    length = SHORTEST_PIECE + int(np.argmax(counts[SHORTEST_PIECE : LONGEST_PIECE + 1]))
    grouped = lengths == length
    pieces = np.flatnonzero(grouped)
    starts = ends[pieces] - length

    columns = _columns(block, starts, length)
    is_cobs = _uncobs(columns)
    packets = columns[1:-CRC_BYTES]
    low, high = crc_columns(packets)
    is_orientation = packets[0] == int(PacketType.ORIENTATION)  # with the enum, bytes are compared as wide integers
    is_sample = (low == columns[-2]) & (high == columns[-1]) & is_cobs & is_orientation
    if is_sample.all():
        sample_pieces = pieces
    else:
        good = np.flatnonzero(is_sample)
        packets = packets.take(good, axis=1)
        sample_pieces = pieces[good]
    components = [_int16(packets, row) for row in range(_Q, _Q + 8, 2)]
    square = _square(components)
    in_range = (square >= Q15_MIN_SQUARE) & (square <= Q15_MAX_SQUARE)
    if not in_range.all():
        packets = packets[:, in_range]
        sample_pieces = sample_pieces[in_range]
        square = square[in_range]
        components = [component[in_range] for component in components]

    first = samples.n
    _append(samples, packets, components, square)
    if samples.ends is not None:
        np.add(ends[sample_pieces], offset, out=samples.ends[first : samples.n])

    # All that is not a good sample goes back, with its place: other packets, other lengths, damage.
    left_over = lengths > 0
    left_over[sample_pieces] = False
    other = np.flatnonzero(left_over)
    before = first + np.searchsorted(sample_pieces, other)
    others = [
        (position, bytes(block[end - size : end]), end + offset)
        for position, end, size in zip(before.tolist(), ends[other].tolist(), lengths[other].tolist(), strict=True)
    ]
    n = len(square)
    return BlockReport(len(ends), n, n * length, n if length > SHORTEST_PIECE else 0, others)


def _append(
    samples: SampleArrays, packets: ByteArray, components: list[npt.NDArray[np.int16]], square: npt.NDArray[np.uint32]
) -> None:
    """Append n samples: packets as columns (16, n), the quaternion's components, the sum of their squares (n,)."""
    n = len(square)
    first = samples.n
    last = samples.n = first + n
    samples.sequence[first:last] = _int16(packets, _SEQUENCE).view(np.uint16)
    times = samples.device_time_us[first:last].view(np.uint8).reshape(n, 4)
    for k in range(4):
        times[:, k] = packets[_TIME + k]
    samples.flags[first:last] = packets[_FLAGS]
    scale = 1.0 / np.sqrt(square.astype(np.float64))
    for k in range(4):
        np.multiply(components[k], scale, out=samples.quats_wxyz[first:last, k])


def _int16(packets: ByteArray, row: int) -> npt.NDArray[np.int16]:
    values: npt.NDArray[np.uint16] = packets[row + 1].astype(np.uint16)
    np.multiply(values, 256, out=values)
    np.bitwise_or(values, packets[row], out=values)
    return values.view(np.int16)


def _square(components: list[npt.NDArray[np.int16]]) -> npt.NDArray[np.uint32]:
    """Return the sum of squares, exact: only four times -32768 overflows, to a zero that no norm allows."""
    total = np.zeros(len(components[0]), dtype=np.uint32)
    for component in components:
        wide = component.astype(np.int32)
        np.multiply(wide, wide, out=wide)
        np.add(total, wide.view(np.uint32), out=total)
    return total
