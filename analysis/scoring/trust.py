"""What stands beside θ̄ in a result, and the warnings when to distrust it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy.typing as npt
from msgspec.structs import replace

from analysis.scoring.as_published import published_drift
from analysis.scoring.card import RotationDrift, rotation_drift, translation_drift_mm
from analysis.scoring.diagnostics import MIN_EIGENVALUE_SHARE, drift_diagnostics, drift_over_phase, positions_at
from analysis.scoring.interval import NO_DRIFT, drift_interval
from analysis.scoring.result import Result, endpoint_quats
from analysis.scoring.result_parts import Diagnostics, OtherExtreme, ScoredEndpoint, SensorShare, vector_of
from analysis.scoring.slip import find_slip
from analysis.sensor.baseline import StaticBaseline, baseline_from_holds
from analysis.sensor.still_holds import still_holds
from analysis.series import OrientationSeries

IMU_HEADING_DEG_PER_MIN = (0.4, 6.0)
"""Heading drift of 6-axis IMUs without a baseline."""
MIN_REST_FOR_FLOOR_S = 10.0
"""Rests inside a trial shorter than this in all set no floor: a few seconds in a hand are no measure of the sensor."""
_SCATTER = 3.0  # mean step over θ̄ from which the scatter is worth a warning
_SENSITIVE = 1.5  # θ̄ without an end point over θ̄, or the other way round


def with_figures(
    result: Result,
    series: OrientationSeries,
    other: tuple[ScoredEndpoint, ...],
    baseline: StaticBaseline | None,
    preceding: Sequence[npt.ArrayLike] | None,
) -> Result:
    """Return a valid result with θ̄ and all that stands beside it.

    Parameters
    ----------
    result : Result
        A valid trial with its end points.
    series : OrientationSeries
        The recording.
    other : tuple of ScoredEndpoint
        End points of the other extreme.
    baseline : StaticBaseline or None
        The sensor at rest; None to look for rests inside the trial.
    preceding : sequence of (m, 4) array_like or None
        End points of the motions before this one, for the authors' figure; None not to compute it.
    """
    quats = result.endpoint_quats_wxyz
    drift = rotation_drift(quats, [item.step for item in result.excluded_cycles])
    slip = find_slip(drift)
    interval = drift_interval(drift.counted_step_rotations_wxyz)
    positions_m = positions_at(series, result.endpoint_times_s)
    companions = replace(
        drift_diagnostics(quats, drift),
        over_phase_deg=drift_over_phase(series, result.endpoint_times_s),
        interval=interval,
        translation_drift_mm=None if positions_m is None else translation_drift_mm(positions_m),
    )
    sensor = _sensor_share(result, series, drift, baseline)
    warnings = _trust_warnings(result, drift.theta_bar_deg, companions, sensor, series.index_kind)
    return replace(
        result,
        theta_bar_deg=drift.theta_bar_deg,
        axis=vector_of(drift.axis),
        interval_deg=None if interval is None else (interval.low_deg, interval.high_deg),
        steps_deg=tuple(drift.steps_deg.tolist()),
        other_extreme=_other_extreme(other),
        companions=companions,
        sensor=sensor,
        as_published=None if preceding is None else published_drift(quats, preceding),
        warnings=(*result.warnings, *([] if slip is None else [slip.sentence]), *warnings),
    )


def _other_extreme(points: tuple[ScoredEndpoint, ...]) -> OtherExtreme:
    if len(points) < 2:
        return OtherExtreme(None, None, len(points), points)
    drift = rotation_drift(endpoint_quats(points))
    return OtherExtreme(drift.theta_bar_deg, vector_of(drift.axis), len(points), points)


def _sensor_share(
    result: Result, series: OrientationSeries, drift: RotationDrift, baseline: StaticBaseline | None
) -> SensorShare:
    period_s = result.period_s
    assert period_s is not None
    source = "baseline"
    if baseline is None:
        source, baseline = "rests", baseline_from_holds(still_holds(series, result.cycles.active_s))
    if baseline is None:
        low, high = (rate * period_s / 60.0 for rate in IMU_HEADING_DEG_PER_MIN)
        note = f"no static baseline: a 6-axis IMU would add {low:.2g} to {high:.2g}° per cycle of its own"
        return SensorShare("unknown", None, None, None, note, None)
    share = baseline.per_cycle_deg(period_s)
    floor = baseline.detectable_deg(period_s, result.n_endpoints)
    note = f"sensor at rest: {baseline.total_rate_deg_per_min:.2g}°/min, {share:.2g}° per cycle"
    if source == "rests":
        note += f", from {baseline.source}; an upper bound, the object may creep in the hand as well"
        if baseline.duration_s < MIN_REST_FOR_FLOOR_S:
            return SensorShare(source, share, None, None, f"{note}; too short to set a floor", baseline)
    note += f"; floor {floor:.2g}°: a resting object would score less in 95 of 100 such trials"
    return SensorShare(source, share, floor, drift.theta_bar_deg < floor, note, baseline)


def _trust_warnings(
    result: Result, theta: float, companions: Diagnostics, sensor: SensorShare, index_kind: str
) -> list[str]:
    warnings = []
    if companions.top_eigenvalue_share < MIN_EIGENVALUE_SHARE:
        warnings.append(
            f"the steps hardly agree: top eigenvalue share {companions.top_eigenvalue_share:.3f}, "
            f"below {MIN_EIGENVALUE_SHARE}"
        )
    if companions.mean_step_deg > max(_SCATTER * theta, 0.1):
        warnings.append(f"θ̄ hides scatter: the mean step is {companions.mean_step_deg:.2f}°, θ̄ only {theta:.2f}°")
    for name, value in (("first", companions.without_first_deg), ("last", companions.without_last_deg)):
        if value is not None and max(value, theta) > _SENSITIVE * min(value, theta) and abs(value - theta) > 0.05:
            warnings.append(f"without the {name} end point θ̄ would be {value:.2f}° instead of {theta:.2f}°")
    if companions.interval is not None and companions.interval.low_deg <= 0.0:
        warnings.append(f"θ̄ {NO_DRIFT}: the interval touches 0")
    if companions.interval is None:
        warnings.append(f"{companions.n_steps} steps are too few for a confidence interval")
    if result.excluded_cycles:
        warnings.append(
            f"{len(result.excluded_cycles)} of {result.n_endpoints - 1} cycles are left out by the operator, which the "
            "benchmark's card does not foresee; they are kept and listed"
        )
    flagged = sum(1 for flags in result.flags if flags)
    if flagged:
        warnings.append(f"{flagged} of {result.n_endpoints} end points are flagged as irregular; they are kept")
    if sensor.below_floor:
        warnings.append(
            f"below the sensor's floor: a resting object would score up to {sensor.detectable_deg:.2g}° in such a trial"
        )
    elif sensor.source == "unknown" and index_kind == "sequence":
        warnings.append(sensor.note)
    return warnings
