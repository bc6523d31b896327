"""Cycles of several peaks, live: which of the extremes of one kind ends the cycle."""

from __future__ import annotations

from collections import deque

import numpy as np

from analysis.cycles.settings import Endpoint
from analysis.series import FloatArray, IntArray

_MAX_PEAKS = 3
_KEPT = 64  # extremes that can still be sorted when the pattern is found
_CYCLES = 4  # of the pattern, before it is believed
_MIN_UNEVEN = 0.1
_MAX_REPEAT = 0.25
_BROKEN = 0.6


class PeakFilter:
    """Pass one extreme per cycle where heights or distances of the extremes repeat in a pattern of two or three.

    Heights of one peak per cycle lie on a line: drift. With p peaks they lie on p parallel lines, and how far they are
    from these must be little against how far they are from one line. The same for the distances between the extremes.
    The highest peak (the lowest, for lower extremes) is the one that is passed, as in the offline search. A pattern
    that breaks is given up.

    Parameters
    ----------
    sign : float
        1 for upper extremes, −1 for lower ones.
    """

    def __init__(self, sign: float) -> None:
        self.per_cycle = 1
        """Extremes of one kind per cycle, as far as known."""
        self._sign = sign
        self._number = 0
        self._recent: deque[tuple[int, float, Endpoint]] = deque(maxlen=_KEPT)

    def add(self, endpoint: Endpoint, angle_rad: float, swing_rad: float) -> tuple[list[Endpoint], bool]:
        """Receive the next extreme, with the angle about the motion axis there and the usual swing, rad.

        Returns
        -------
        endpoints, restarted
            Where ``restarted``, the pattern was found just now: everything passed on before is void, and ``endpoints``
            are all that remain of the recent ones.
        """
        self._recent.append((self._number, self._sign * angle_rad, endpoint))
        self._number += 1
        if self.per_cycle == 1:
            self.per_cycle = self._pattern(swing_rad)
            if self.per_cycle > 1:
                best = self._best()
                return [point for number, _, point in self._recent if number % self.per_cycle == best], True
        elif not self._repeats(self.per_cycle, swing_rad, _BROKEN):
            self.per_cycle = 1
        return ([endpoint], False) if (self._number - 1) % self.per_cycle == self._best() else ([], False)

    def _pattern(self, swing_rad: float) -> int:
        for peaks in range(2, _MAX_PEAKS + 1):
            if len(self._recent) > _CYCLES * peaks and self._repeats(peaks, swing_rad, _MAX_REPEAT):
                return peaks
        return 1

    def _repeats(self, peaks: int, swing_rad: float, limit: float) -> bool:
        """Return whether the recent heights, or the recent distances, are uneven and repeat with so many peaks."""
        last = list(self._recent)[-_CYCLES * peaks - 1 :]
        number = np.array([item[0] for item in last])
        height = np.array([item[1] for item in last])
        times_s = np.array([item[2].time_s for item in last])
        usual_s = float(np.median(np.diff(times_s)))

        def repeats(values: FloatArray, scale: float, at: IntArray) -> bool:
            uneven = _misfit(values, at, 1)
            return uneven > _MIN_UNEVEN * scale and _misfit(values, at, peaks) < limit * uneven

        return repeats(height, swing_rad, number) or repeats(np.diff(times_s), usual_s, number[1:])

    def _best(self) -> int:
        """Return the place of the highest peak in the pattern."""
        if self.per_cycle == 1:
            return 0
        last = list(self._recent)[-3 * self.per_cycle :]

        def mean_height(place: int) -> float:
            heights = [height for number, height, _ in last if number % self.per_cycle == place]
            return sum(heights) / len(heights)

        return max(range(self.per_cycle), key=mean_height)


def _misfit(values: FloatArray, number: IntArray, peaks: int) -> float:
    """Return the standard deviation of values from as many parallel lines as there are peaks."""
    place = number % peaks == np.arange(peaks)[:, None]
    parts = np.concatenate((place.astype(np.float64), (number - number[0])[None, :].astype(np.float64)))
    fit = np.linalg.lstsq(parts.T, values, rcond=None)[0]
    return float(np.sqrt(np.sum((values - fit @ parts) ** 2) / max(len(values) - peaks - 1, 1)))
