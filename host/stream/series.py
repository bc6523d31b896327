"""Samples of a trial put together into one series as they come, each copied once: memory for an hour is what costs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from analysis.series import OrientationSeries
from host.stream.blocks import SampleBlock

Number = TypeVar("Number", np.int64, np.float64)

FIRST_SAMPLES = 1 << 16
GROWTH = 1.25
"""Memory is reserved for so many times what there is; most systems then only move pages, no bytes."""
MARGIN = 1.03
"""Where it is known which share came, memory is reserved for all, and a little more ..."""
LARGEST_GROWTH = 16
"""... up to so many times what there is."""


class SampleGatherer:
    """Gathers blocks in wire order; ``share`` returns which share of all samples came at least, 0 if not known."""

    def __init__(self, share: Callable[[], float] = lambda: 0.0) -> None:
        self._share = share
        self._n = 0
        self._index = np.empty(FIRST_SAMPLES, np.int64)
        self._time_s = np.empty(FIRST_SAMPLES)
        self._quats = np.empty((FIRST_SAMPLES, 4))

    def add(self, blocks: Iterable[SampleBlock]) -> None:
        """Append samples."""
        for block in blocks:
            first, last = self._n, self._n + len(block)
            if last > len(self._index):
                self._grow(last)
            self._index[first:last] = block.index
            self._time_s[first:last] = block.time_s
            self._quats[first:last] = block.quats_wxyz
            self._n = last

    def _grow(self, n: int) -> None:
        """Reserve memory for n samples, and for those that will follow."""
        share = self._share()
        expected = int(min(MARGIN * n / share, LARGEST_GROWTH * n)) if share > 0.0 else 0
        if expected > GROWTH * n:  # new memory: for so much, most systems use large pages
            self._index = _moved(self._index, expected, self._n)
            self._time_s = _moved(self._time_s, expected, self._n)
            self._quats = _moved(self._quats, expected, self._n)
        else:
            for column in (self._index, self._time_s, self._quats):
                column.resize((int(GROWTH * n), *column.shape[1:]), refcheck=False)  # nobody else has seen them

    def series(self, source: str, notes: Iterable[str] = ()) -> OrientationSeries:
        """Return the series, late samples put where they belong; ``source`` and ``notes`` are for people.

        Nothing can be added after it.

        Raises
        ------
        SeriesError
            The samples cannot be a series.
        """
        notes = list(notes)
        index, time_s, quats = self._index[: self._n], self._time_s[: self._n], self._quats[: self._n]
        if not (index[1:] > index[:-1]).all():
            order = np.argsort(index, kind="stable")
            index, time_s, quats = index[order], time_s[order], quats[order]
        if not (time_s[1:] > time_s[:-1]).all():
            forward = time_s > np.concatenate(([-np.inf], np.maximum.accumulate(time_s)[:-1]))
            notes.append(f"{int((~forward).sum())} samples whose device time did not increase were left out")
            index, time_s, quats = index[forward], time_s[forward], quats[forward]
        return OrientationSeries(time_s, quats, index, "sequence", source=source, notes=tuple(notes))


def _moved(array: npt.NDArray[Number], capacity: int, n: int) -> npt.NDArray[Number]:
    moved = np.empty((capacity, *array.shape[1:]), array.dtype)
    moved[:n] = array[:n]
    return moved
