"""Finding the message records of a block of MCAP at once: what lets an hour be read in a second.

Records are a linked list, and walking it one by one is most of the work of reading a recording. Here every place that
can be the start of a message is found with numpy, with where it would end; where one ends at the next such place the
two are linked. From a place known to be a start, all linked ones after it are starts as well. A false start (data that
looks like one) only breaks a run in two: it is never reached, because no record before it ends there.
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from host.recording.row_checksums import overlapping

IntArray = npt.NDArray[np.int64]

LONGEST_BYTES = 2**24
"""A longer message is none of ours, nor a viewer's: it is left to the walk record by record."""
HEAD_BYTES = 9
"""Kind u8, length u64."""
LONGEST_BEAT = 64
"""Records that come again and again in the same order are looked for up to so many."""
WORTHWHILE = 500
"""Shorter runs of them are left to the search for every start."""
_HEAD = struct.Struct("<BQH")
_MESSAGE = int(Opcode.MESSAGE)  # with the enum, bytes are compared as wide integers
_HEAD_DTYPE = np.dtype(
    {"names": ["length", "channel"], "formats": ["<i8", "<u2"], "offsets": [1, 9], "itemsize": _HEAD.size}
)
MESSAGE_HEAD_BYTES = 22
"""Channel u16, sequence u32, log time u64, publish time u64."""


@dataclass(frozen=True, slots=True, eq=False)
class MessageRun:
    """Message records that follow each other without a gap."""

    starts: IntArray
    """(n,) offset of each record's first byte."""
    ends: IntArray
    """(n,) offset behind each record."""
    channels: IntArray
    """(n,) channel ids."""

    @property
    def end(self) -> int:
        """Offset behind the last of them."""
        return int(self.ends[-1])

    def on(self, ids: Collection[int]) -> MessageRun:
        """Give those on a few channels."""
        return self.where(on_channels(self.channels, ids))

    def where(self, which: npt.NDArray[np.bool_]) -> MessageRun:
        """Give some of them."""
        places = np.flatnonzero(which)
        if len(places) == len(which):
            return self
        return MessageRun(self.starts.take(places), self.ends.take(places), self.channels.take(places))

    def places(self) -> Iterator[tuple[int, int, int]]:
        """Give channel, start and end of them, one by one."""
        return zip(self.channels.tolist(), self.starts.tolist(), self.ends.tolist(), strict=True)


@dataclass(frozen=True, slots=True, eq=False)
class EvenRun:
    """The same few message records again and again, without a gap."""

    beat: MessageRun
    """The first of each."""
    n_beats: int
    period: int
    """Bytes of a beat."""

    @property
    def end(self) -> int:
        """Offset behind the last of them."""
        return int(self.beat.starts[0]) + self.n_beats * self.period

    def on(self, ids: Collection[int]) -> MessageRun:
        """Give those on a few channels."""
        return EvenRun(self.beat.on(ids), self.n_beats, self.period).whole()

    def whole(self) -> MessageRun:
        """Give all of them."""
        beats = np.arange(self.n_beats)[:, None] * self.period
        return MessageRun(
            (beats + self.beat.starts).ravel(),
            (beats + self.beat.ends).ravel(),
            np.tile(self.beat.channels, self.n_beats),
        )


def on_channels(channels: IntArray, ids: Iterable[int]) -> npt.NDArray[np.bool_]:
    """Tell which of (n,) channels are among a few."""
    found = np.zeros(len(channels), np.bool_)
    for channel in ids:
        found |= channels == channel
    return found


class RecordRuns:
    """The runs of message records in one block.

    Parameters
    ----------
    block : buffer
        Bytes of a file; where in it a record starts is for the caller to know.
    known : collection of int
        Ids of the channels met so far, which may grow: there are few, and little else that looks like a start has one.
    """

    def __init__(self, block: memoryview, known: Collection[int]) -> None:
        self._block = block
        self._known = known
        self._linked: _LinkedRecords | None = None

    def at(self, offset: int) -> MessageRun | EvenRun | None:
        """Return the run that begins with the record at an offset; None where that is no whole message."""
        if self._block[offset] != _MESSAGE:
            return None
        if self._linked is None:
            run = _even_run(self._block, offset)
            if run is not None:
                return run
            self._linked = _LinkedRecords(self._block, offset, max(self._known, default=-1))
        return self._linked.at(offset)


def _even_run(block: memoryview, offset: int) -> EvenRun | None:
    """Return the run at an offset where the same few records come again and again, as from a link that beats evenly.

    Their heads are all that is looked at. None where the beat is lost soon, or there is none.
    """
    heads: list[tuple[int, int]] = []
    ends = [offset]
    while len(heads) <= 2 * LONGEST_BEAT and ends[-1] + _HEAD.size <= len(block):
        kind, length, channel = _HEAD.unpack_from(block, ends[-1])
        if kind != Opcode.MESSAGE or not MESSAGE_HEAD_BYTES <= length < LONGEST_BYTES:
            break
        heads.append((length, channel))
        ends.append(ends[-1] + HEAD_BYTES + length)
    beat = next((n for n in range(1, len(heads) // 2 + 1) if heads[n:] == heads[:-n]), None)
    if beat is None:
        return None
    period = ends[beat] - offset
    n_beats = (len(block) - offset) // period
    for start in ends[:beat]:
        # Kind, length and channel as two numbers that overlap.
        parts = (np.ndarray(n_beats, dtype, block, start + at, (period,)) for dtype, at in (("<u8", 0), ("<u4", 7)))
        same = np.logical_and(*(part == part[0] for part in parts))
        n_beats = n_beats if same.all() else int(np.argmin(same))
        if n_beats * beat < WORTHWHILE:
            return None
    channels = np.array([channel for _, channel in heads[:beat]], dtype=np.int64)
    return EvenRun(MessageRun(np.array(ends[:beat]), np.array(ends[1 : beat + 1]), channels), n_beats, period)


class _LinkedRecords:
    """Every place in a block, from an offset on, that can be the start of a message, linked to the next."""

    def __init__(self, block: memoryview, offset: int, last_channel: int) -> None:
        block = block[offset:]
        data = np.frombuffer(block, np.uint8)
        starts = np.flatnonzero(data[: max(len(data) - HEAD_BYTES - MESSAGE_HEAD_BYTES + 1, 0)] == _MESSAGE)
        heads = overlapping(block, _HEAD.size)[starts].view(_HEAD_DTYPE)
        lengths = heads["length"]  # impossible ones are negative, or too long
        ends = lengths + HEAD_BYTES
        ends += starts
        whole = (lengths >= MESSAGE_HEAD_BYTES) & (lengths < LONGEST_BYTES) & (ends <= len(data))
        whole = np.flatnonzero(whole & (heads["channel"] <= last_channel))
        self._starts, self._ends = starts.take(whole), ends.take(whole)
        self._channels = heads["channel"].take(whole).astype(np.int64)
        self._starts += offset
        self._ends += offset
        linked = self._starts[1:] == self._ends[:-1]
        breaks = np.append(np.flatnonzero(~linked), len(whole) - 1) if len(whole) else np.empty(0, np.int64)
        following = np.searchsorted(self._starts, self._ends[breaks])
        self._breaks, self._following = breaks.tolist(), following.tolist()

    def at(self, offset: int) -> MessageRun | None:
        """Return the run that begins with the record at an offset; None where that is no whole message."""
        first = int(np.searchsorted(self._starts, offset))
        parts: list[slice] = []
        while first < len(self._starts) and self._starts[first] == offset:
            index = bisect_left(self._breaks, first)
            parts.append(slice(first, self._breaks[index] + 1))
            first, offset = self._following[index], self._ends[self._breaks[index]]  # past a false start
        if not parts:
            return None
        columns = (self._starts, self._ends, self._channels)
        if len(parts) == 1:
            return MessageRun(*(column[parts[0]] for column in columns))
        return MessageRun(*(np.concatenate([column[part] for part in parts]) for column in columns))
