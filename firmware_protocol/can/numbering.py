"""Which sample an ORIENTATION frame is: eight bits, TIME frames and the time of reception make a full counter.

Between two TIME frames the counter follows from the differences of the eight bits. A TIME frame then shows how many
times 256 samples were lost unseen on the way; they are put where the host heard nothing for longest, or, where it was
never silent for so long (it was busy itself, and read late), where the eight bits jump. After a long silence, and where
the eight bits do not go up, samples are *held* until the next TIME frame (at most ``can_mapping.MAX_TIME_INTERVAL``
samples later), so that no sample is numbered by guess; so are all before the first TIME frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.mapping import SEQUENCE_MODULUS

IntArray = npt.NDArray[np.int64]

LATE_WINDOW = 4
"""How far behind its place a frame may come: transmit mailboxes served out of turn, samples overtaken by TIME."""
SILENCE_SAMPLES = SEQUENCE_MODULUS // 2
"""A silence of this many sample periods could hide 256 lost samples: what follows waits for TIME."""
MAX_HELD = 512
"""Samples held; beyond it there is no TIME frame, so they are not ours to number."""


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
class Numbering:
    """Where the numbering of one node stands; forgotten by making a new one."""

    expected: int | None = None
    """Unwrapped counter of the next sample if none is lost; None before the first TIME frame."""
    newest: int | None = None
    """Counter of the last sample given away."""
    heard_ns: int = 0
    """When the last sample was received, or the TIME frame after it."""
    longest_silence_ns: int = -1
    """Longest silence since the last TIME frame among samples already given away."""
    given_since_silence: int = 0
    """Samples given away since then: wrongly numbered if the next TIME frame shows a loss in that silence."""
    misnumbered: int = 0
    """Samples given away that a later TIME frame showed to be numbered 256 or more too low."""

    def number(
        self,
        sequence: npt.NDArray[np.uint8],
        host_ns: IntArray,
        marks: Marks,
        period_ns: float,
        may_hold: bool = True,
    ) -> tuple[IntArray, int]:
        """Give a run of samples their counters.

        Parameters
        ----------
        sequence : (n,) uint8
            Low eight bits of the counters, in order of reception.
        host_ns : (n,)
            When each was received.
        marks : Marks
            The TIME frames among them; counters must not fall, nor begin behind what was numbered before.
        period_ns : float
            Sample period.
        may_hold : bool
            Whether samples may wait for a TIME frame to come.

        Returns
        -------
        counters : (m,)
            Of the first m samples; negative where a sample cannot be numbered.
        m : int
            The others are held: give them again, in front of the next run.
        """
        n = len(sequence)
        n_marks = len(marks.counter)
        if self.expected is None and n_marks == 0:
            return np.empty(0, np.int64), 0
        low_bits = sequence.astype(np.int64)
        steps = np.zeros(n, np.int64)
        steps[1:] = (np.diff(low_bits) + LATE_WINDOW) % SEQUENCE_MODULUS - LATE_WINDOW
        total = np.cumsum(steps)
        counters = np.empty(n, np.int64)
        edges = [0, *marks.position.tolist(), n]
        mark_counters, mark_times_ns = marks.counter.tolist(), marks.host_time_ns.tolist()
        expected_before: int | None = None
        for segment in range(n_marks + 1):
            first, last = edges[segment], edges[segment + 1]
            expected_before = self.expected
            if first < last:
                if self.expected is None:
                    # Before the first TIME frame: the last sample is the newest that may stand before it.
                    high = mark_counters[0] - 1 + LATE_WINDOW
                    newest = high - (high - int(low_bits[last - 1])) % SEQUENCE_MODULUS
                    start = newest - int(total[last - 1] - total[first])
                    unknown = self._before_silence(host_ns[first:last], period_ns)
                else:
                    unknown = 0
                    low = self.expected - LATE_WINDOW
                    start = low + (int(low_bits[first]) - low) % SEQUENCE_MODULUS
                    previous = int(counters[first - 1]) if first else self.newest
                    steps[first] = 1 if previous is None else start - previous
                np.add(total[first:last], start - int(total[first]), out=counters[first:last])
                counters[first : first + unknown] = -1
                self.expected = int(counters[last - 1]) + 1
            if segment < n_marks:
                mark, mark_ns = mark_counters[segment], mark_times_ns[segment]
                if self.expected is not None and mark - self.expected >= SEQUENCE_MODULUS:
                    unseen = (mark - self.expected) // SEQUENCE_MODULUS * SEQUENCE_MODULUS
                    self._place(unseen, counters, host_ns, steps, first, last, mark_ns, period_ns)
                self.expected, self.heard_ns = mark, mark_ns
                self.longest_silence_ns = -1
                self.given_since_silence = 0
        first = edges[-2]
        if not may_hold and first < n and expected_before is not None:
            # No TIME frame will tell: the last sample is taken for the one that is due by the time of its reception.
            due = expected_before + round((int(host_ns[-1]) - self.heard_ns) / period_ns)
            unseen = round((due - int(counters[-1])) / SEQUENCE_MODULUS) * SEQUENCE_MODULUS
            if unseen > 0:
                self._place(unseen, counters, host_ns, steps, first, n, int(host_ns[-1]), period_ns)
        taken = self._given(host_ns, steps, first, n, period_ns, may_hold)
        if first < n:
            # Held samples have no number yet.
            self.expected = int(counters[taken - 1]) + 1 if taken > first else expected_before
        if taken:
            self.newest = int(counters[taken - 1])
        return counters[:taken], taken

    @staticmethod
    def _before_silence(host_ns: IntArray, period_ns: float) -> int:
        """How many samples stand before the last long silence: nothing tells how many were lost in it."""
        long = np.flatnonzero(np.diff(host_ns) > SILENCE_SAMPLES * period_ns)
        return int(long[-1]) + 1 if len(long) else 0

    def _place(
        self,
        unseen: int,
        counters: IntArray,
        host_ns: IntArray,
        steps: IntArray,
        first: int,
        last: int,
        mark_ns: int,
        period_ns: float,
    ) -> None:
        """Put samples lost unseen where they most likely belong: before a sample, or before the TIME.

        That is where the eight bits do not go up, for some 256 lost in a row look so; else where the host heard nothing
        for longest, if that was long enough; else where the eight bits jump.
        """
        if first == last:
            return
        silences = np.diff(np.concatenate([[self.heard_ns], host_ns[first:last], [mark_ns]]))
        is_back = np.append(steps[first:last] <= 0, False)
        jumps = np.append(np.abs(steps[first:last] - 1), 0)
        is_silent = bool(silences.max() > SILENCE_SAMPLES * period_ns)
        first_key, second_key = (silences, jumps) if is_silent else (jumps, silences)
        place = int(np.lexsort((np.arange(len(silences)), second_key, first_key, is_back))[-1])
        if self.longest_silence_ns > int(silences[place]) and not jumps[place]:
            self.misnumbered += self.given_since_silence
            place = 0
        counters[first + place : last] += unseen

    def _given(self, host_ns: IntArray, steps: IntArray, first: int, n: int, period_ns: float, may_hold: bool) -> int:
        """How many samples can be given away now: the last segment, up to where some may be missing unseen."""
        if first == n:
            return n
        silences = np.diff(np.concatenate([[self.heard_ns], host_ns[first:n]]))
        doubtful = np.flatnonzero((silences > SILENCE_SAMPLES * period_ns) | (steps[first:n] <= 0))
        taken = first + int(doubtful[0]) if len(doubtful) and may_hold else n
        if n - taken > MAX_HELD:  # no TIME frame comes any more: better a guess than nothing
            taken = n
        if taken > first:
            self.given_since_silence += taken - first
            place = int(np.argmax(silences[: taken - first]))
            if int(silences[place]) > self.longest_silence_ns:
                self.longest_silence_ns = int(silences[place])
                self.given_since_silence = taken - first - place
            self.heard_ns = int(host_ns[taken - 1])
        return taken
