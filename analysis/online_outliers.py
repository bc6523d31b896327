"""Lone outliers of a tracker kept out of the live search: a suspicious sample waits for the one after it."""

from __future__ import annotations

import math

from analysis.online_angle import Quaternion
from analysis.usable_samples import MIN_OUTLIER_RAD, OUTLIER_FACTOR

TimedSample = tuple[float, Quaternion, int]
"""Time, s; orientation; name."""


class OutlierFilter:
    """Hold back a sample that steps far away until the next one tells whether it stands alone.

    The causal form of :func:`analysis.usable_samples.lone_outliers`: of the steps around it only the two before are
    known.
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
