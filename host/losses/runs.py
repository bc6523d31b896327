"""Runs of missing samples, and why each is missing: dropped by the device, arrived damaged, or lost.

What the device dropped, its STATUS counts: so many between one STATUS and the next. A damaged frame between two samples
is one of those missing there. What neither explains was lost on the link; or, where the recording lacks records in that
very place, it is damaged in the file.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]


@dataclass(slots=True)
class MissingRun:
    """Missing samples in a row."""

    first: int
    """Number of the first."""
    missing: int
    """How many."""
    damaged: int = 0
    """Damaged frames that came in their place; noise may be among them."""
    dropped: int = 0
    """Of the missing, those that the device dropped."""
    file_gap: bool = False
    """Whether the recording lacks records in their place."""

    @property
    def end(self) -> int:
        """Number of the sample after the run."""
        return self.first + self.missing

    @property
    def rejected(self) -> int:
        """Of the missing, those that arrived damaged."""
        return min(self.damaged, self.missing - self.dropped)

    @property
    def damaged_in_file(self) -> int:
        """Of the missing, those in records that the file lacks; a loss on the link right beside them is among these."""
        return self.missing - self.dropped - self.rejected if self.file_gap else 0

    @property
    def lost(self) -> int:
        """Of the missing, those lost on the link."""
        return self.missing - self.dropped - self.rejected - self.damaged_in_file


@dataclass(frozen=True, slots=True)
class MissingTotals:
    """Sums over runs."""

    missing: int = 0
    rejected: int = 0
    dropped: int = 0
    damaged_in_file: int = 0

    @property
    def lost(self) -> int:
        """What nothing else explains."""
        return self.missing - self.rejected - self.dropped - self.damaged_in_file


class MissingRuns:
    """The runs of one account, in order of their numbers: ``max_runs`` one by one, the older ones only summed up."""

    def __init__(self, max_runs: int) -> None:
        self._max_runs = max_runs
        self._runs: deque[MissingRun] = deque()
        self._gone = MissingTotals()
        self._marks: deque[tuple[int, int]] = deque()  # of STATUS: number it covers up to, dropped since the one before
        self._settled_end = 0
        self._unplaced = 0  # dropped, but no run had room for it

    @property
    def newest(self) -> MissingRun | None:
        """The run with the largest numbers."""
        return self._runs[-1] if self._runs else None

    def add(self, run: MissingRun) -> None:
        """Enter a run behind all others."""
        self._runs.append(run)
        if len(self._runs) > self._max_runs:
            self._gone = _total([self._runs.popleft()], self._gone)

    def explain(self, end: int, damaged: int) -> int:
        """Enter damaged frames for the run that ends at ``end``; return for how many of them it has room."""
        run = self.newest
        here = 0 if run is None or run.end != end else max(0, min(damaged, run.missing - run.damaged))
        if run is not None:
            run.damaged += here
        return here

    def fill(self, number: int) -> bool:
        """Take out a sample that came late; False if it is not missing (any more)."""
        for place in range(len(self._runs) - 1, -1, -1):
            run = self._runs[place]
            if run.end <= number:
                return False
            if number < run.first:
                continue
            left = MissingRun(run.first, number - run.first, file_gap=run.file_gap)
            right = MissingRun(number + 1, run.end - number - 1, file_gap=run.file_gap)
            left.damaged = min(run.damaged, left.missing)
            right.damaged = run.damaged - left.damaged
            left.dropped = min(run.dropped, left.missing)
            right.dropped = min(run.dropped - left.dropped, right.missing)
            self._unplaced += run.dropped - left.dropped - right.dropped
            parts = [part for part in (left, right) if part.missing]
            if parts:
                self._runs[place] = parts[0]
            else:
                del self._runs[place]
            if len(parts) > 1 and len(self._runs) < self._max_runs:
                self._runs.insert(place + 1, parts[1])
            return True
        return False

    def mark(self, end: int, dropped: int) -> None:
        """Enter a STATUS: of the samples up to number ``end``, ``dropped`` more were dropped than by the last one."""
        self._marks.append((end, dropped))

    def take_back(self, end: int) -> None:
        """Forget that samples from number ``end`` on were produced; what was dropped counts with the next STATUS."""
        while self._marks and self._marks[-1][0] > end:
            self._unplaced += self._marks.pop()[1]

    def settle(self, next_number: int) -> None:
        """Note that nothing below ``next_number`` is still expected: STATUS that cover no more are accounted for."""
        while self._marks and self._marks[0][0] <= next_number:
            end, dropped = self._marks.popleft()
            self._unplaced = _place_dropped(self._recent(), self._settled_end, end, dropped + self._unplaced)
            self._settled_end = max(self._settled_end, end)

    def all_runs(self, tail: MissingRun | None = None) -> list[MissingRun]:
        """Return all runs kept, as far as is known now; ``tail`` is missing behind the last sample."""
        settled = [run for run in self._runs if run.end <= self._settled_end]
        recent = [replace(run) for run in self._recent()]
        if tail is not None:
            recent.append(tail)
        left, start = self._unplaced, self._settled_end
        for end, dropped in self._marks:
            left = _place_dropped(recent, start, end, dropped + left)
            start = max(start, end)
        return settled + recent

    def totals(self, tail: MissingRun | None = None) -> MissingTotals:
        """Sum up all runs, those no longer kept as well."""
        return _total(self.all_runs(tail), self._gone)

    def _recent(self) -> list[MissingRun]:
        """Return the runs behind the last STATUS that is accounted for."""
        found: list[MissingRun] = []
        for run in reversed(self._runs):
            if run.end <= self._settled_end:
                break
            found.append(run)
        return found[::-1]


def _place_dropped(runs: Sequence[MissingRun], start: int, end: int, dropped: int) -> int:
    """Share out what the device dropped of the samples from ``start`` up to ``end``; return what finds no room.

    Where no damaged frame came first, and long runs before short ones: a full link makes a device drop many in a row.
    Last where the file lacks records, which explains a run of any length.
    """
    longest_first = sorted(runs, key=lambda run: (run.file_gap, run.damaged - run.missing))
    for spared in (True, False):
        for run in longest_first:
            within = min(run.end, end) - max(run.first, start)
            here = min(dropped, within, run.missing - run.dropped - (run.damaged if spared else 0))
            if here > 0:
                run.dropped += here
                dropped -= here
    return dropped


def _total(runs: Sequence[MissingRun], start: MissingTotals) -> MissingTotals:
    return MissingTotals(
        sum((run.missing for run in runs), start.missing),
        sum((run.rejected for run in runs), start.rejected),
        sum((run.dropped for run in runs), start.dropped),
        sum((run.damaged_in_file for run in runs), start.damaged_in_file),
    )


def missing_between(runs: Sequence[MissingRun], bounds: Sequence[int]) -> Iterator[MissingTotals]:
    """Sum up the runs, in order, between each two of n + 1 ascending sample numbers.

    A run across a bound is thought of as its dropped samples first, then the rejected, then the others.
    """
    rows = [(run.first, run.missing, run.rejected, run.dropped, run.damaged_in_file) for run in runs]
    first, missing, rejected, dropped, in_file = np.array(rows, dtype=np.int64).reshape(-1, 5).T
    sums = np.cumsum(np.vstack([missing, rejected, dropped, in_file]), axis=1)
    below = []
    for bound in bounds:
        whole = int(np.searchsorted(first + missing, bound, side="right"))
        total = sums[:, whole - 1].copy() if whole else np.zeros(4, np.int64)
        if whole < len(first) and first[whole] < bound:
            n = bound - first[whole]
            n_dropped = min(n, dropped[whole])
            n_rejected = min(n - n_dropped, rejected[whole])
            total += (n, n_rejected, n_dropped, min(n - n_dropped - n_rejected, in_file[whole]))
        below.append(total)
    for before, after in pairwise(below):
        yield MissingTotals(*(after - before).tolist())
