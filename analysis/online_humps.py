"""Which of several humps in a cycle is the end point, judged as they come."""

from __future__ import annotations

from collections import deque
from statistics import median

from analysis.cycle_analysis import Endpoint

_MAX_HUMPS = 3
_MIN_UNEVEN = 0.1
_MAX_REPEAT = 0.3


class HumpFilter:
    """Pass one extreme per cycle where the heights of the extremes repeat in a pattern of two or three.

    Heights L of one hump per cycle differ by drift alone. With h humps, L_{i+h} − L_i is steady while L_{i+1} − L_i
    is not. The highest hump (the lowest, for lower extremes) is the one that is passed, as in the offline search.

    Parameters
    ----------
    sign
        1 for upper extremes, −1 for lower ones.
    """

    def __init__(self, sign: float) -> None:
        self.humps = 1
        """Extremes of one kind per cycle, as far as known."""
        self._sign = sign
        self._number = 0
        self._recent: deque[tuple[int, float, Endpoint]] = deque(maxlen=4 * _MAX_HUMPS)

    def add(self, endpoint: Endpoint, angle_rad: float, swing_rad: float) -> tuple[list[Endpoint], bool]:
        """Take the next extreme and give what is to be passed on.

        Parameters
        ----------
        endpoint
            The extreme.
        angle_rad
            Angle about the motion axis there, rad.
        swing_rad
            Usual swing, rad.

        Returns
        -------
        endpoints, anew
            Where ``anew``, the pattern was found just now: everything passed on before is void, and ``endpoints``
            are all that remain of the recent ones.
        """
        self._recent.append((self._number, self._sign * angle_rad, endpoint))
        self._number += 1
        if self.humps == 1:
            self.humps = self._pattern(swing_rad)
            if self.humps > 1:
                best = self._best()
                return [point for number, _, point in self._recent if number % self.humps == best], True
        return ([endpoint], False) if (self._number - 1) % self.humps == self._best() else ([], False)

    def _pattern(self, swing_rad: float) -> int:
        heights = [height for _, height, _ in self._recent]
        uneven = _spread(heights, 1)
        for humps in range(2, _MAX_HUMPS + 1):
            enough = len(heights) >= 2 * humps + 2
            if enough and uneven > _MIN_UNEVEN * swing_rad and _spread(heights, humps) < _MAX_REPEAT * uneven:
                return humps
        return 1

    def _best(self) -> int:
        """Place in the pattern of the highest hump."""
        if self.humps == 1:
            return 0
        last = list(self._recent)[-3 * self.humps :]
        mean = {}
        for place in range(self.humps):
            heights = [height for number, height, _ in last if number % self.humps == place]
            mean[place] = sum(heights) / len(heights)
        return max(mean, key=lambda place: mean[place])


def _spread(heights: list[float], lag: int) -> float:
    """Median deviation of the differences at a lag from their median: steady drift gives 0."""
    steps = [later - earlier for earlier, later in zip(heights, heights[lag:], strict=False)]
    if not steps:
        return 0.0
    middle = median(steps)
    return median(abs(step - middle) for step in steps)
