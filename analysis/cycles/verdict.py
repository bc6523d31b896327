"""Whether the end points found may be scored, and what to keep in mind: reasons and warnings in plain words.

How alike the cycles are tells a repeated manipulation from motion that only swings.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.cycles.axis import AxisAngle
from analysis.cycles.motion import Motion
from analysis.cycles.period import Period
from analysis.cycles.settings import CycleAnalysis, CycleSettings
from analysis.cycles.turning_points import turning_points
from analysis.cycles.usable_samples import Samples
from analysis.geometry.rotations import row_lengths
from analysis.series import FloatArray

_ONE_WAY = 1.0 / 3.0  # net turn as a share of all turning


def why_no_period(motion: Motion, period: Period | None, settings: CycleSettings) -> str:
    """Say why no period was found, as far as the motion itself shows."""
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
    """Count the swings about the axis of most turning; an object that only turns on has one."""
    axis = np.linalg.eigh(motion.omega.T @ motion.omega)[1][:, -1]
    angle = np.cumsum(motion.omega @ axis)
    return 1 + len(turning_points(angle, settings.hysteresis * float(np.ptp(angle))).points)


def with_verdict(
    result: CycleAnalysis, motion: Motion, turning: AxisAngle, samples: Samples, period: Period
) -> CycleAnalysis:
    """Fill in ``valid``, ``reasons``, ``warnings``, ``likeness``, ``irregularity`` and the period of the end points.

    Parameters
    ----------
    result
        With end points.
    motion, turning
        What they were found in.
    samples
        What they were measured from.
    period
        From the autocorrelation.
    """
    points = result.endpoints
    times_s = np.array([point.time_s for point in points])
    spacing_s = np.diff(times_s)
    any_tempo = period.confidence < result.settings.min_confidence
    prominence = np.array([point.prominence_deg for point in points])
    result = replace(
        result,
        period_s=float(np.median(spacing_s)) if len(spacing_s) else period.seconds,
        likeness=likeness(motion.smoothed(period.seconds / 40.0), times_s) if len(points) >= 3 else 0.0,
        irregularity=irregularity(times_s, prominence) if len(points) >= 3 else 0.0,
    )
    reasons = _reasons(result, motion, turning, any_tempo=any_tempo)
    warnings = _warnings(result, period)
    let_go = _grasp_and_release(result, motion)
    one_motion = result.likeness > result.settings.sure_likeness and result.axis_share >= result.settings.min_axis_share
    if let_go and not one_motion:
        reasons.append(f"looks like grasp-and-release: {let_go}")
        warnings.append("looks like grasp-and-release trials: no drift can be claimed")
    elif let_go:  # a hand that sticks and slips rests as often
        warnings.append(f"was the object let go? {let_go}, as in grasp-and-release trials")
    noise_deg = float(np.degrees(samples.noise_rad))
    if noise_deg > result.settings.max_noise * result.swing_deg:
        warnings.append(f"noise of {noise_deg:.2g}° per sample is large for a swing of {result.swing_deg:.3g}°")
    if samples.outliers:
        warnings.append(f"{samples.outliers} samples stand apart from both their neighbours: set aside")
    if samples.usual_step_s > result.settings.max_gap * result.period_s:
        warnings.append(f"sampled coarsely: {result.period_s / samples.usual_step_s:.0f} samples per cycle")
    return replace(result, valid=not reasons, reasons=tuple(reasons), warnings=tuple(warnings))


def _grasp_and_release(result: CycleAnalysis, motion: Motion) -> str:
    """Say what shows that the object is let go and taken up again; empty where nothing does."""
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


def _warnings(result: CycleAnalysis, period: Period) -> list[str]:
    settings, points = result.settings, result.endpoints
    spacing_s = np.diff([point.time_s for point in points])
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
    if len(result.runs) > 1:
        warnings.append(f"{len(result.runs)} runs with pauses between them: only the longest is scored")
    if any("gap" in item.reason for item in result.left_out if item.primary):
        warnings.append("end points inside gaps in the data are refused")
    return warnings


_PHASES = 48
_MAX_CYCLES = 2000


def likeness(motion: Motion, endpoint_s: FloatArray) -> float:
    """Median correlation of each cycle's angular velocity with the mean of its six neighbours.

    Cycles are stretched to one length first, so tempo does not matter; nor does the size of the motion. Neighbours
    only, because drift slowly turns the motion axis away from where it was.

    Parameters
    ----------
    motion
        Angular velocity of the trial, smoothed to a fortieth of a period or so: noise in ω is no unlikeness.
    endpoint_s
        (n,) times of the end points, n ≥ 3, s.

    Returns
    -------
    −1 to 1; above 0.9 for a hand that repeats itself, 0.5 and less for random motion.
    """
    cycles = min(len(endpoint_s) - 1, _MAX_CYCLES)
    grid_s = motion.start_s + (np.arange(len(motion.omega)) + 0.5) / motion.rate_hz
    phase = (np.arange(_PHASES) + 0.5) / _PHASES
    length_s = np.diff(endpoint_s[: cycles + 1])
    at_s = endpoint_s[:cycles, None] + phase * length_s[:, None]
    shape = np.stack([np.interp(at_s, grid_s, motion.omega[:, axis]) for axis in range(3)], axis=-1)
    shape = (shape * length_s[:, None, None]).reshape(cycles, -1)
    total = np.concatenate((np.zeros((1, shape.shape[1])), np.cumsum(shape, axis=0)))
    row = np.arange(cycles)
    others = total[np.minimum(row + 4, cycles)] - total[np.maximum(row - 3, 0)] - shape
    scale = np.linalg.norm(shape, axis=1) * np.linalg.norm(others, axis=1)
    return float(np.median((shape * others).sum(axis=1) / np.maximum(scale, 1e-300)))


def irregularity(endpoint_s: FloatArray | None, prominence: FloatArray) -> float:
    """Spread of the distances between end points and of the swings, as a share of their medians.

    Each spread is 1.25 times the mean deviation from the median (the standard deviation of normal values), so that
    one slip among few cycles does not count as irregular motion.

    Parameters
    ----------
    endpoint_s
        (n,) times of the end points, n ≥ 3, s; None where any tempo will do.
    prominence
        (n,) swing of each, any unit.
    """
    total = 0.0
    for values in (prominence,) if endpoint_s is None else (np.diff(endpoint_s), prominence):
        middle = float(np.median(values))
        total += (1.25 * float(np.mean(np.abs(values - middle))) / max(middle, 1e-300)) ** 2
    return float(np.sqrt(total))


def rests(motion: Motion, period_s: float) -> tuple[float, float]:
    """How often per cycle the object rests, and for which share of the time.

    A rest is at least 3 % of a period at less than a tenth of the speed at which the turning is done (the mean of ω²
    weighted by |ω|). A hand that turns an object to and fro rests twice per cycle at most; one that lets go, opens,
    comes back, closes and lifts rests between all of these.

    Parameters
    ----------
    motion
        Angular velocity between the first and the last end point.
    period_s
        Length of a cycle, s.
    """
    speed = row_lengths(motion.omega)
    level = 0.1 * np.sqrt((speed**3).sum() / max(float(speed.sum()), 1e-300))
    edges = np.diff(np.concatenate(([False], speed < level, [False])).astype(np.int8))
    length_s = (np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)) / motion.rate_hz
    length_s = length_s[length_s > 0.03 * period_s]
    total_s = len(speed) / motion.rate_hz
    return len(length_s) * period_s / total_s, float(length_s.sum()) / total_s
