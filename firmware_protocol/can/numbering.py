"""Which sample an ORIENTATION frame is: eight bits, TIME frames and the time of reception make a full counter.

Between two TIME frames the counter follows from the differences of the eight bits. A TIME frame then shows how many
times 256 samples were lost unseen on the way; they are put where the host heard nothing for longest, or, where it was
never silent for so long (it was busy itself, and read late), where the eight bits jump. After a long silence, and where
the eight bits do not go up, samples are *held* until the next TIME frame (at most ``mapping.MAX_TIME_INTERVAL`` samples
later), so that no sample is numbered by guess; so are all before the first TIME frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.mapping import SEQUENCE_MODULUS
from firmware_protocol.items import Tally

IntArray = npt.NDArray[np.int64]

LATE_WINDOW = 4
"""How far behind its place a frame may come: transmit mailboxes served out of turn, samples overtaken by TIME."""
SILENCE_SAMPLES = SEQUENCE_MODULUS // 2
"""A silence of this many sample periods could hide 256 lost samples: what follows waits for TIME."""
MAX_HELD = 512
"""Samples held; beyond it TIME frames do not come, so waiting for one is in vain."""


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """TIME frames of one run, in order."""

    position: IntArray
    """(k,) how many samples of the run stood before each."""
    counter: IntArray
    """(k,) unwrapped."""
    host_time_ns: IntArray
    """(k,)."""


@dataclass(slots=True)
class Silence:
    """The longest silence before a sample delivered since the last TIME frame: where a loss would be placed."""

    heard_ns: int = 0
    """When the last sample was received, or the TIME frame after it."""
    longest_ns: int = -1
    """The longest silence."""
    n_after: int = 0
    """Samples delivered after it: wrongly numbered if the next TIME frame shows a loss in it."""

    def end(self, host_ns: int) -> None:
        """Start again at a TIME frame: it has shown what was lost before it."""
        self.heard_ns, self.longest_ns, self.n_after = host_ns, -1, 0

    def deliver(self, host_ns: int) -> None:
        """Note one sample delivered."""
        silence_ns = host_ns - self.heard_ns
        if silence_ns > self.longest_ns:
            self.longest_ns, self.n_after = silence_ns, 0
        self.n_after += 1
        self.heard_ns = host_ns

    def deliver_many(self, silences_ns: IntArray, host_ns: int) -> None:
        """Note samples delivered, by the silence before each (k,) and the time of the last one's reception."""
        self.n_after += len(silences_ns)
        place = int(np.argmax(silences_ns))
        if int(silences_ns[place]) > self.longest_ns:
            self.longest_ns, self.n_after = int(silences_ns[place]), len(silences_ns) - place
        self.heard_ns = host_ns


class _Run:
    """A run of n samples on its way to its counters. TIME frames cut it into segments, ``first`` to ``last``."""

    def __init__(self, sequence: npt.NDArray[np.uint8], host_ns: IntArray, period_ns: float) -> None:
        n = len(sequence)
        self.low_bits = sequence.astype(np.int64)
        self.steps = np.zeros(n, np.int64)
        """From one sample to the next by the eight bits; from segment to segment by the counters, once these are known.
        """
        self.steps[1:] = (np.diff(self.low_bits) + LATE_WINDOW) % SEQUENCE_MODULUS - LATE_WINDOW
        self.offsets = np.cumsum(self.steps)
        self.counters = np.empty(n, np.int64)
        self.host_ns = host_ns
        self.doubtful_ns = SILENCE_SAMPLES * period_ns
        """A silence longer than this could hide 256 lost samples."""

    def set_counters(self, first: int, last: int, start: int) -> None:
        """Assign the counters of a segment, from its first sample's."""
        np.add(self.offsets[first:last], start - int(self.offsets[first]), out=self.counters[first:last])

    def silences_ns(self, first: int, last: int, heard_ns: int) -> IntArray:
        """Return the silence before each sample of a segment; ``heard_ns`` is the time of the frame before it."""
        return np.diff(self.host_ns[first:last], prepend=heard_ns)


@dataclass(slots=True)
class Numbering:
    """Where the numbering of one boot of one object stands."""

    tally: Tally = field(default_factory=Tally)
    """Where ``misnumbered`` samples are counted."""
    expected: int | None = None
    """Unwrapped counter of the next sample if none is lost; None before the first TIME frame."""
    newest: int | None = None
    """Counter of the last sample delivered."""
    silence: Silence = field(default_factory=Silence)
    """Among the samples delivered since the last TIME frame."""

    def deliver_next(self, host_times_ns: Iterable[int]) -> None:
        """Deliver samples that are plainly the next ones; :attr:`expected` must be known."""
        for host_ns in host_times_ns:
            self.silence.deliver(host_ns)
            self.newest = self.expected
            self.expected += 1  # type: ignore[operator]

    def number(
        self, sequence: npt.NDArray[np.uint8], host_ns: IntArray, marks: Marks, period_ns: float, may_hold: bool = True
    ) -> tuple[IntArray, int]:
        """Find the counters of a run of samples.

        Parameters
        ----------
        sequence : (n,) uint8
            Low eight bits of the counters, in order of reception.
        host_ns : (n,)
            When each was received.
        marks : Marks
            The TIME frames among them; counters must not fall, nor start behind what was numbered before.
        period_ns : float
            Sample period.
        may_hold : bool
            Whether samples may wait for a TIME frame to come.

        Returns
        -------
        counters : (m,)
            Of the first m samples; negative where a sample cannot be numbered.
        m : int
            The others are held: pass them again, in front of the next run.
        """
        n, first = len(sequence), 0
        if self.expected is None and len(marks.counter) == 0:
            return np.empty(0, np.int64), 0
        run = _Run(sequence, host_ns, period_ns)
        for last, counter, mark_ns in zip(
            marks.position.tolist(), marks.counter.tolist(), marks.host_time_ns.tolist(), strict=True
        ):
            if first < last:
                if self.expected is None:
                    self._number_backwards(run, last, counter)
                else:
                    self._number_onwards(run, first, last, self.expected)
            if self.expected is not None and counter - self.expected >= SEQUENCE_MODULUS:
                unseen = (counter - self.expected) // SEQUENCE_MODULUS * SEQUENCE_MODULUS
                self._place(run, first, last, unseen, mark_ns)
            self.expected = counter
            self.silence.end(mark_ns)
            first = last
        delivered = n
        if first < n:  # samples behind the last TIME frame
            before = self.expected
            assert before is not None
            self._number_onwards(run, first, n, before)
            if not may_hold:
                # No TIME frame will come: the last sample is assumed to be the one due when it was received.
                due = before + round((int(host_ns[-1]) - self.silence.heard_ns) / period_ns)
                unseen = round((due - int(run.counters[-1])) / SEQUENCE_MODULUS) * SEQUENCE_MODULUS
                if unseen > 0:
                    self._place(run, first, n, unseen, int(host_ns[-1]))
            delivered = self._deliver(run, first, may_hold)
            # Held samples have no number yet.
            self.expected = int(run.counters[delivered - 1]) + 1 if delivered > first else before
        if delivered:
            self.newest = int(run.counters[delivered - 1])
        return run.counters[:delivered], delivered

    def _number_backwards(self, run: _Run, last: int, counter: int) -> None:
        """Find the counters before the first TIME frame ever: the last sample is the newest that may stand there."""
        high = counter - 1 + LATE_WINDOW
        newest = high - (high - int(run.low_bits[last - 1])) % SEQUENCE_MODULUS
        run.set_counters(0, last, newest - int(run.offsets[last - 1]))
        # Nothing shows how many samples were lost in a long silence, so those before the last one stay unnumbered.
        long = np.flatnonzero(np.diff(run.host_ns[:last]) > run.doubtful_ns)
        if len(long):
            run.counters[: int(long[-1]) + 1] = -1
        self.expected = newest + 1

    def _number_onwards(self, run: _Run, first: int, last: int, expected: int) -> None:
        """Find the counters of a segment from where the one before it ended."""
        low = expected - LATE_WINDOW
        start = low + (int(run.low_bits[first]) - low) % SEQUENCE_MODULUS
        previous = int(run.counters[first - 1]) if first else self.newest
        run.steps[first] = 1 if previous is None else start - previous
        run.set_counters(first, last, start)
        self.expected = int(run.counters[last - 1]) + 1

    def _place(self, run: _Run, first: int, last: int, unseen: int, until_ns: int) -> None:
        """Put samples lost unseen where they most likely belong: before a sample of the segment, or behind it.

        That is where the eight bits do not go up, for some 256 lost in a row look so; else where the host heard nothing
        for longest, if that was long enough; else where the eight bits jump.
        """
        if first == last:
            return
        steps = run.steps[first:last]
        silences = np.append(run.silences_ns(first, last, self.silence.heard_ns), until_ns - int(run.host_ns[last - 1]))
        is_back = np.append(steps <= 0, False)
        jumps = np.append(np.abs(steps - 1), 0)
        is_silent = bool(silences.max() > run.doubtful_ns)
        first_key, second_key = (silences, jumps) if is_silent else (jumps, silences)
        place = int(np.lexsort((np.arange(len(silences)), second_key, first_key, is_back))[-1])
        if self.silence.longest_ns > int(silences[place]) and not jumps[place]:
            # The longest silence was before samples that are delivered already: they carry numbers too low.
            self.tally["misnumbered"] += self.silence.n_after
            place = 0
        run.counters[first + place : last] += unseen

    def _deliver(self, run: _Run, first: int, may_hold: bool) -> int:
        """Return how many samples of the run can be delivered: up to where some may be missing unseen."""
        silences = run.silences_ns(first, len(run.counters), self.silence.heard_ns)
        count = len(silences)
        doubtful = np.flatnonzero((silences > run.doubtful_ns) | (run.steps[first:] <= 0))
        # Where too many wait, TIME frames do not come any more: better a guess than nothing.
        if len(doubtful) and may_hold and count - int(doubtful[0]) <= MAX_HELD:
            count = int(doubtful[0])
        if count:
            self.silence.deliver_many(silences[:count], int(run.host_ns[first + count - 1]))
        return first + count
