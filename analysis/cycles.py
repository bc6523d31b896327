"""Where each cycle ends, found offline from the orientation alone, with no number set per recording.

The steps, in order: angular velocity on an even grid (:mod:`analysis.angular_velocity`); the active part; the period
(:mod:`analysis.period`); the motion axis and the angle about it (:mod:`analysis.motion_axis`); its turning points
(:mod:`analysis.turning_points`), by a template where one cycle has several humps (:mod:`analysis.cycle_template`);
end points in the middle of their dwell, gates at the ends only, runs (:mod:`analysis.endpoints`).

Irregular cycles inside a trial are kept and flagged, never dropped: a slip is what the benchmark measures.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.angular_velocity import Motion, angular_velocity, usable_rows
from analysis.cycle_analysis import CycleAnalysis, CycleSettings, Endpoint, LeftOut, Run
from analysis.cycle_template import locked_cycles, template_turning_points
from analysis.endpoints import Extremes, Samples, gate_ends, measure, split_runs, with_flags
from analysis.motion_axis import AxisAngle, motion_axis
from analysis.period import Period, find_period
from analysis.series import FloatArray, OrientationSeries
from analysis.turning_points import TurningPoints, turning_points, without_short_pairs

__all__ = ["CycleAnalysis", "CycleSettings", "Endpoint", "LeftOut", "Run", "find_cycles"]

_DEFAULTS = CycleSettings()


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One of the two extremes: its runs, the longest of them, and what fell off."""

    runs: tuple[tuple[Endpoint, ...], ...]
    longest: int
    left_out: tuple[LeftOut, ...]
    travel: FloatArray

    @property
    def endpoints(self) -> tuple[Endpoint, ...]:
        return self.runs[self.longest] if self.runs else ()


def find_cycles(
    series: OrientationSeries,
    settings: CycleSettings = _DEFAULTS,
    window: tuple[float, float] | None = None,
) -> CycleAnalysis:
    """Find the end points of a periodic motion, or say why there are none to score.

    Parameters
    ----------
    series
        The recording.
    settings
        Numbers of the method; the defaults suit every recording.
    window
        (from, to) in the time of the series, s: only end points inside are taken, all of them, and period and axis
        come from this part alone. None finds the window: from the first to the last regular cycle.

    Returns
    -------
    Never raises for a poor recording: ``valid`` is False and ``reasons`` say why.
    """
    nothing = CycleAnalysis(valid=False, reasons=(), warnings=(), settings=settings, window=window)
    motion = angular_velocity(
        series, rate_hz=settings.rate_hz, sigma_s=settings.sigma_s, moving_share=settings.moving_share
    )
    if motion is None:
        return replace(nothing, reasons=(f"too short: {len(series)} samples",))
    first, last = _active(motion, window)
    if last - first < 4:
        return replace(nothing, reasons=("the object does not move",))
    active_s = (motion.start_s + first / motion.rate_hz, motion.start_s + last / motion.rate_hz)
    nothing = replace(nothing, active_s=active_s)
    period = find_period(
        motion.omega[first:last],
        motion.rate_hz,
        min_period_s=settings.min_period_s,
        max_period_s=settings.max_period_s,
        peak_share=settings.peak_share,
    )
    if period is None or period.confidence < settings.min_confidence:
        return replace(
            nothing,
            reasons=(_no_period(motion.part(first, last), period, settings),),
            period_confidence=0.0 if period is None else period.confidence,
        )
    if window is not None:  # the travel to the first and from the last end point may lie outside the window
        margin = int(period.seconds * motion.rate_hz)
        first, last = first - margin, last + margin
    part = motion.part(first, last)
    turning = motion_axis(part, period.seconds, sigma_periods=settings.axis_sigma)
    return _with_endpoints(nothing, series, part, turning, period)


def _active(motion: Motion, window: tuple[float, float] | None) -> tuple[int, int]:
    if window is None:
        return motion.active()
    start, end = (int(np.clip((t - motion.start_s) * motion.rate_hz, 0, len(motion.omega))) for t in window)
    first, last = motion.part(start, end).active()
    return start + first, start + last


def _no_period(motion: Motion, period: Period | None, settings: CycleSettings) -> str:
    """Why no period was found, as far as the motion itself shows."""
    seconds = 1.0 / motion.rate_hz
    net = float(np.linalg.norm(motion.omega.sum(axis=0))) * seconds
    path = float(np.linalg.norm(motion.omega, axis=1).sum()) * seconds
    if net > 0.5 * path:
        return f"one-way rotation: {np.degrees(net):.0f}° of {np.degrees(path):.0f}° turned in one direction"
    found = "none found" if period is None else f"autocorrelation {period.confidence:.2f} at {period.seconds:.2f} s"
    return f"no period: {found}, needs {settings.min_confidence}"


def _with_endpoints(
    nothing: CycleAnalysis, series: OrientationSeries, motion: Motion, turning: AxisAngle, period: Period
) -> CycleAnalysis:
    settings = nothing.settings
    swing_deg = float(np.degrees(turning.swing_rad))
    result = replace(
        nothing,
        period_s=period.seconds,
        period_confidence=period.confidence,
        axis=turning.mean_axis,
        axis_share=turning.share,
        swing_deg=swing_deg,
    )
    if swing_deg < settings.min_swing_deg:
        return replace(result, reasons=(f"range of motion {swing_deg:.2f}°, needs {settings.min_swing_deg}°",))
    found, humps = _turning_points(motion, turning, period.seconds, settings)
    rows = usable_rows(series.times_s)
    times_s = series.times_s[rows]
    samples = Samples(times_s, series.quats_wxyz[rows], series.index[rows], float(np.median(np.diff(times_s))))
    candidates = []
    for upper in (True, False):
        extremes = measure(
            samples,
            found,
            turning.angle_rad,
            (motion.start_s, 1.0 / motion.rate_hz),
            turning.swing_rad,
            period.seconds,
            settings,
            upper=upper,
        )
        candidates.append(_candidate(extremes, period.seconds, nothing.window, settings))
    primary, other = sorted(
        candidates, key=lambda c: (-len(c.endpoints), c.endpoints[0].time_s if c.endpoints else np.inf)
    )
    left_out = [replace(item, primary=True) for item in primary.left_out] + list(other.left_out)
    result = replace(
        result,
        endpoints=primary.endpoints,
        other_endpoints=other.endpoints,
        runs=tuple(Run(run, scored=k == primary.longest) for k, run in enumerate(primary.runs)),
        left_out=tuple(sorted(left_out, key=lambda item: item.time_s)),
        humps=humps,
    )
    return _judge(result, samples, period)


def _turning_points(
    motion: Motion, turning: AxisAngle, period_s: float, settings: CycleSettings
) -> tuple[TurningPoints, int]:
    """Find one turning point of each kind per cycle, and how many the bare hysteresis found."""
    period = period_s * motion.rate_hz
    found = turning_points(turning.angle_rad, settings.hysteresis * turning.swing_rad)
    spacing = np.concatenate([np.diff(found.points[found.upper == kind]) for kind in (True, False)]) / period
    if len(spacing) == 0:
        return found, 1
    low, high = settings.spacing
    if low <= np.median(spacing) <= high and np.mean(spacing < low) < 0.2:
        return without_short_pairs(found, turning.angle_rad, 0.5 * period), 1
    starts = locked_cycles(motion.omega, round(period))
    if len(starts) < 2:
        return found, 1
    humps = max(round(1.0 / float(np.median(spacing))), 1)
    return template_turning_points(turning.angle_rad, starts, round(period)), humps


def _candidate(
    extremes: Extremes, period_s: float, window: tuple[float, float] | None, settings: CycleSettings
) -> _Candidate:
    runs, left_out = [], list(extremes.refused)
    travel = []
    for piece in split_runs(extremes, period_s, settings):
        run, off = piece, list[LeftOut]()
        if window is None:
            run, off = gate_ends(extremes, piece, period_s, settings)
        else:
            inside = [k for k in range(*piece.indices(piece.stop)) if _inside(extremes.endpoints[k], window)]
            run = slice(inside[0], inside[-1] + 1) if inside else slice(0, 0)
        left_out += off
        if run.stop > run.start:
            runs.append(with_flags(extremes, run, period_s, settings))
            travel.append(extremes.inner_swing[run])
    longest = int(np.argmax([len(run) for run in runs])) if runs else 0
    return _Candidate(tuple(runs), longest, tuple(left_out), travel[longest] if runs else np.empty((0, 2)))


def _inside(point: Endpoint, window: tuple[float, float]) -> bool:
    return window[0] <= point.time_s <= window[1]


def _judge(result: CycleAnalysis, samples: Samples, period: Period) -> CycleAnalysis:
    """Reasons against scoring, and warnings."""
    settings, points = result.settings, result.endpoints
    reasons: list[str] = []
    warnings: list[str] = []
    if len(points) < settings.min_endpoints:
        reasons.append(f"fewer than {settings.min_endpoints} cycles: {len(points)} end points found")
    spacing_s = np.diff([point.time_s for point in points])
    period_s = float(np.median(spacing_s)) if len(spacing_s) else period.seconds
    if period.confidence < settings.sure_confidence:
        warnings.append(f"cycles differ much: autocorrelation at the period only {period.confidence:.2f}")
    if result.axis_share < settings.min_axis_share:
        warnings.append(f"motion axis ambiguous: only {result.axis_share:.0%} of the motion is about one axis")
    if period_s < 0.6:
        warnings.append(f"period of {period_s:.2f} s: end points are uncertain below 0.6 s")
    if samples.usual_step_s > settings.max_gap * period_s:
        warnings.append(f"sampled coarsely: {period_s / samples.usual_step_s:.0f} samples per cycle")
    if len(spacing_s) >= 3 and np.ptp(spacing_s) > 0.4 * period_s:
        warnings.append(f"tempo changes: cycles last {spacing_s.min():.2f} to {spacing_s.max():.2f} s")
    if len(result.runs) > 1:
        warnings.append(f"{len(result.runs)} runs with pauses between them: only the longest is scored")
    if any("gap" in item.reason for item in result.left_out if item.primary):
        warnings.append("end points inside gaps in the data are refused")
    return replace(result, valid=not reasons, reasons=tuple(reasons), warnings=tuple(warnings), period_s=period_s)
