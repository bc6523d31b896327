"""Where damaged frames came, and where the file lacks records: among which samples, so that the ledger can place it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]


class DamagePlaces:
    """Counts samples as they come and as they are placed, and keeps damaged frames until their neighbours are placed.

    The decoder reports a damaged frame by the number of samples it delivered before it. Samples may be held back in
    between, or left out, so the two counts differ for a while; both are of every sample, whosever it is.
    """

    def __init__(self) -> None:
        self.n_came = 0
        self.n_placed = 0
        """Of those that came, samples that are not held back any more."""
        self._damaged: deque[int] = deque()  # after how many samples that came
        self._gaps: deque[int] = deque()  # of the file: the same

    def add(self, places: Iterable[int]) -> None:
        """Enter damaged frames by how many samples came before each, ascending."""
        self._damaged.extend(places)

    def add_gap(self) -> None:
        """Note that the file lacks records behind all that came so far."""
        if not self._gaps or self._gaps[-1] != self.n_came:
            self._gaps.append(self.n_came)

    def take_gap(self) -> bool:
        """Return whether the file lacks records in front of the next sample that is placed, and forget these."""
        found = False
        while self._gaps and self._gaps[0] <= self.n_placed:
            self._gaps.popleft()
            found = True
        return found

    def pass_over(self) -> None:
        """Count all that came as placed: what is not held back any more was placed or left out."""
        self.n_placed = self.n_came

    def place(self, n: int) -> IntArray | None:
        """Place the next n samples; return how many damaged frames (n,) came just before each, None for none."""
        first, self.n_placed = self.n_placed, self.n_placed + n
        if not self._damaged or self._damaged[0] >= self.n_placed:
            return None
        counts = np.zeros(n, np.int64)
        while self._damaged and self._damaged[0] < self.n_placed:
            counts[max(self._damaged.popleft() - first, 0)] += 1
        return counts

    def refuse(self, n: int) -> None:
        """Count the next n samples as damaged frames: they came whole, but cannot be."""
        self.n_placed += n
        before = 0
        while self._damaged and self._damaged[0] <= self.n_placed:
            self._damaged.popleft()
            before += 1
        self._damaged.extendleft([self.n_placed] * (before + n))

    def take_behind(self) -> int:
        """Return how many damaged frames came behind the last sample placed, and forget them."""
        n = 0
        while self._damaged and self._damaged[0] <= self.n_placed:
            self._damaged.popleft()
            n += 1
        return n
