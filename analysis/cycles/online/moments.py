"""A stream of samples as moments: lone outliers of a tracker kept out, samples close together averaged."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from analysis.cycles.online.angle import BIN_S, Quaternion
from analysis.cycles.usable_samples import MIN_OUTLIER_RAD, OUTLIER_FACTOR

TimedSample = tuple[float, Quaternion, int]
"""Time, s; orientation; name."""


class Moments:
    """Turn samples in time order into moments, each the average of a bin of samples."""

    def __init__(self) -> None:
        self.width_s = BIN_S
        """Samples closer together than this make one moment, s; may be changed at any time."""
        self._outliers = OutlierFilter()
        self._bin: list[TimedSample] = []
        self._last_s = -math.inf

    def feed(self, samples: Iterable[TimedSample]) -> Iterator[TimedSample]:
        """Yield the moments that further samples complete.

        A sample that is not later than the one before, or not a number, is passed over.
        """
        for sample in samples:
            time_s, (w, x, y, z), _ = sample
            if not math.isfinite(time_s + w + x + y + z) or time_s <= self._last_s:
                continue
            self._last_s = time_s
            for sound in self._outliers.add(sample):
                if self._bin and sound[0] - self._bin[0][0] < self.width_s * 0.999:
                    self._bin.append(sound)
                    continue
                if self._bin:
                    yield _average(self._bin)
                self._bin = [sound]

    def flush(self) -> Iterator[TimedSample]:
        """Yield the moment of the samples still held back."""
        self._bin += self._outliers.flush()
        if self._bin:
            yield _average(self._bin)
        self._bin = []


def _average(samples: list[TimedSample]) -> TimedSample:
    """Return mean time, mean orientation and the name of the middle one of samples close together."""
    if len(samples) == 1:
        return samples[0]
    w0, x0, y0, z0 = samples[0][1]
    w = x = y = z = total_s = 0.0
    for at_s, (a, b, c, d), _ in samples:
        sign = -1.0 if a * w0 + b * x0 + c * y0 + d * z0 < 0.0 else 1.0
        w, x, y, z, total_s = w + sign * a, x + sign * b, y + sign * c, z + sign * d, total_s + at_s
    length = math.sqrt(w * w + x * x + y * y + z * z)
    mean = (w / length, x / length, y / length, z / length)
    return total_s / len(samples), mean, samples[len(samples) // 2][2]


class OutlierFilter:
    """Hold back a sample that steps far away until the next one shows whether it stands alone.

    The causal form of :func:`analysis.cycles.usable_samples.lone_outliers`: of the steps around it only the two before
    are known.
    """

    def __init__(self) -> None:
        self._before: Quaternion | None = None
        self._held: TimedSample | None = None
        self._steps = (math.inf, math.inf)  # the two before: the first three samples are never held back

    def add(self, sample: TimedSample) -> tuple[TimedSample, ...]:
        """Receive the next sample and return those that are known to be good, oldest first."""
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
        """Return the sample still held back."""
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
