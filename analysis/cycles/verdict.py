"""Whether the end points found may be scored, and what to keep in mind: reasons and warnings in plain words.

How similar the cycles are (:mod:`analysis.cycles.repetition`) separates a repeated manipulation from motion that
only swings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.cycles.axis import AxisAngle
from analysis.cycles.motion import Motion
from analysis.cycles.period import Period
from analysis.cycles.repetition import agreement, alternation, irregularity, likeness, rests, swing_trend
from analysis.cycles.settings import AFTER_PAUSE, CycleAnalysis, CycleSettings
from analysis.cycles.turning_points import turning_points
from analysis.cycles.usable_samples import Samples
from analysis.geometry import averages, rotations

_ONE_WAY = 1.0 / 3.0  # net turn as a share of all turning
_MAX_APART, _APART_A_STEP = 1.0 / 3.0, 0.06  # swings
_MORE_APART, _MOST_APART = 0.02, 0.5
_SIMILAR = 0.97  # likeness
_MIN_AGREEMENT = 0.9  # top eigenvalue share, angles in units of half the swing
_MAX_SWING_DEG = 360.0
_ALTERNATE, _MIN_ALTERNATING = -0.75, 8


def why_no_period(motion: Motion, period: Period | None, settings: CycleSettings) -> str:
    """Return why no period was found, as far as the motion itself shows."""
    seconds = 1.0 / motion.rate_hz
    net_deg = float(np.degrees(np.linalg.norm(motion.omega.sum(axis=0)) * seconds))
    path_deg = float(np.degrees(np.linalg.norm(motion.omega, axis=1).sum() * seconds))
    turned_deg = np.degrees(np.cumsum(motion.omega, axis=0)) * seconds
    range_deg = float(np.ptp(turned_deg, axis=0).max(initial=0.0))
    if range_deg < settings.min_swing_deg:
        return f"range of motion {range_deg:.2f}° in all, needs {settings.min_swing_deg}°: the object hardly moves"
    one_way = f"{net_deg:.0f}° of {path_deg:.0f}° turned in one direction" if net_deg > _ONE_WAY * path_deg else ""
    swings = _swings(motion, settings)
    if swings < 2 * settings.min_endpoints:
        seen = f"{swings} swing{'s' * (swings > 1)} in a range of {range_deg:.0f}°, no period"
        if swings == 1 and one_way:
            seen = f"one-way rotation, {one_way}"
        return f"fewer than {settings.min_endpoints} cycles: {seen}"
    if one_way:
        return f"one-way rotation: {one_way}"
    found = "none found" if period is None else f"autocorrelation {period.confidence:.2f} at {period.seconds:.2f} s"
    return f"no period: {found}, needs {settings.min_confidence}"


def _swings(motion: Motion, settings: CycleSettings) -> int:
    """Return the number of swings about the axis of most turning; an object that only turns on has one."""
    axis = np.linalg.eigh(motion.omega.T @ motion.omega)[1][:, -1]
    angle = np.cumsum(motion.omega @ axis)
    return 1 + len(turning_points(angle, settings.hysteresis * float(np.ptp(angle))).points)


def with_verdict(
    result: CycleAnalysis, motion: Motion, turning: AxisAngle, samples: Samples, period: Period, apart: float
) -> CycleAnalysis:
    """Fill in ``reasons``, ``warnings``, ``likeness``, ``irregularity`` and the period of the end points.

    Parameters
    ----------
    result : CycleAnalysis
        With end points.
    motion : Motion
        What they were found in.
    turning : AxisAngle
        The rotation about its axis.
    samples : Samples
        What they were measured from.
    period : Period
        That the cycles were found with.
    apart : float
        Distance between neighbouring cycles, in swings; infinite where they are too few.
    """
    settings, points = result.settings, result.endpoints
    times_s = np.array([point.time_s for point in points])
    paused = np.array([AFTER_PAUSE in point.flags for point in points[1:]], dtype=bool)
    spacing_s = np.diff(times_s)[~paused]
    any_tempo = period.confidence < settings.min_confidence
    prominence = np.array([point.prominence_deg for point in points])
    result = replace(
        result,
        period_s=float(np.median(spacing_s)) if len(spacing_s) else period.seconds,
        likeness=likeness(motion.smoothed(period.seconds / 40.0), times_s, paused) if len(points) >= 3 else 0.0,
        irregularity=irregularity(spacing_s, prominence) if len(points) >= 3 else 0.0,
    )
    reasons = _reasons(result, motion, turning, any_tempo=any_tempo)
    if not reasons:
        reasons += _not_claimable(result, apart)
    warnings = _warnings(result, period)
    let_go = _grasp_and_release(result, motion)
    one_motion = result.likeness > settings.sure_likeness and result.axis_share >= settings.min_axis_share
    if let_go and not one_motion:
        reasons.append(f"looks like grasp-and-release: {let_go}")
        warnings.append("looks like grasp-and-release trials: no drift can be claimed")
    elif let_go:  # a hand that sticks and slips rests as often
        warnings.append(f"was the object let go? {let_go}, as in grasp-and-release trials")
    noise_deg = float(np.degrees(samples.noise_rad))
    if noise_deg > settings.max_noise * result.swing_deg:
        warnings.append(f"noise of {noise_deg:.2g}° per sample is large for a swing of {result.swing_deg:.3g}°")
    if samples.outliers:
        warnings.append(f"{samples.outliers} samples stand apart from both their neighbours: set aside")
    if samples.usual_step_s > settings.max_gap * result.period_s:
        warnings.append(f"sampled coarsely: {result.period_s / samples.usual_step_s:.0f} samples per cycle")
    return replace(result, reasons=tuple(reasons), warnings=tuple(warnings))


def _grasp_and_release(result: CycleAnalysis, motion: Motion) -> str:
    """Return what shows that the object is let go and taken up again; empty where nothing does."""
    settings, points = result.settings, result.endpoints
    if len(points) < 3 or result.axis_share > settings.pure_axis_share:
        return ""
    first, last = (round((p.time_s - motion.start_s) * motion.rate_hz) for p in (points[0], points[-1]))
    number, share = rests(motion.part(first, last), result.period_s)
    if number < settings.max_rests or share < settings.max_rest_share:
        return ""
    return f"{number:.1f} rests per cycle, {share:.0%} of the time, about no one axis"


def _reasons(result: CycleAnalysis, motion: Motion, turning: AxisAngle, *, any_tempo: bool) -> list[str]:
    settings, points = result.settings, result.endpoints
    angle = turning.angle_rad
    if len(points) < settings.min_endpoints:
        net = float(abs(angle[-1] - angle[0]))
        if net > _ONE_WAY * float(np.abs(np.diff(angle)).sum()):
            return [f"one-way rotation: {np.degrees(net):.0f}° turned in one direction, never as far back"]
        return [f"fewer than {settings.min_endpoints} cycles: {len(points)} end points found"]
    reasons = []
    at = [round((point.time_s - motion.start_s) * motion.rate_hz) for point in (points[0], points[-1])]
    advance_deg = float(np.degrees(abs(angle[at[1]] - angle[at[0]]))) / (len(points) - 1)
    if advance_deg > settings.max_advance * result.swing_deg:
        reasons.append(f"one-way rotation: advances {advance_deg:.1f}° per cycle at a swing of {result.swing_deg:.1f}°")
    min_likeness = settings.sure_likeness if any_tempo else settings.min_likeness
    if result.likeness < min_likeness:
        reasons.append(f"cycles do not repeat: likeness {result.likeness:.2f}, needs {min_likeness}")
    # Cycles of one shape and one size may have any tempo: changing tempo is warned of.
    swings_deg = np.array([point.prominence_deg for point in points])
    even = irregularity(None, swings_deg) <= 0.5 * settings.max_irregularity
    if result.irregularity > settings.max_irregularity and not (even and result.likeness >= settings.sure_likeness):
        reasons.append(
            f"cycles do not repeat: spacing and swing vary by {result.irregularity:.0%}, "
            f"at most {settings.max_irregularity:.0%}"
        )
    return reasons


def _not_claimable(result: CycleAnalysis, apart: float) -> list[str]:
    """Return why a mean of these steps would claim nothing, however regular their rhythm."""
    points, swing_deg, reasons = result.endpoints, result.swing_deg, []
    if swing_deg > _MAX_SWING_DEG:
        reasons.append(f"a swing of {swing_deg:.0f}°, more than a full turn: is the unit of the angles right?")
    if np.isfinite(apart) and apart > _most_apart(result):
        reasons.append(f"cycles do not repeat: each differs from the next by {apart:.0%} of the swing")
    quats = np.array([point.quat_wxyz for point in points])
    steps = rotations.difference(quats[1:], quats[:-1])
    share = agreement(steps, np.radians(swing_deg))
    if share < _MIN_AGREEMENT:
        scatter_deg = float(np.degrees(rotations.distance(steps, averages.average(steps)).mean()))
        reasons.append(
            f"the object does not come back: steps scatter by {scatter_deg:.1f}°, the swing is {swing_deg:.1f}° "
            f"(top eigenvalue share {share:.2f}, needs {_MIN_AGREEMENT})"
        )
    return reasons


def _most_apart(result: CycleAnalysis) -> float:
    """Return how far neighbouring cycles may be from each other, in swings.

    Few cycles of a random motion are similar by chance, but not as similar as a hand makes them: the fewer cycles, and
    the less the autocorrelation shows of a period, the nearer to each other they must be. Peaks that differ and recur
    in the same order are no chance, and whoever chooses a window has seen cycles. Nor is a rhythm chance that is kept
    for twenty cycles, however much these vary.
    """
    steps_to_spare = max(len(result.endpoints) - 3, 1)
    most = min(max(_MAX_APART, _MORE_APART * steps_to_spare), _MOST_APART)
    if result.window is not None or result.peaks_per_cycle > 1:
        return most
    similar = result.likeness >= _SIMILAR
    shown = result.period_confidence >= result.settings.sure_confidence
    if similar and shown:
        return most
    a_step = _APART_A_STEP if similar or shown else 0.5 * _APART_A_STEP
    return min(most, a_step * steps_to_spare)


def _warnings(result: CycleAnalysis, period: Period) -> list[str]:
    settings, points = result.settings, result.endpoints
    paused = np.array([AFTER_PAUSE in point.flags for point in points[1:]], dtype=bool)
    spacing_s = np.diff([point.time_s for point in points])[~paused]
    warnings = []
    if period.confidence < settings.sure_confidence:
        warnings.append(f"cycles differ much: autocorrelation at the period only {period.confidence:.2f}")
    if result.axis_share < settings.min_axis_share:
        warnings.append(f"motion axis ambiguous: only {result.axis_share:.0%} of the motion is about one axis")
    if result.period_s < settings.short_period_s:
        warnings.append(
            f"period of {result.period_s:.2f} s: end points are uncertain below {settings.short_period_s} s"
        )
    if len(spacing_s) >= 3 and np.ptp(spacing_s) > settings.max_tempo_change * result.period_s:
        warnings.append(f"tempo changes: cycles last {spacing_s.min():.2f} to {spacing_s.max():.2f} s")
    if paused.any():
        warnings.append(f"steps across a pause in which the phase goes on: {paused.sum()}, scored and flagged")
    if trend := swing_trend(np.array([point.prominence_deg for point in points])):
        warnings.append(
            f"the swing {'grows' if trend > 0.0 else 'shrinks'} by {abs(trend):.1%} a cycle, "
            f"{abs(trend) * result.swing_deg:.2g}°: as much of a step may be the swing, not drift"
        )
    if len(points) > _MIN_ALTERNATING:
        quats = np.array([point.quat_wxyz for point in points])
        correlation = alternation(rotations.log(rotations.difference(quats[1:], quats[:-1])))
        if correlation < _ALTERNATE:
            warnings.append(f"steps alternate: each with the next {correlation:.2f}. Are two of these cycles one?")
    if len(result.runs) > 1:
        warnings.append(f"{len(result.runs)} runs with pauses between them: only the longest is scored")
    if any("gap" in item.reason for item in result.left_out if item.primary):
        warnings.append("end points inside gaps in the data are refused")
    return warnings
