"""What stands beside θ̄ in a result, and the sentences that say when to distrust it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from analysis.cycles.search import Endpoint
from analysis.scoring.as_published import published_drift
from analysis.scoring.card import RotationDrift, rotation_drift, translation_drift_mm
from analysis.scoring.diagnostics import MIN_EIGENVALUE_SHARE, DriftCompanions, drift_companions, drift_over_phase
from analysis.scoring.interval import DriftInterval, drift_interval
from analysis.scoring.score_parts import OtherExtreme, ScoredEndpoint, SensorShare
from analysis.scoring.trial_score import TrialScore
from analysis.sensor.baseline import StaticBaseline, baseline_from_holds, heading_drift_bound_deg
from analysis.sensor.still_holds import still_holds
from analysis.series import FloatArray, OrientationSeries

IMU_HEADING_DEG_PER_MIN = (0.4, 6.0)
"""Heading drift of 6-axis IMUs without a baseline."""
MIN_REST_FOR_FLOOR_S = 10.0
"""Rests inside a trial shorter than this in all set no floor: a few seconds in a hand say little about the sensor."""
_SCATTER = 3.0  # mean step over θ̄ from which the scatter is worth a warning
_SENSITIVE = 1.5  # θ̄ without an end point over θ̄, or the other way round


def endpoint_quats(points: Sequence[ScoredEndpoint] | Sequence[Endpoint]) -> FloatArray:
    """Collect the orientations of end points.

    Parameters
    ----------
    points
        n end points.

    Returns
    -------
    (n, 4) scalar first.
    """
    return np.array([point.quat_wxyz for point in points], dtype=np.float64).reshape(-1, 4)


def with_figures(
    score: TrialScore,
    series: OrientationSeries,
    other: tuple[ScoredEndpoint, ...],
    baseline: StaticBaseline | None,
    published: tuple[bool, Sequence[npt.ArrayLike]],
) -> TrialScore:
    """Fill in θ̄ and all that stands beside it.

    Parameters
    ----------
    score
        A valid trial with its end points.
    series
        The recording.
    other
        End points of the other extreme.
    baseline
        The sensor at rest; None to look for rests inside the trial.
    published
        Whether to compute the authors' figure, and the end points of the motions before this one.

    Returns
    -------
    TrialScore
    """
    quats = endpoint_quats(score.endpoints)
    times_s = [point.time_s for point in score.endpoints]
    drift = rotation_drift(quats, [item.step for item in score.excluded])
    companions = drift_companions(quats, drift)
    interval = drift_interval(drift.counted_step_rotations_wxyz)
    sensor = _sensor_share(score, series, drift, baseline)
    return replace(
        score,
        drift=drift,
        companions=companions,
        interval=interval,
        phase=drift_over_phase(series, times_s),
        other=OtherExtreme(rotation_drift(endpoint_quats(other)) if len(other) >= 2 else None, other),
        translation_drift_mm=_translation(series, score.endpoints),
        sensor=sensor,
        published=published_drift(quats, published[1]) if published[0] else None,
        warnings=(*score.warnings, *_trust_warnings(score, drift, companions, interval, sensor)),
    )


def _translation(series: OrientationSeries, points: tuple[ScoredEndpoint, ...]) -> float | None:
    if series.positions_m is None:
        return None
    times_s = [point.time_s for point in points]
    at = [np.interp(times_s, series.times_s, series.positions_m[:, k]) for k in range(3)]
    return translation_drift_mm(np.stack(at, axis=1))


def _sensor_share(
    score: TrialScore, series: OrientationSeries, drift: RotationDrift, baseline: StaticBaseline | None
) -> SensorShare:
    period_s = score.period_s
    assert period_s is not None
    source = "baseline"
    if baseline is None:
        source, baseline = "rests", baseline_from_holds(still_holds(series, score.cycles.active_s))
    if baseline is None:
        low, high = (heading_drift_bound_deg(rate, period_s) for rate in IMU_HEADING_DEG_PER_MIN)
        note = f"no static baseline: a 6-axis IMU would add {low:.2g} to {high:.2g}° per cycle of its own"
        return SensorShare("unknown", None, None, None, None, note)
    share = baseline.per_cycle_deg(period_s)
    floor = baseline.detectable_deg(period_s, drift.n_endpoints)
    note = f"sensor at rest: {baseline.total_rate_deg_per_min:.2g}°/min, {share:.2g}° per cycle"
    if source == "rests":
        note += f", from {baseline.source}; an upper bound, the object may creep in the hand as well"
        if baseline.duration_s < MIN_REST_FOR_FLOOR_S:
            return SensorShare(source, baseline, share, None, None, f"{note}; too short to set a floor")
    note += f"; floor {floor:.2g}°: a resting object would score less in 95 of 100 such trials"
    return SensorShare(source, baseline, share, floor, drift.theta_bar_deg < floor, note)


def _trust_warnings(
    score: TrialScore,
    drift: RotationDrift,
    companions: DriftCompanions,
    interval: DriftInterval | None,
    sensor: SensorShare,
) -> list[str]:
    theta = drift.theta_bar_deg
    warnings = []
    if drift.top_eigenvalue_share < MIN_EIGENVALUE_SHARE:
        warnings.append(
            f"the steps hardly agree: top eigenvalue share {drift.top_eigenvalue_share:.3f}, "
            f"below {MIN_EIGENVALUE_SHARE}"
        )
    if companions.mean_step_deg > max(_SCATTER * theta, 0.1):
        warnings.append(f"θ̄ hides scatter: the mean step is {companions.mean_step_deg:.2f}°, θ̄ only {theta:.2f}°")
    for name, value in (("first", companions.without_first_deg), ("last", companions.without_last_deg)):
        if value is not None and max(value, theta) > _SENSITIVE * min(value, theta) and abs(value - theta) > 0.05:
            warnings.append(f"without the {name} end point θ̄ would be {value:.2f}° instead of {theta:.2f}°")
    if interval is None:
        warnings.append(f"{companions.n_steps} steps are too few for a confidence interval")
    if score.excluded:
        warnings.append(
            f"{len(score.excluded)} of {drift.n_endpoints - 1} cycles are left out by the operator, which the "
            "benchmark's card does not foresee; they are kept and listed"
        )
    flagged = sum(1 for point in score.endpoints if point.flags)
    if flagged:
        warnings.append(f"{flagged} of {len(score.endpoints)} end points are flagged as irregular; they are kept")
    if sensor.below_floor:
        warnings.append(
            f"below the sensor's floor: a resting object would score up to {sensor.detectable_deg:.2g}° in such a trial"
        )
    elif sensor.source == "unknown" and score.index_kind == "sequence":
        warnings.append(sensor.note)
    return warnings
