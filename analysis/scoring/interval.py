"""How far to trust θ̄: its confidence interval, and the number of steps that would make it narrow enough.

Interval. With v_i the rotation vectors of the m steps and a the drift axis,

    half-width = t(0.975, m − 1) · max(SE_jackknife, SE_delta) · √((1 + ρ)/(1 − ρ)),   ρ = clip(lag-1 + 1/m, 0, 0.6)

SE_delta = s/√m with s² the variance of v_i·a; SE_jackknife from θ̄ with each step left out; lag-1 the autocorrelation
of the steps' scatter. The lower end is 0 when Hotelling's T² test of "no drift" (mean of v_i is zero) has p ≥ 0.05.
There is no interval for m ≤ 3. A percentile bootstrap was tried: it never covers at θ = 0 and covers 0.70–0.92 at
m = 5–20. The coverage of this one is in ``docs/benchmark.md``, from ``benchmarks/interval_coverage.py``.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np

from analysis.geometry import averages, rotations
from analysis.series import FloatArray

LEVEL = 0.95
"""Confidence level of the interval."""
MIN_STEPS = 4
"""Fewer steps make no interval: Hotelling's test needs more steps than dimensions."""
MAX_CORRELATION = 0.6
"""The lag-1 correlation is not trusted beyond this: from a few steps it is mostly noise."""
NO_DRIFT = "cannot be distinguished from no drift"
"""What an interval that touches 0 means, in words."""
SIGNIFICANCE = 0.05
"""p of Hotelling's test from which the lower end is 0."""


@dataclass(frozen=True)
class DriftInterval:
    """Confidence interval of θ̄, and what it was made of. Degrees."""

    n_steps: int
    """Number of steps m."""
    level: float
    """Confidence level, 0.95."""
    low_deg: float
    """Lower end, ≥ 0; 0 when "no drift" cannot be excluded."""
    high_deg: float
    """Upper end, ≤ 180."""
    half_width_deg: float
    """Half-width before the ends were cut."""
    jackknife_error_deg: float
    """Standard error by leaving out one step."""
    delta_error_deg: float
    """Standard error from the scatter of the steps along the drift axis."""
    correlation: float
    """ρ that widened the interval: lag-1 correlation of the steps' scatter, with its bias corrected, cut to 0 … 0.6."""
    no_drift_p: float
    """p of Hotelling's T² test that the mean step is zero."""

    @property
    def standard_error_deg(self) -> float:
        """The larger of the two standard errors, widened for correlation."""
        return max(self.jackknife_error_deg, self.delta_error_deg) * _widening(self.correlation)


def _widening(correlation: float) -> float:
    return float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))


def drift_interval(steps_wxyz: FloatArray) -> DriftInterval | None:
    """Return the confidence interval of θ̄ from its steps; None for fewer than ``MIN_STEPS``.

    Parameters
    ----------
    steps_wxyz : (m, 4) float64
        Step rotations r_i, scalar first (:attr:`analysis.scoring.card.RotationDrift.step_rotations_wxyz`).
    """
    from scipy import special  # scipy.stats has nicer names, but takes longer to import than most scores to compute

    m = len(steps_wxyz)
    if m < MIN_STEPS:
        return None
    mean = averages.average(steps_wxyz)
    theta = float(rotations.angle(mean))
    vectors = rotations.log(steps_wxyz)
    scatter = vectors - vectors.mean(axis=0)
    axis = rotations.log(mean)
    length = float(np.linalg.norm(axis))
    # Without any drift there is no axis; the scatter along the worst one takes its place.
    along = scatter @ (axis / length) if length > 0.0 else np.linalg.norm(scatter, axis=1)
    delta = float(np.sqrt(np.sum(along**2) / (m - 1) / m))
    without = leave_one_out(steps_wxyz)
    jackknife = float(np.sqrt((m - 1) / m * np.sum((without - without.mean()) ** 2)))
    correlation = _lag_one(scatter)
    half = float(special.stdtrit(m - 1, 0.5 + 0.5 * LEVEL)) * max(jackknife, delta) * _widening(correlation)
    p_value = hotelling_p(vectors, _widening(correlation) ** 2)
    low = 0.0 if p_value >= SIGNIFICANCE else max(0.0, theta - half)
    return DriftInterval(
        n_steps=m,
        level=LEVEL,
        low_deg=float(np.degrees(low)),
        high_deg=float(np.degrees(min(theta + half, np.pi))),
        half_width_deg=float(np.degrees(half)),
        jackknife_error_deg=float(np.degrees(jackknife)),
        delta_error_deg=float(np.degrees(delta)),
        correlation=correlation,
        no_drift_p=p_value,
    )


def leave_one_out(steps_wxyz: FloatArray) -> FloatArray:
    """Return the angle of the average step with each step left out in turn.

    Parameters
    ----------
    steps_wxyz : (m, 4) float64
        Step rotations, m ≥ 2.

    Returns
    -------
    (m,) rad; the first is θ̄ without the first end point, the last θ̄ without the last.
    """
    # Relative to the average of all, so that small differences between the answers are not lost in rounding.
    mean = averages.average(steps_wxyz)
    relative = rotations.difference(steps_wxyz, mean)
    outer = relative[:, :, None] * relative[:, None, :]
    tops = np.linalg.eigh(outer.sum(axis=0) - outer)[1][:, :, -1]
    return rotations.angle(rotations.multiply(tops, mean))


def _lag_one(scatter: FloatArray) -> float:
    """Return the scatter's lag-1 correlation, corrected for its bias of about −1/m, cut to [0, MAX_CORRELATION]."""
    power = float(np.sum(scatter**2))
    if power <= 0.0:
        return 0.0
    lag_one = float(np.sum(scatter[1:] * scatter[:-1])) / power
    return float(np.clip(lag_one + 1.0 / len(scatter), 0.0, MAX_CORRELATION))


def hotelling_p(vectors: FloatArray, variance_factor: float) -> float:
    """Return how likely a mean of zero is: Hotelling's one-sample T².

    T² = m v̄ᵀ S⁻¹ v̄ and F = T² (m − k)/(k (m − 1)) with k, m − k degrees of freedom; k is the rank of the scatter S.
    Directions without any scatter are left out, unless the mean has a part along them: then no drift is excluded.

    Parameters
    ----------
    vectors : (m, 3) float64
        M > 3.
    variance_factor : float
        How much larger the variance of the mean is than for independent vectors, ≥ 1; T² is divided by it.

    Returns
    -------
    p value in [0, 1].
    """
    from scipy import special

    m = len(vectors)
    mean = vectors.mean(axis=0)
    scatter = vectors - mean
    values, directions = np.linalg.eigh(scatter.T @ scatter / (m - 1))
    scale = float(np.mean(vectors**2))
    if scale == 0.0:
        return 1.0
    real = values > 1e-14 * scale  # what rounding leaves is far below
    along = mean @ directions
    if np.abs(along[~real]).max(initial=0.0) > 1e-6 * np.sqrt(scale):
        return 0.0
    k = int(real.sum())
    if k == 0:
        return 1.0
    t_squared = m * float(np.sum(along[real] ** 2 / values[real])) / variance_factor
    return float(special.fdtrc(k, m - k, t_squared * (m - k) / (k * (m - 1))))


MAX_STEPS = 10_000
"""More steps than this are out of reach of a trial."""


def steps_needed(interval: DriftInterval, half_width_deg: float) -> int | None:
    """Return the smallest number of steps at which the interval would be narrow enough, if they go on to scatter so.

    The half-width is t(0.975, m − 1) times a standard error that falls with 1/√m; with SE the error at the present m₀,

        half-width(m) = t(0.975, m − 1) · SE · √(m₀ / m).

    ``half_width_deg`` is the wanted one, above 0. The answer is at least ``MIN_STEPS``; None where ``MAX_STEPS`` are
    not enough.
    """
    from scipy import special  # late, as above

    scale = interval.standard_error_deg * math.sqrt(interval.n_steps)
    level = 0.5 + 0.5 * interval.level

    def minus_half_width(m: int) -> float:  # bisect needs what rises
        return -float(special.stdtrit(m - 1, level)) * scale / math.sqrt(m)

    steps = range(MIN_STEPS, MAX_STEPS + 1)
    place = bisect.bisect_left(steps, -half_width_deg, key=minus_half_width)
    return steps[place] if place < len(steps) else None
