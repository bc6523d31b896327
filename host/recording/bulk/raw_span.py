"""Chunks of a byte link put end to end, with where each ends and when it came: a recording read many chunks at a time.

A chunk of one sample costs as much as one of a hundred, and a recording of a link at 1 kHz is made of such chunks. In a
span they are checked, joined and decoded together, and nothing is lost: every byte's time of reception is known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_protocol.serial.overlapping import overlapping
from host.links.transport import AnyChunk, Chunk
from host.recording import format as fmt
from host.recording.bulk.record_runs import MESSAGE_HEAD_BYTES
from host.recording.bulk.row_checksums import checksums
from host.recording.cdr import CDR_LITTLE_ENDIAN

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LONGEST_TOGETHER = 800
"""Chunks of different lengths up to this are joined together, longer ones one by one. Measured."""
MOST_TOGETHER = 4096
"""So many at a time: bounds the memory, and stays in the cache."""
_BODY = MESSAGE_HEAD_BYTES
_DATA = _BODY + fmt.RAW_HEAD_BYTES
_HEAD = np.dtype(
    {
        "names": ["encapsulation", "host_time_ns", "crc32", "kind", "length"],
        "formats": ["<u4", "<i8", "<u4", "u1", "<u4"],
        "offsets": [0, 4, 12, 16, 20],
        "itemsize": fmt.RAW_HEAD_BYTES,
    }
)
_CHECKED = np.dtype([("host_time_ns", "<i8"), ("kind", "u1")])
"""What the checksum is of, but for the data."""
_ENCAPSULATION = int.from_bytes(CDR_LITTLE_ENDIAN, "little")


@dataclass(frozen=True, slots=True, eq=False)
class RawSpan:
    """m chunks of a byte link, none of them empty, in order."""

    data: bytes
    """All their bytes."""
    stops: IntArray
    """(m,) where in ``data`` each chunk ends."""
    host_time_ns: IntArray
    """(m,) reception of each, monotonic."""

    @classmethod
    def of(cls, chunks: list[AnyChunk]) -> RawSpan:
        """Put chunks end to end."""
        sizes = np.array([len(chunk.data) for chunk in chunks], dtype=np.int64)
        times_ns = np.array([chunk.host_time_ns for chunk in chunks], dtype=np.int64)
        return cls(b"".join(chunk.data for chunk in chunks), np.cumsum(sizes), times_ns)

    def chunks(self) -> Iterator[Chunk]:
        """Return the chunks one by one again."""
        start = 0
        for stop, host_time_ns in zip(self.stops.tolist(), self.host_time_ns.tolist(), strict=True):
            yield Chunk(self.data[start:stop], host_time_ns)
            start = stop


def raw_spans(
    view: memoryview, starts: IntArray, ends: IntArray
) -> Iterator[RawSpan | AnyChunk | fmt.DamagedMessageError]:
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
    RawSpan, AnyChunk or DamagedMessageError
        In order: chunks of bytes together; those of CAN frames, and empty ones, by themselves; and what is wrong with a
        message that is left out.
    """
    good, heads = _good(view, starts, ends)
    first = 0
    for index in [*np.flatnonzero(~good).tolist(), len(starts)]:
        if index > first:
            part = slice(first, index)
            sizes = ends[part] - starts[part] - _DATA
            stops = np.cumsum(sizes)
            data = _joined(view, starts[part] + _DATA, sizes, stops)
            yield RawSpan(data, stops, heads["host_time_ns"][part].copy())
        if index < len(starts):
            try:
                yield fmt.decode_raw(bytes(view[starts[index] + _BODY : ends[index]]))
            except fmt.DamagedMessageError as error:
                error.at = int(starts[index])
                yield error
        first = index + 1


def _good(view: memoryview, starts: IntArray, ends: IntArray) -> tuple[BoolArray, npt.NDArray[np.void]]:
    """Return which messages are undamaged chunks of bytes; and the head of each, of any bytes for one too short."""
    places = np.minimum(starts + _BODY, len(view) - fmt.RAW_HEAD_BYTES)
    heads = overlapping(view, fmt.RAW_HEAD_BYTES)[places].view(_HEAD)
    sizes = ends - starts - _DATA
    good = (
        (sizes > 0)
        & (heads["length"] == sizes)
        & (heads["encapsulation"] == _ENCAPSULATION)
        & (heads["kind"] == fmt.BYTES_KIND)
        & (heads["host_time_ns"] >= 0)
        & (heads["host_time_ns"] < fmt.MAX_HOST_NS)
    )
    whole = slice(None) if good.all() else np.flatnonzero(good)
    chosen = heads[whole]
    checked = np.empty(len(chosen), _CHECKED)
    for name in _CHECKED.names or ():
        checked[name] = chosen[name]
    prefixes = checked.view(np.uint8).reshape(len(checked), _CHECKED.itemsize)
    good[whole] = checksums(prefixes, view, starts[whole] + _DATA, ends[whole]) == chosen["crc32"]
    return good, heads


def _joined(view: memoryview, starts: IntArray, sizes: IntArray, stops: IntArray) -> bytes:
    """Put bytes of the view end to end, up to ``stops``."""
    longest = int(sizes.max())
    if longest == sizes.min():
        return overlapping(view, longest)[starts].tobytes()
    # As many bytes of each as the longest has; what is too much, the next one is written over.
    n_roomy = int(np.searchsorted(starts, len(view) - longest, side="right")) if longest <= LONGEST_TOGETHER else 0
    done = int(stops[n_roomy - 1]) if n_roomy else 0
    data = bytearray(done + longest)
    target, source = overlapping(memoryview(data), longest), overlapping(view, longest)
    for first in range(0, n_roomy, MOST_TOGETHER):
        part = slice(first, min(first + MOST_TOGETHER, n_roomy))
        target[stops[part] - sizes[part]] = source[starts[part]]
    rest = zip(starts[n_roomy:].tolist(), (starts + sizes)[n_roomy:].tolist(), strict=True)
    return b"".join([memoryview(data)[:done], *(view[start:stop] for start, stop in rest)])
