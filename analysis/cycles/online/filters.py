"""Before end points are found live: lone outliers of a tracker are kept out, several humps a cycle sorted."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from analysis.cycles.online.angle import Quaternion
from analysis.cycles.settings import Endpoint
from analysis.cycles.usable_samples import MIN_OUTLIER_RAD, OUTLIER_FACTOR
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


TimedSample = tuple[float, Quaternion, int]
"""Time, s; orientation; name."""


class OutlierFilter:
    """Hold back a sample that steps far away until the next one tells whether it stands alone.

    The causal form of :func:`analysis.cycles.usable_samples.lone_outliers`: of the steps around it only the two before
    are known.
    """

    def __init__(self) -> None:
        self._before: Quaternion | None = None
        self._held: TimedSample | None = None
        self._steps = (math.inf, math.inf)  # the two before: the first three samples are never held back

    def add(self, sample: TimedSample) -> tuple[TimedSample, ...]:
        """Take the next sample and give those that are known to be good, oldest first."""
        before, held = self._before, self._held
        if before is None:
            self._before = sample[1]
            return (sample,)
        step = _angle_rad(before, sample[1])
        if held is None:
            if step > self._limit_rad():
                self._held = sample
                return ()
            return self._passed(step, sample)
        self._held = None
        apart = min(_angle_rad(before, held[1]), _angle_rad(held[1], sample[1]))
        if apart > self._limit_rad() and apart > 2.0 * step:
            return self._passed(step, sample)
        self._passed(_angle_rad(before, held[1]), held)
        return (held, *self._passed(_angle_rad(held[1], sample[1]), sample))

    def flush(self) -> tuple[TimedSample, ...]:
        """Give the sample still held back."""
        held, self._held = self._held, None
        return () if held is None else (held,)

    def _limit_rad(self) -> float:
        return MIN_OUTLIER_RAD + OUTLIER_FACTOR * max(self._steps)

    def _passed(self, step: float, sample: TimedSample) -> tuple[TimedSample]:
        self._steps = (self._steps[1], step)
        self._before = sample[1]
        return (sample,)


def _angle_rad(a: Quaternion, b: Quaternion) -> float:
    return 2.0 * math.acos(min(abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]), 1.0))
