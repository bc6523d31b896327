"""The samples of a recording that can be worked with, their noise, and the orientation at any moment between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry import averages, rotations
from analysis.series import BoolArray, FloatArray, IntArray, OrientationSeries

MIN_STEP_S = 1e-4
"""Samples closer than this to the one before are double deliveries of the same moment, s."""
MIN_OUTLIER_RAD = 0.5 * np.pi / 180.0
"""A lone outlier is at least this far from both neighbours."""
OUTLIER_FACTOR = 5.0
"""And by this many times the steps before and after these."""

_BLOCK = 8192  # neighbours compared together: stays in the cache
_GROUP = 256  # moments averaged together
_MAX_TRIPLES = 20_000  # their median is good to a hundredth


@dataclass(frozen=True, eq=False)
class Samples:
    """Usable samples of a recording: all but double deliveries and lone outliers."""

    times_s: FloatArray
    """(n,) strictly increasing, s."""
    quats_wxyz: FloatArray
    """(n, 4) unit, scalar first."""
    index: IntArray
    """(n,) names of the samples in their source."""
    usual_step_s: float
    """Median distance between samples, s."""
    longest_step_s: float
    """Largest distance between samples, s."""
    noise_rad: float
    """Noise of a single sample about each axis, rad."""
    outliers: int
    """Lone outliers set aside."""

    @staticmethod
    def of(series: OrientationSeries) -> Samples:
        """Return the usable samples of a recording of any length."""
        samples = (series.times_s, series.quats_wxyz, series.index)
        single = np.diff(series.times_s) >= MIN_STEP_S
        if not single.all():
            single = np.concatenate(([True], single))
            samples = (samples[0][single], samples[1][single], samples[2][single])
        outliers = lone_outliers(samples[1])
        if len(outliers):
            kept = np.ones(len(samples[0]), dtype=bool)
            kept[outliers] = False
            samples = (samples[0][kept], samples[1][kept], samples[2][kept])
        times_s, quats, index = samples
        steps_s = np.diff(times_s) if len(times_s) > 1 else np.array([np.nan])
        longest_s, usual_s = float(steps_s.max()), float(np.median(steps_s, overwrite_input=True))
        return Samples(times_s, quats, index, usual_s, longest_s, sample_noise_rad(quats), len(outliers))

    def brackets_s(self, moments_s: FloatArray) -> FloatArray:
        """Return (k,) distance between the samples around each of k moments, s; infinite outside the data."""
        times_s, n = self.times_s, len(self.times_s)
        right = np.searchsorted(times_s, moments_s)
        inside = (right > 0) & (right < n)
        found = np.where(moments_s == times_s[0], 0.0, np.inf)
        found[inside] = times_s[right[inside]] - times_s[right[inside] - 1]
        return found

    def have_gaps(self, starts_s: FloatArray, ends_s: FloatArray, longest_s: float) -> BoolArray:
        """Return (k,) whether neighbours within each of k intervals, or at its ends, are further apart than that."""
        if self.longest_step_s <= longest_s:
            return np.zeros(len(starts_s), dtype=bool)
        gaps = np.flatnonzero(np.diff(self.times_s) > longest_s)
        first = np.maximum(np.searchsorted(self.times_s, starts_s) - 1, 0)
        last = np.searchsorted(self.times_s, ends_s)
        return np.asarray(np.searchsorted(gaps, first) < np.searchsorted(gaps, last))

    def nearest(self, moments_s: FloatArray) -> IntArray:
        """Return (k,) names of the samples nearest to k moments."""
        right = np.clip(np.searchsorted(self.times_s, moments_s), 1, len(self.times_s) - 1)
        nearer_left = moments_s - self.times_s[right - 1] <= self.times_s[right] - moments_s
        return np.asarray(self.index[right - nearer_left])

    def orientations(self, moments_s: FloatArray, reach_s: float) -> FloatArray:
        """Return (k, 4) averages of the samples around k moments, weights falling linearly to 0 at ``reach_s``.

        At least the three nearest samples are used. Each stands for the time around it, so that the average is one
        over time and lost samples do not pull it to one side. The weights fall to 0, so that a moment that shifts by a
        rounding error never gains or loses a whole sample.
        """
        times_s, n = self.times_s, len(self.times_s)
        near = np.searchsorted(times_s, moments_s)[:, None] + np.arange(-3, 3)
        away = np.abs(times_s[np.clip(near, 0, n - 1)] - moments_s[:, None])
        away[(near < 0) | (near >= n)] = np.inf
        fourth = np.sort(away, axis=1)[:, min(3, n - 1)]
        furthest = np.where(np.isfinite(away), away, 0.0).max(axis=1)  # where there are fewer than four
        reach = np.maximum(reach_s, np.where(np.isfinite(fourth), fourth, furthest))
        first = np.searchsorted(times_s, moments_s - reach)
        last = np.maximum(np.searchsorted(times_s, moments_s + reach), first + 1)
        found = np.empty((len(moments_s), 4))
        # Groups of similar size together: one between lost samples must not make all others as long.
        order = np.argsort(last - first, kind="stable")
        at = 0
        while at < len(order):
            group = order[at : at + _GROUP]
            at += len(group)
            rows = first[group, None] + np.arange(int((last - first)[group].max()))
            inside = rows < last[group, None]
            rows = np.minimum(rows, n - 1)
            right, left = np.minimum(rows + 1, n - 1), np.maximum(rows - 1, 0)
            own = (times_s[right] - times_s[left]) / (right - left)
            weights = np.maximum(1.0 - np.abs(times_s[rows] - moments_s[group, None]) / reach[group, None], 0.0)
            found[group] = averages.average(self.quats_wxyz[rows], np.where(inside, weights * own, 0.0))
        return found


def lone_outliers(quats_wxyz: FloatArray) -> IntArray:
    """Find single samples that a tracker got wrong.

    One stands apart from both neighbours by more than half a degree and five times any of the two steps before and
    after these, while the neighbours agree with each other. The tip of a fast stroke does not: the object comes and
    goes with as large steps.

    Parameters
    ----------
    quats_wxyz : array of float
        (n, 4) unit.

    Returns
    -------
    (k,) places, increasing.
    """
    far = np.empty(max(len(quats_wxyz) - 1, 0), dtype=np.bool_)
    for first in range(0, len(far), _BLOCK):
        last = min(first + _BLOCK, len(far))
        cosines = np.einsum("ij,ij->i", quats_wxyz[first + 1 : last + 1], quats_wxyz[first:last])
        np.less(np.abs(cosines, out=cosines), np.cos(0.5 * MIN_OUTLIER_RAD), out=far[first:last])
    places = 1 + np.flatnonzero(far[1:] & far[:-1])
    places = places[(places >= 3) & (places < len(quats_wxyz) - 3)]
    if len(places) == 0:
        return places
    around = quats_wxyz[places[:, None] + np.arange(-3, 4)]
    steps = rotations.distance(around[:, 1:], around[:, :-1])
    apart, usual = steps[:, 2:4].min(axis=1), steps[:, [0, 1, 4, 5]].max(axis=1)
    across = rotations.distance(around[:, 4], around[:, 2])
    lone = (apart > MIN_OUTLIER_RAD + OUTLIER_FACTOR * usual) & (apart > 2.0 * across)
    return np.asarray(places[lone], dtype=np.int64)


def sample_noise_rad(quats_wxyz: FloatArray) -> float:
    """Return the noise of single samples about each axis, from how far each lies off the middle of its neighbours.

    For independent noise σ per axis that distance has the median 1.884 σ: √1.5 times the median length of a
    three-dimensional normal vector.

    Parameters
    ----------
    quats_wxyz : array of float
        (n, 4) unit; evenly picked triples where there are very many.

    Returns
    -------
    σ, rad, never below what the curvature of the motion makes of it; 0 for fewer than three samples.
    """
    if len(quats_wxyz) < 3:
        return 0.0
    middle = np.arange(1, len(quats_wxyz) - 1, max(len(quats_wxyz) // _MAX_TRIPLES, 1))
    between = rotations.slerp(quats_wxyz[middle - 1], quats_wxyz[middle + 1], np.full(len(middle), 0.5))
    return float(np.median(rotations.distance(quats_wxyz[middle], between))) / 1.884
