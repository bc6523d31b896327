"""CAN frames as they were received, and the bytes in which a batch of them is moved and recorded.

A *frame batch* is what one read of a CAN link returned. It is moved, recorded and decoded as bytes, so that the raw
channel of a recording is exactly what the decoder saw::

    header   8 bytes   "CF"  version u8 (1)  width u8 (8 or 64)  count u32
    record   24 + width bytes, count times:
             host_time_ns i64      host's monotonic clock at reception
             interface_time_s f64  the interface's own time stamp, raw; NaN where it has none
             arbitration_id u32    11 or 29 bits
             length u8             bytes of data (of a remote frame: bytes asked for)
             flags u8              bits of FrameFlag
             reserved u16          0
             data                  width bytes, zero behind ``length``

All numbers are little endian. Width is 8 where every frame of the batch is a classic one. Batches may follow each other
directly. Unlike the wire itself, this form belongs to the host alone.
"""

from __future__ import annotations

import enum
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.errors import MalformedPacketError, PacketValueError

FrameArray = npt.NDArray[Any]
"""(n,) structured array with the fields of :data:`RECORD_DTYPES`."""

BATCH_VERSION = 1
CLASSIC_BYTES = 8
FD_BYTES = 64
FD_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""Lengths a CAN FD frame can have, by data length code."""

_MAGIC = b"CF"
BATCH_HEAD = struct.Struct("<2sBBI")
"""Fields before the records of a batch."""
RECORD_HEAD = struct.Struct("<qdIBBH")
"""Fields of a record before its data."""


class FrameFlag(enum.IntFlag):
    """What kind of frame it is."""

    EXTENDED = 0x01  # 29-bit arbitration id
    FD = 0x02
    BITRATE_SWITCH = 0x04
    REMOTE = 0x08
    ERROR = 0x10  # reported by the interface; never on the bus in this form
    SENT = 0x20  # sent by this host, kept for the record


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One CAN frame."""

    arbitration_id: int
    """11 or 29 bits."""
    data: bytes = b""
    """0-8 bytes, 0-64 for CAN FD; empty for a remote frame."""
    flags: FrameFlag = FrameFlag(0)
    """What kind of frame it is."""
    host_time_ns: int = 0
    """Host's monotonic clock at reception, ns; 0 for a frame to be sent."""
    interface_time_s: float = math.nan
    """The interface's own time stamp, s, raw: its origin and meaning depend on the interface."""
    remote_length: int = 0
    """Bytes a remote frame asks for."""

    @property
    def is_fd(self) -> bool:
        """Whether it is a CAN FD frame."""
        return bool(self.flags & FrameFlag.FD)


RECORD_DTYPES = {
    width: np.dtype(
        {
            "names": ["host_time_ns", "interface_time_s", "arbitration_id", "length", "flags", "data", "code"],
            "formats": ["<i8", "<f8", "<u4", "u1", "u1", ("u1", (width,)), "<u8"],
            "offsets": [0, 8, 16, 20, 21, RECORD_HEAD.size, RECORD_HEAD.size],
            "itemsize": RECORD_HEAD.size + width,
        }
    )
    for width in (CLASSIC_BYTES, FD_BYTES)
}
"""Structured type of a record, by width; ``code`` sees the first eight data bytes as one u64."""


def batch_head(width: int, count: int) -> bytes:
    """Return what stands before the records of a batch: of ``count`` frames with room for ``width`` bytes each."""
    return BATCH_HEAD.pack(_MAGIC, BATCH_VERSION, width, count)


def pack_frames(frames: Sequence[CanFrame]) -> bytes:
    """Return the frame batch of some frames.

    Raises
    ------
    PacketValueError
        More data than the frame's kind can carry.
    """
    width = FD_BYTES if any(frame.is_fd or len(frame.data) > CLASSIC_BYTES for frame in frames) else CLASSIC_BYTES
    parts = [batch_head(width, len(frames))]
    for frame in frames:
        limit = FD_BYTES if frame.is_fd else CLASSIC_BYTES
        if len(frame.data) > limit:
            raise PacketValueError(f"{len(frame.data)} bytes do not fit a CAN frame of at most {limit}")
        length = frame.remote_length if frame.flags & FrameFlag.REMOTE else len(frame.data)
        parts.append(
            RECORD_HEAD.pack(frame.host_time_ns, frame.interface_time_s, frame.arbitration_id, length, frame.flags, 0)
        )
        parts.append(frame.data.ljust(width, b"\0"))
    return b"".join(parts)


def frame_array(data: bytes) -> FrameArray:
    """Return the records of one or more frame batches as one structured array (n,), a view where there is one batch.

    Raises
    ------
    MalformedPacketError
        The bytes are not a frame batch: a damaged recording.
    """
    batches = []
    offset = 0
    while offset < len(data):
        if len(data) - offset < BATCH_HEAD.size:
            raise MalformedPacketError("a frame batch is cut in its header")
        magic, version, width, count = BATCH_HEAD.unpack_from(data, offset)
        if magic != _MAGIC or version != BATCH_VERSION or width not in RECORD_DTYPES:
            raise MalformedPacketError("the bytes are not a batch of CAN frames")
        offset += BATCH_HEAD.size
        dtype = RECORD_DTYPES[width]
        if count * dtype.itemsize > len(data) - offset:
            raise MalformedPacketError("a frame batch is cut")
        batches.append(np.frombuffer(data, dtype, count, offset))
        offset += count * dtype.itemsize
    return concatenate_frames(batches)


def concatenate_frames(batches: Sequence[FrameArray]) -> FrameArray:
    """Return several record arrays as one, as wide as the widest."""
    if len(batches) == 1:
        return batches[0]
    if not batches:
        return np.empty(0, RECORD_DTYPES[CLASSIC_BYTES])
    width = max(batch.dtype["data"].shape[0] for batch in batches)
    joined = np.zeros(sum(len(batch) for batch in batches), RECORD_DTYPES[width])
    raw = joined.view("u1").reshape(len(joined), -1)
    row = 0
    for batch in batches:
        if len(batch):
            contiguous = np.ascontiguousarray(batch)
            raw[row : row + len(batch), : batch.dtype.itemsize] = contiguous.view("u1").reshape(len(batch), -1)
        row += len(batch)
    return joined


def unpack_frames(data: bytes) -> list[CanFrame]:
    """Return the frames of one or more frame batches.

    Raises
    ------
    MalformedPacketError
        The bytes are not a frame batch.
    """
    return list(iter_frames(frame_array(data)))


def iter_frames(records: FrameArray) -> Iterator[CanFrame]:
    """Yield the records of a structured array as frames."""
    for record in records:
        flags = FrameFlag(int(record["flags"]))
        length = int(record["length"])
        is_remote = bool(flags & FrameFlag.REMOTE)
        yield CanFrame(
            arbitration_id=int(record["arbitration_id"]),
            data=b"" if is_remote else record["data"].tobytes()[:length],
            flags=flags,
            host_time_ns=int(record["host_time_ns"]),
            interface_time_s=float(record["interface_time_s"]),
            remote_length=length if is_remote else 0,
        )


def fd_padded(data: bytes) -> bytes:
    """Return data filled with zeros to the next length a CAN FD frame can have.

    Raises
    ------
    PacketValueError
        More than 64 bytes.
    """
    for length in FD_LENGTHS:
        if len(data) <= length:
            return data.ljust(length, b"\0")
    raise PacketValueError(f"{len(data)} bytes do not fit a CAN FD frame of at most {FD_BYTES}")
