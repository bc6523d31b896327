"""What the sequence numbers of ORIENTATION tell: lost, repeated and late samples.

A number ahead of the newest one by d = 2 … 32767 is a gap of d − 1 lost samples. A number at most ``LATE_WINDOW``
behind is late: *reordered* if it was counted lost (it no longer is), else a *duplicate*. Further behind, the object has
started anew. A loss of 32768 samples or more in one piece (33 s at 1000 Hz) cannot be told from the number alone;
STATUS counts without wrap.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

LATE_WINDOW = 256
"""How far behind the newest sequence number a sample may come and still be told from a restart."""

_HALF = 1 << 15
_MASK = (1 << 16) - 1


@dataclass(frozen=True)
class SequenceCounters:
    """What a :class:`SequenceTracker` has met since it was made."""

    sequence_gaps: int = 0
    """Jumps ahead."""
    samples_lost: int = 0
    """Samples never received: all numbers jumped over, less those that came late."""
    duplicates: int = 0
    """Samples received once more."""
    reordered: int = 0
    """Samples that came after a later one."""
    sequence_restarts: int = 0
    """Jumps back by more than ``LATE_WINDOW``: the object has started anew."""


class SequenceTracker:
    """Follow sequence numbers (u16, wrapping) and count what is irregular."""

    def __init__(self) -> None:
        self._newest: int | None = None  # unwrapped, so that the memory below never meets itself after a wrap
        self._missing: set[int] = set()  # numbers counted lost, of the last LATE_WINDOW
        self._gaps = 0
        self._lost = 0
        self._duplicates = 0
        self._reordered = 0
        self._restarts = 0

    @property
    def counters(self) -> SequenceCounters:
        """Snapshot of the counters."""
        return SequenceCounters(self._gaps, self._lost, self._duplicates, self._reordered, self._restarts)

    def restart(self) -> None:
        """Forget the newest number: the next one is not compared. The counters go on."""
        self._newest = None
        self._missing.clear()

    def feed(self, sequences: Iterable[int]) -> None:
        """Take sequence numbers in the order of arrival."""
        newest = self._newest
        for sequence in sequences:
            if newest is not None and (newest + 1) & _MASK == sequence:
                newest += 1
            else:
                newest = self._irregular(newest, sequence)
        self._newest = newest

    def feed_array(self, sequences: npt.NDArray[np.uint16]) -> None:
        """Take sequence numbers (n,) in the order of arrival; the same as :meth:`feed`, for many."""
        if not len(sequences):
            return
        starts = np.concatenate(([0], np.flatnonzero(np.diff(sequences) != 1) + 1))  # differences wrap, as numbers do
        ends = np.append(starts[1:], len(sequences))
        newest = self._newest
        for start, end, sequence in zip(starts.tolist(), ends.tolist(), sequences[starts].tolist(), strict=True):
            # A run of consecutive numbers. Those not ahead of the newest are looked at one by one; the first that is
            # ahead takes all the rest with it.
            n_late = 0 if newest is None else (newest - sequence + _HALF & _MASK) - _HALF + 1
            n_single = min(max(n_late, 0) + 1, end - start)
            for number in range(sequence, sequence + n_single):
                newest = self._irregular(newest, number & _MASK)
            if newest is not None:
                newest += end - start - n_single
        self._newest = newest

    def _irregular(self, newest: int | None, sequence: int) -> int:
        if newest is None:
            return sequence
        ahead = (sequence - newest + _HALF & _MASK) - _HALF
        number = newest + ahead
        if ahead > 0:
            if ahead > 1:
                self._gaps += 1
                self._lost += ahead - 1
                if len(self._missing) > LATE_WINDOW:
                    self._missing = {late for late in self._missing if late >= number - LATE_WINDOW}
                self._missing.update(range(max(newest + 1, number - LATE_WINDOW), number))
            return number
        if ahead < -LATE_WINDOW:
            self._restarts += 1
            self._missing.clear()
            return number
        if number in self._missing:
            self._missing.remove(number)
            self._reordered += 1
            self._lost -= 1
        else:
            self._duplicates += 1
        return newest
