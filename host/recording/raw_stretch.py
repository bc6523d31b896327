"""Chunks of a byte link put end to end, with where each ends and when it came: a recording read many chunks at a time.

A chunk of one sample costs as much as one of a hundred, and a recording of a link at 1 kHz is made of such chunks. In a
stretch they are checked, joined and decoded together, and nothing is lost: every byte's time of reception is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from host.recording import format as fmt
from host.recording.record_runs import MESSAGE_HEAD_BYTES
from host.recording.ros_message import CDR_LITTLE_ENDIAN
from host.recording.row_checksums import checksums
from host.transports.chunks import AnyChunk, Chunk

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]

FEW_LENGTHS = 32
"""From so many chunks of each length on they are joined length by length, not one by one."""
_BODY = MESSAGE_HEAD_BYTES
_HEAD = np.dtype(
    {
        "names": ["encapsulation", "host_time_ns", "crc32", "kind", "length"],
        "formats": ["<u4", "<i8", "<u4", "u1", "<u4"],
        "offsets": [0, 4, 12, 16, 20],
        "itemsize": fmt.RAW_HEAD_BYTES,
    }
)
_ENCAPSULATION = int.from_bytes(CDR_LITTLE_ENDIAN, "little")


@dataclass(frozen=True, slots=True, eq=False)
class RawStretch:
    """m chunks of a byte link, none of them empty, in order."""

    data: bytes
    """All their bytes."""
    stops: IntArray
    """(m,) where in ``data`` each chunk ends."""
    host_time_ns: IntArray
    """(m,) reception of each, monotonic."""

    @classmethod
    def of(cls, chunks: list[AnyChunk]) -> RawStretch:
        """Put chunks end to end."""
        sizes = np.array([len(chunk.data) for chunk in chunks], dtype=np.int64)
        times_ns = np.array([chunk.host_time_ns for chunk in chunks], dtype=np.int64)
        return cls(b"".join(chunk.data for chunk in chunks), np.cumsum(sizes), times_ns)

    def chunks(self) -> Iterator[Chunk]:
        """Give the chunks one by one again."""
        start = 0
        for stop, host_time_ns in zip(self.stops.tolist(), self.host_time_ns.tolist(), strict=True):
            yield Chunk(self.data[start:stop], host_time_ns)
            start = stop


def raw_stretches(
    view: memoryview, starts: IntArray, ends: IntArray
) -> Iterator[RawStretch | AnyChunk | fmt.DamagedMessageError]:
    """Read the raw messages of a block of a recording.

    Parameters
    ----------
    view : memoryview
        The block.
    starts, ends : (n,) int64
        Where these messages begin and end, without the head of their records; all are on the channel of what was
        received.

    Yields
    ------
    RawStretch, AnyChunk or DamagedMessageError
        In order: chunks of bytes together; those of CAN frames, and empty ones, by themselves; and what is wrong with a
        message that is left out.
    """
    good, heads = _good(view, starts, ends)
    first = 0
    for index in [*np.flatnonzero(~good).tolist(), len(starts)]:
        if index > first:
            part = slice(first, index)
            yield _stretch(view, starts[part] + (_BODY + fmt.RAW_HEAD_BYTES), heads[part].view(_HEAD)[:, 0])
        if index < len(starts):
            try:
                yield fmt.decode_raw(bytes(view[starts[index] + _BODY : ends[index]]))
            except fmt.DamagedMessageError as error:
                yield error
        first = index + 1


def _overlapping(view: memoryview, dtype: np.dtype[np.void]) -> npt.NDArray[np.void]:
    """See a block as records that begin at every byte: indexing it copies each record in one go."""
    return np.ndarray((max(len(view) - dtype.itemsize + 1, 0),), dtype, view, strides=(1,))


def _rows(view: memoryview, starts: IntArray, length: int) -> ByteArray:
    gathered = _overlapping(view, np.dtype((np.void, length)))[starts]
    return gathered.view(np.uint8).reshape(-1, length)


def _good(view: memoryview, starts: IntArray, ends: IntArray) -> tuple[BoolArray, ByteArray]:
    """Tell which messages are undamaged chunks of bytes; and give the heads (n, head) of all long enough for one."""
    sizes = ends - starts - _BODY
    good = np.zeros(len(starts), np.bool_)
    heads = np.zeros((len(starts), fmt.RAW_HEAD_BYTES), np.uint8)
    lengths = np.flatnonzero(np.bincount(sizes)).tolist()
    for length in lengths:
        if length > fmt.RAW_HEAD_BYTES:
            chosen = np.flatnonzero(sizes == length) if len(lengths) > 1 else slice(None)
            messages = _rows(view, starts[chosen] + _BODY, length)
            head = messages[:, : fmt.RAW_HEAD_BYTES]
            heads[chosen] = head
            good[chosen] = _are_good(messages, np.ascontiguousarray(head).view(_HEAD)[:, 0])
    return good, heads


def _are_good(messages: ByteArray, heads: npt.NDArray[np.void]) -> BoolArray:
    checked = [messages[:, place] for place in (slice(4, 12), slice(16, 17), slice(fmt.RAW_HEAD_BYTES, None))]
    good: BoolArray = (
        (heads["encapsulation"] == _ENCAPSULATION)
        & (heads["length"] == messages.shape[1] - fmt.RAW_HEAD_BYTES)
        & (heads["kind"] == fmt.BYTES_KIND)
        & (heads["host_time_ns"] >= 0)
        & (checksums(np.concatenate(checked, axis=1)) == heads["crc32"])
    )
    return good


def _stretch(view: memoryview, data_starts: IntArray, heads: npt.NDArray[np.void]) -> RawStretch:
    sizes = heads["length"].astype(np.int64)
    stops = np.cumsum(sizes)
    return RawStretch(_joined(view, data_starts, sizes, stops), stops, heads["host_time_ns"].copy())


def _joined(view: memoryview, starts: IntArray, sizes: IntArray, stops: IntArray) -> bytes:
    lengths = np.flatnonzero(np.bincount(sizes)).tolist()
    if len(lengths) == 1:
        return _rows(view, starts, lengths[0]).tobytes()
    if len(lengths) * FEW_LENGTHS > len(sizes):
        places = zip(starts.tolist(), (starts + sizes).tolist(), strict=True)
        return b"".join([view[start:stop] for start, stop in places])
    data = bytearray(int(stops[-1]))
    for length in lengths:
        chosen = np.flatnonzero(sizes == length)
        dtype = np.dtype((np.void, length))
        target = _overlapping(memoryview(data), dtype)
        target[stops[chosen] - length] = _overlapping(view, dtype)[starts[chosen]]
    return bytes(data)
