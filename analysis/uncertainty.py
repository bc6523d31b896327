"""How far to trust θ̄: confidence interval, the sensor's own drift, and the smallest drift that can be told from none.

Interval. With v_i the rotation vectors of the m steps and a the drift axis,

    half-width = t(0.975, m − 1) · max(SE_jackknife, SE_delta) · √((1 + ρ)/(1 − ρ)),   ρ = clip(lag-1 + 1/m, 0, 0.6)

SE_delta = s/√m with s² the variance of v_i·a; SE_jackknife from θ̄ with each step left out; lag-1 the autocorrelation
of the steps' scatter. The lower end is 0 when Hotelling's T² test of "no drift" (mean of v_i is zero) has p ≥ 0.05.
There is no interval for m ≤ 3. A percentile bootstrap was tried: it never covers at θ = 0 and covers 0.70–0.92 at
m = 5–20. The coverage of this one is in ``docs/benchmark.md``, from ``benchmarks/interval_coverage.py``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis import averages, rotations
from analysis.companions import leave_one_out
from analysis.series import FloatArray

LEVEL = 0.95
"""Confidence level of the interval."""
MIN_STEPS = 4
"""Fewer steps make no interval: Hotelling's test needs more steps than dimensions."""
MAX_CORRELATION = 0.6
"""The lag-1 correlation is not trusted beyond this: from a few steps it is mostly noise."""
SIGNIFICANCE = 0.05
"""p of Hotelling's test from which the lower end is 0."""


@dataclass(frozen=True)
class DriftInterval:
    """Confidence interval of θ̄, and what it was made of. Degrees."""

    n_steps: int
    """Number of steps m."""
    level: float
    """Confidence level."""
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
    """ρ that widened the interval: lag-1 correlation of the steps' scatter, with its bias mended, cut to 0 … 0.6."""
    no_drift_p: float
    """p of Hotelling's T² test that the mean step is zero."""

    @property
    def standard_error_deg(self) -> float:
        """The larger of the two standard errors, widened for correlation."""
        return max(self.jackknife_error_deg, self.delta_error_deg) * _widening(self.correlation)


def _widening(correlation: float) -> float:
    return float(np.sqrt((1.0 + correlation) / (1.0 - correlation)))


def drift_interval(steps_wxyz: FloatArray, level: float = LEVEL) -> DriftInterval | None:
    """Confidence interval of θ̄ from its steps.

    Parameters
    ----------
    steps_wxyz
        (m, 4) step rotations r_i, scalar first (:attr:`analysis.drift.RotationDrift.step_rotations_wxyz`).
    level
        Confidence level, in (0, 1).

    Returns
    -------
    DriftInterval, or None for fewer than ``MIN_STEPS`` steps.
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
    # Without any drift there is no axis; the scatter along the worst one stands in.
    along = scatter @ (axis / length) if length > 0.0 else np.linalg.norm(scatter, axis=1)
    delta = float(np.sqrt(np.sum(along**2) / (m - 1) / m))
    without = leave_one_out(steps_wxyz)
    jackknife = float(np.sqrt((m - 1) / m * np.sum((without - without.mean()) ** 2)))
    correlation = _lag_one(scatter)
    half = float(special.stdtrit(m - 1, 0.5 + 0.5 * level)) * max(jackknife, delta) * _widening(correlation)
    p_value = hotelling_p(vectors, _widening(correlation) ** 2)
    low = 0.0 if p_value >= SIGNIFICANCE else max(0.0, theta - half)
    return DriftInterval(
        n_steps=m,
        level=level,
        low_deg=float(np.degrees(low)),
        high_deg=float(np.degrees(min(theta + half, np.pi))),
        half_width_deg=float(np.degrees(half)),
        jackknife_error_deg=float(np.degrees(jackknife)),
        delta_error_deg=float(np.degrees(delta)),
        correlation=correlation,
        no_drift_p=p_value,
    )


def _lag_one(scatter: FloatArray) -> float:
    """Lag-1 correlation of the scatter, its bias of about −1/m mended, cut to [0, MAX_CORRELATION]."""
    power = float(np.sum(scatter**2))
    if power <= 0.0:
        return 0.0
    lag_one = float(np.sum(scatter[1:] * scatter[:-1])) / power
    return float(np.clip(lag_one + 1.0 / len(scatter), 0.0, MAX_CORRELATION))


def hotelling_p(vectors: FloatArray, variance_factor: float = 1.0) -> float:
    """Test that the mean of some vectors is zero: Hotelling's one-sample T².

    T² = m v̄ᵀ S⁻¹ v̄ and F = T² (m − k)/(k (m − 1)) with k, m − k degrees of freedom; k is the rank of the scatter S.
    Directions without any scatter are left out, unless the mean has a part along them: then no drift is excluded.

    Parameters
    ----------
    vectors
        (m, 3), m > 3.
    variance_factor
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


def heading_drift_bound_deg(rate_deg_per_min: float, period_s: float) -> float:
    """Rotation drift per cycle that the sensor's own heading drift can fake: rate × T.

    Parameters
    ----------
    rate_deg_per_min
        Heading drift, deg/min, either sign.
    period_s
        Length of a cycle, s.

    Returns
    -------
    deg per cycle.
    """
    return abs(rate_deg_per_min) * period_s / 60.0


def detectable_drift_deg(
    rate_deg_per_min: FloatArray,
    noise_deg: float,
    walk_deg_per_sqrt_s: float,
    period_s: float,
    n_endpoints: int,
    probability: float = 0.95,
) -> float:
    """Minimal detectable drift: what a static object scores, at the given probability, when cut every T.

    A static object scores θ̄ = |ω T + e|. The error e is the difference of the first and the last pose over n − 1
    steps: per axis its variance is (2 σ² + w² (n − 1) T)/(n − 1)², with σ the noise of a pose and w the random walk. So
    θ̄² is noncentral χ² with 3 degrees of freedom, whose quantile this returns. Heading drift keeps its size but not its
    direction between trials, so it counts in full.

    Parameters
    ----------
    rate_deg_per_min
        (3,) heading drift about the world axes, deg/min.
    noise_deg
        Noise of a pose at an end point, deg, root mean square of the rotation angle.
    walk_deg_per_sqrt_s
        Random walk of the orientation, deg/√s, root mean square of the rotation angle after 1 s.
    period_s
        Length of a cycle T, s.
    n_endpoints
        End points of the trial n.
    probability
        Share of static trials that score below.

    Returns
    -------
    deg per cycle.
    """
    from scipy import special

    steps = max(n_endpoints - 1, 1)
    offset = float(np.linalg.norm(rate_deg_per_min)) * period_s / 60.0
    variance = (2.0 * noise_deg**2 + walk_deg_per_sqrt_s**2 * steps * period_s) / 3.0 / steps**2
    if variance <= 0.0 or offset**2 / variance > 1e8:
        return offset
    return float(np.sqrt(variance * special.chndtrix(probability, 3, offset**2 / variance)))
