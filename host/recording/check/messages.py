"""Checking the messages of a file: on described channels, numbered without a gap, in order of time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from host.recording.bulk.record_runs import HEAD_BYTES, MessageRun, by_channel
from host.recording.check.account import Findings
from host.recording.completeness import NumberedRecords

IntArray = npt.NDArray[np.int64]
_TIME_AT = HEAD_BYTES + 6
"""Where in a message record its time of logging stands, behind channel and number."""


@dataclass(slots=True)
class CheckedChannel:
    """One channel, as described, and what came on it."""

    topic: str
    schema_id: int
    definition: tuple[object, ...]
    """All that its record holds: a second description has to be the same."""
    numbers: NumberedRecords = field(default_factory=NumberedRecords)
    count: int = 0


class MessageCheck:
    """Enters messages, many at a time.

    Parameters
    ----------
    damage, notes : Findings
        Where to report what does not fit, and what other tools may well do.
    """

    def __init__(self, damage: Findings, notes: Findings) -> None:
        self.channels: dict[int, CheckedChannel] = {}
        self.ours = False
        """Whether the file is a recording of ours, whose numbers start at 0 and whose times never go back."""
        self.n = 0
        self.first_ns: int | None = None
        self.last_ns: int | None = None
        """The latest time so far; of the first, the earliest."""
        self.backward = 0
        """Messages logged earlier than the one before."""
        self._newest_ns = 0
        self._damage = damage
        self._notes = notes

    def add(self, block: memoryview, run: MessageRun, at: int, within: int | None = None) -> IntArray:
        """Enter messages of a block that starts ``at`` in the file, or lies in the chunk that starts ``within``.

        Returns
        -------
        (n,) int64
            Their times of logging, ns.
        """
        times = np.ndarray((max(len(block) - 7, 0),), "<u8", block, strides=(1,))[run.starts + _TIME_AT]
        times_ns = (times & np.uint64(2**63 - 1)).astype(np.int64)
        places = run.starts + at if within is None else np.full(len(run.starts), within)
        self._check_times(times, places)
        for channel, of_channel in by_channel(run.channels):
            if channel not in self.channels:
                what = f"{len(of_channel)} messages are" if len(of_channel) > 1 else "a message is"
                meaning = "nobody can read them; the channel's number or its record is damaged"
                where = int(places[of_channel[0]])
                self._damage.add(where, f"{what} on channel {channel}, which is not described before", meaning)
                continue
            numbers = run.at(of_channel).numbers(block)
            self._check_numbers(self.channels[channel], numbers, places[of_channel])
        self.n += len(run.starts)
        return times_ns

    def start_span(self) -> tuple[int | None, int | None]:
        """Start to look for the first and the last time of a chunk; return those so far, for :meth:`end_span`."""
        outside = self.first_ns, self.last_ns
        self.first_ns = self.last_ns = None
        return outside

    def end_span(self, outside: tuple[int | None, int | None]) -> tuple[int, int]:
        """Return the first and the last time since :meth:`start_span`, 0 for none, and go on with all."""
        span = self.first_ns or 0, self.last_ns or 0
        firsts = [time for time in (outside[0], self.first_ns) if time is not None]
        lasts = [time for time in (outside[1], self.last_ns) if time is not None]
        self.first_ns, self.last_ns = min(firsts, default=None), max(lasts, default=None)
        return span

    def _check_times(self, times: npt.NDArray[np.uint64], places: IntArray) -> None:
        low, high = int(times.min()), int(times.max())
        self.first_ns = low if self.first_ns is None else min(low, self.first_ns)
        self.last_ns = high if self.last_ns is None else max(high, self.last_ns)
        before = np.concatenate((np.array([self._newest_ns], np.uint64), np.maximum.accumulate(times)[:-1]))
        np.maximum(before, np.uint64(self._newest_ns), out=before)
        late = np.flatnonzero(times < before)
        self._newest_ns = max(self._newest_ns, high)
        self.backward += len(late)
        if len(late) and self.ours:
            what = f"{len(late)} messages are" if len(late) > 1 else "a message is"
            meaning = "the time in a record is damaged, or records stand in another order than they were written"
            self._damage.add(int(places[late[0]]), f"{what} logged earlier than the one before", meaning)

    def _check_numbers(self, channel: CheckedChannel, numbers: IntArray, places: IntArray) -> None:
        if not channel.count and not self.ours:  # other tools start at any number
            channel.numbers = NumberedRecords(int(numbers[0]))
        channel.count += len(numbers)
        before = channel.numbers.disordered
        gaps = channel.numbers.add(numbers)
        if not self.ours:
            return
        for place, records in gaps:
            if records:
                what = f"{records} records of {channel.topic} are" if records > 1 else f"1 record of {channel.topic} is"
                meaning = "damaged in the file, not lost on the link"
                self._damage.add(int(places[place]), f"{what} missing in front of number {numbers[place]}", meaning)
            else:
                what = f"a record of {channel.topic} has the number {numbers[place]}, which does not follow"
                self._damage.add(int(places[place]), what, "it stands in the file twice, or out of order")
        if channel.numbers.disordered > before and not gaps and not channel.numbers.unnumbered:
            what = f"numbers of records of {channel.topic} are damaged"
            self._damage.add(int(places[0]), what, "what is in the records is read all the same")
