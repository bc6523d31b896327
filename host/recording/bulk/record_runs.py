"""Finding the message records of a block of MCAP at once: what lets an hour be read in a second.

Records are a linked list, and walking it one by one is most of the work of reading a recording. Here the block is cut
into sections, and all are walked at a time, a step of every section together, each from the first place in it that
looks like a message in front of another. What was met is then checked with numpy, and linked where one ends at the
next. From a place known to be a start, all linked ones after it are starts as well. A section walked from a false start
(data that looks like one) only breaks a run in two: it is never reached, because no record before it ends there.
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from firmware_protocol.serial.overlapping import overlapping

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

LONGEST_BYTES = 2**24
"""A longer message is none of ours, nor a viewer's: it is left to the walk record by record."""
HEAD_BYTES = 9
"""Kind u8, length u64."""
MESSAGE_HEAD_BYTES = 22
"""Channel u16, sequence u32, log time u64, publish time u64."""
LONGEST_PATTERN = 64
"""Records that come again and again in the same order are looked for up to so many."""
WORTHWHILE = 500
"""Shorter runs of them are left to the walk by sections."""
SECTION_BYTES = 4096
"""From one section's start to the next's. Measured."""
MOST_STEPS = 4 * SECTION_BYTES // (HEAD_BYTES + MESSAGE_HEAD_BYTES)
"""Where so many do not reach the next section, these are no messages: the rest is left to the walk record by record."""
LOOK_BYTES = 256
"""So far into a section a record's start is looked for. Where records are longer, some sections have none: left out."""
FEW_CHANNELS = 16
"""Up to so many are compared one by one."""
_HEAD = struct.Struct("<BQH")
_MESSAGE = int(Opcode.MESSAGE)  # with the enum, bytes are compared as wide integers
_HEAD_DTYPE = np.dtype(
    {
        "names": ["kind", "length", "channel"],
        "formats": ["u1", "<i8", "<u2"],
        "offsets": [0, 1, 9],
        "itemsize": _HEAD.size,
    }
)


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
        """Return those on a few channels."""
        return self.where(on_channels(self.channels, ids))

    def where(self, which: npt.NDArray[np.bool_]) -> MessageRun:
        """Return some of them."""
        return self.at(np.flatnonzero(which))

    def at(self, places: IntArray) -> MessageRun:
        """Return those at some places, ascending."""
        if len(places) == len(self.starts):
            return self
        return MessageRun(self.starts.take(places), self.ends.take(places), self.channels.take(places))

    def not_on(self, ids: Collection[int]) -> int:
        """Return how many are on none of these channels."""
        known = np.zeros(1 << 16, np.bool_)
        known[list(ids)] = True
        return len(self.channels) - int(np.count_nonzero(known.take(self.channels)))

    def numbers(self, block: memoryview) -> IntArray:
        """Return (n,) the number in the head of each; ``block`` is where they are."""
        numbers = np.ndarray((max(len(block) - 3, 0),), "<u4", block, strides=(1,))
        return numbers[self.starts + (HEAD_BYTES + 2)].astype(np.int64)

    def places(self) -> Iterator[tuple[int, int, int]]:
        """Return channel, start and end of them, one by one."""
        return zip(self.channels.tolist(), self.starts.tolist(), self.ends.tolist(), strict=True)


@dataclass(frozen=True, slots=True, eq=False)
class EvenRun:
    """The same few message records again and again, without a gap."""

    pattern: MessageRun
    """The records that repeat, where they are first."""
    repeats: int
    period: int
    """Bytes of the pattern."""

    @property
    def end(self) -> int:
        """Offset behind the last of them."""
        return int(self.pattern.starts[0]) + self.repeats * self.period

    def on(self, ids: Collection[int]) -> MessageRun:
        """Return those on a few channels."""
        return EvenRun(self.pattern.on(ids), self.repeats, self.period).whole()

    def not_on(self, ids: Collection[int]) -> int:
        """Return how many are on none of these channels."""
        return self.pattern.not_on(ids) * self.repeats

    def whole(self) -> MessageRun:
        """Return all of them."""
        offsets = np.arange(self.repeats)[:, None] * self.period
        return MessageRun(
            (offsets + self.pattern.starts).ravel(),
            (offsets + self.pattern.ends).ravel(),
            np.tile(self.pattern.channels, self.repeats),
        )


def on_channels(channels: IntArray, ids: Collection[int]) -> npt.NDArray[np.bool_]:
    """Return which of (n,) channels are among a few."""
    if len(ids) > FEW_CHANNELS:
        table = np.zeros(1 << 16, np.bool_)
        table[list(ids)] = True
        return table.take(channels)
    found = np.zeros(len(channels), np.bool_)
    for channel in ids:
        found |= channels == channel
    return found


def by_channel(channels: IntArray) -> Iterator[tuple[int, IntArray]]:
    """Yield each of (n,) channels with the places where it is, ascending; their number costs nothing."""
    present = np.flatnonzero(np.bincount(channels)).tolist()
    if len(present) <= FEW_CHANNELS:
        for channel in present:
            yield channel, np.flatnonzero(channels == channel)
        return
    order = np.argsort(channels, kind="stable")
    ends = np.flatnonzero(np.diff(channels[order])) + 1
    yield from zip(present, np.split(order, ends), strict=True)


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
        """Return the run that starts with the record at an offset; None where that is not a whole message."""
        if self._block[offset] != _MESSAGE:
            return None
        if self._linked is None:
            run = _even_run(self._block, offset)
            if run is not None:
                return run
            self._linked = _LinkedRecords(self._block, offset, max(self._known, default=-1))
        return self._linked.at(offset)


def _even_run(block: memoryview, offset: int) -> EvenRun | None:
    """Return the run at an offset where the same few records come again and again, as from a link that sends evenly.

    Their heads are all that is looked at. None where nothing repeats, or not for long.
    """
    heads: list[tuple[int, int]] = []
    ends = [offset]
    while len(heads) <= 2 * LONGEST_PATTERN and ends[-1] + _HEAD.size <= len(block):
        kind, length, channel = _HEAD.unpack_from(block, ends[-1])
        if kind != Opcode.MESSAGE or not MESSAGE_HEAD_BYTES <= length < LONGEST_BYTES:
            break
        heads.append((length, channel))
        ends.append(ends[-1] + HEAD_BYTES + length)
    lengths = (n for n in range(1, len(heads) // 2 + 1) if heads[n] == heads[0] and heads[n:] == heads[:-n])
    n_records = next(lengths, None)
    if n_records is None:
        return None
    period = ends[n_records] - offset
    repeats = (len(block) - offset) // period
    for start in ends[:n_records]:
        # Kind, length and channel as two numbers that overlap.
        parts = (np.ndarray(repeats, dtype, block, start + at, (period,)) for dtype, at in (("<u8", 0), ("<u4", 7)))
        same = np.logical_and(*(part == part[0] for part in parts))
        repeats = repeats if same.all() else int(np.argmin(same))
        if repeats * n_records < WORTHWHILE:
            return None
    channels = np.array([channel for _, channel in heads[:n_records]], dtype=np.int64)
    return EvenRun(MessageRun(np.array(ends[:n_records]), np.array(ends[1 : n_records + 1]), channels), repeats, period)


class _LinkedRecords:
    """The messages in a block, from an offset on, that a walk by sections met, linked to the next."""

    def __init__(self, block: memoryview, offset: int, last_channel: int) -> None:
        block = block[offset:]
        starts = _walked(block)
        ends, channels, good = _messages(block, starts)
        whole = np.flatnonzero(good & (channels <= last_channel))
        self._starts, self._ends = starts.take(whole) + offset, ends.take(whole) + offset
        self._channels = channels.take(whole).astype(np.int64)
        linked = self._starts[1:] == self._ends[:-1]
        breaks = np.append(np.flatnonzero(~linked), len(whole) - 1) if len(whole) else np.empty(0, np.int64)
        following = np.searchsorted(self._starts, self._ends[breaks])
        self._breaks, self._following = breaks.tolist(), following.tolist()

    def at(self, offset: int) -> MessageRun | None:
        """Return the run that starts with the record at an offset; None where that is not a whole message."""
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


def _walked(block: memoryview) -> IntArray:
    """Walk from record to record, from the block's start and from the first that looks like one in each section.

    Each walk ends at the next one's start; all take a step together. One from a false start goes wrong: nothing before
    it ends there.

    Returns
    -------
    (n,) where records may start, ascending.
    """
    last = len(block) - HEAD_BYTES - MESSAGE_HEAD_BYTES
    if last < 0:
        return np.empty(0, np.int64)
    section_starts = np.arange(SECTION_BYTES, last - LOOK_BYTES, SECTION_BYTES)
    looked_at = overlapping(block, LOOK_BYTES)[section_starts].view(np.uint8)
    sections, columns = np.divmod(np.flatnonzero(looked_at == _MESSAGE), LOOK_BYTES)
    maybe = section_starts[sections] + columns
    ends, _, good = _messages(block, maybe)
    places = np.flatnonzero(good)
    places = places[_messages(block, ends[places])[2]]  # and what follows is a message too
    firsts = places[np.diff(sections[places], prepend=-1) > 0]
    at = np.concatenate(([0], maybe[firsts]))
    stops = np.append(at[1:], last + 1)
    lengths = np.ndarray((last + 2,), "<u4", block, 1, strides=(1,))  # what needs more than four bytes is not a message
    steps = [at]
    while len(steps) < MOST_STEPS and (at < stops).any():
        at = at + lengths[at]
        at += HEAD_BYTES
        np.minimum(at, last + 1, out=at)
        steps.append(at)
    walked = np.array(steps).T
    return walked[walked < stops[:, None]]


def _messages(block: memoryview, starts: IntArray) -> tuple[IntArray, npt.NDArray[np.uint16], BoolArray]:
    """Read the records that start at (n,) places as messages: end and channel of each, and whether it can be one."""
    heads = overlapping(block, _HEAD.size)[np.minimum(starts, len(block) - _HEAD.size)].view(_HEAD_DTYPE)
    lengths = heads["length"]  # impossible ones are negative, or too long
    ends = lengths + HEAD_BYTES
    ends += starts
    good = (lengths >= MESSAGE_HEAD_BYTES) & (lengths < LONGEST_BYTES) & (ends <= len(block))
    good &= heads["kind"] == _MESSAGE
    return ends, heads["channel"], good
