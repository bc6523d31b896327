"""Which of several humps in a cycle is the end point, judged as they come."""

from __future__ import annotations

from collections import deque

import numpy as np

from analysis.cycle_analysis import Endpoint
from analysis.series import FloatArray, IntArray

_MAX_HUMPS = 3
_KEPT = 64  # extremes that can still be sorted when the pattern is found
_CYCLES = 4  # of the pattern, before it is believed
_MIN_UNEVEN = 0.1
_MAX_REPEAT = 0.25
_BROKEN = 0.6


class HumpFilter:
    """Pass one extreme per cycle where heights or distances of the extremes repeat in a pattern of two or three.

    Heights of one hump per cycle lie on a line: drift. With h humps they lie on h parallel lines, and how far they are
    from these must be little against how far they are from one line. The same for the distances between the extremes.
    The highest hump (the lowest, for lower extremes) is the one that is passed, as in the offline search. A pattern
    that breaks is given up.

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
        self._recent: deque[tuple[int, float, Endpoint]] = deque(maxlen=_KEPT)

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
        elif not any(self._repeats(humps=self.humps, swing_rad=swing_rad, limit=_BROKEN)):
            self.humps = 1
        return ([endpoint], False) if (self._number - 1) % self.humps == self._best() else ([], False)

    def _pattern(self, swing_rad: float) -> int:
        for humps in range(2, _MAX_HUMPS + 1):
            if len(self._recent) > _CYCLES * humps and any(self._repeats(humps, swing_rad, _MAX_REPEAT)):
                return humps
        return 1

    def _repeats(self, humps: int, swing_rad: float, limit: float) -> tuple[bool, bool]:
        """Whether the recent heights, and the recent distances, are uneven and repeat with as many humps."""
        last = list(self._recent)[-_CYCLES * humps - 1 :]
        number = np.array([item[0] for item in last])
        height = np.array([item[1] for item in last])
        times_s = np.array([item[2].time_s for item in last])
        usual_s = float(np.median(np.diff(times_s)))
        result = []
        for values, scale, at in ((height, swing_rad, number), (np.diff(times_s), usual_s, number[1:])):
            uneven = _misfit(values, at, 1)
            result.append(uneven > _MIN_UNEVEN * scale and _misfit(values, at, humps) < limit * uneven)
        return result[0], result[1]

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


def _misfit(values: FloatArray, number: IntArray, humps: int) -> float:
    """Give the standard deviation of values from as many parallel lines as there are humps."""
    place = number % humps == np.arange(humps)[:, None]
    parts = np.concatenate((place.astype(np.float64), (number - number[0])[None, :].astype(np.float64)))
    fit = np.linalg.lstsq(parts.T, values, rcond=None)[0]
    return float(np.sqrt(np.sum((values - fit @ parts) ** 2) / max(len(values) - humps - 1, 1)))
