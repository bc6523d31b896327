"""Where each cycle ends, found offline from the orientation alone, with no number set per recording.

The steps, in order: angular velocity on an even grid (:mod:`analysis.cycles.motion`); the active part; the period
(:mod:`analysis.cycles.period`); the motion axis and the angle about it (:mod:`analysis.cycles.axis`); its turning
points (:mod:`analysis.cycles.turning_points`); how many strokes between them make a cycle, which may correct the period
(:mod:`analysis.cycles.strokes`, :mod:`analysis.cycles.grouping`); end points in the middle of their dwell, gates at the
ends only, runs (:mod:`analysis.cycles.endpoints`).
Irregular cycles inside a trial are kept and flagged, never dropped: a slip is what the benchmark measures.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.cycles.axis import AxisAngle, motion_axis
from analysis.cycles.endpoints import Extremes, measure, split_runs, with_flags
from analysis.cycles.gates import gate_ends, leave_out_grasp
from analysis.cycles.grouping import (
    MAX_PAIRS,
    MAX_POINTS,
    OBVIOUS,
    Grouping,
    durations_recur,
    group,
    kinds,
    one_a_cycle,
    spread,
)
from analysis.cycles.motion import Motion, angular_velocity
from analysis.cycles.period import Period, confidence_at, search_period
from analysis.cycles.repetition import swing_trend
from analysis.cycles.settings import LONG_DWELL, CycleAnalysis, CycleSettings, Endpoint, LeftOut, Run
from analysis.cycles.strokes import StrokePairs, strokes
from analysis.cycles.turning_points import NONE_FOUND, TurningPoints, turning_points, without_short_pairs
from analysis.cycles.usable_samples import Samples
from analysis.cycles.verdict import why_no_period, with_verdict
from analysis.geometry import rotations
from analysis.series import FloatArray, IntArray, OrientationSeries

__all__ = ["CycleAnalysis", "CycleSettings", "Endpoint", "LeftOut", "Run", "find_cycles"]

_DEFAULTS = CycleSettings()
_MAX_GRID_PER_SAMPLE = 50
_SMALL_GRID = 1_000_000  # costs nothing, however empty
_LEVELS = (1.0, 0.5)
"""Hysteresis of the strokes that are grouped, shares of the usual one: small peaks pass the second alone."""
_SAME_PERIOD, _ALMOST_PERIOD = 0.1, 0.2
_NEARLY_EXACT = 0.95
_JUDGED_PERIODS = 250
"""Strokes are compared in the first so many cycles: as many as make any motion clear."""
_PAUSED = 1.6
"""A cycle that lasts so many times as long as the shorter ones has a pause in it."""
_EVEN_SPREAD = 0.15
"""Distance between neighbouring pairs of strokes up to which each is a cycle, in swings."""
_EVEN_PAIRS = 4


@dataclass(frozen=True)
class _Settled:
    """The period that the strokes confirm or correct."""

    period: Period
    pairs: int = 0
    """Pairs of strokes a cycle; 0 where the strokes leave it to the autocorrelation."""
    hysteresis: float = 0.0
    """At which the strokes were found, share of the range of motion."""
    possible: int = 0
    """Another number of pairs that cannot be ruled out; 0 where there is none."""
    turning: AxisAngle | None = None
    """About the motion axis, where it is that of this period and of all motion."""


def find_cycles(
    series: OrientationSeries,
    settings: CycleSettings = _DEFAULTS,
    window: tuple[float, float] | None = None,
    like_s: Sequence[float] = (),
) -> CycleAnalysis:
    """Return the end points of a periodic motion, or why there are none to score.

    Parameters
    ----------
    series : OrientationSeries
        The recording.
    settings : CycleSettings, optional
        Numbers of the method; the defaults suit every recording.
    window : tuple of float, optional
        (from, to) in the time of the series, s: end points whose dwell touches it count, all of them, and the
        period comes from this part alone. None finds the window: from the first to the last regular cycle.
    like_s : sequence of float, optional
        Times of end points: the extreme that they lie at is the primary one, however many each has.

    Returns
    -------
    Never raises for a poor recording: ``valid`` is False and ``reasons`` holds why.
    """
    nothing = CycleAnalysis(settings, window)
    samples = Samples.of(series)
    if empty := _mostly_empty(samples, settings):
        return replace(nothing, reasons=(empty,))
    motion = angular_velocity(
        samples, rate_hz=settings.rate_hz, sigma_s=settings.sigma_s, moving_share=settings.moving_share
    )
    if motion is None:
        return replace(nothing, reasons=(f"too short: {len(series)} samples",))
    result = _find(nothing, motion, samples, like_s)
    if not result.valid:
        # Putting the object in place or dropping it may turn it further than all cycles, which then looked idle.
        slower = motion.with_moving_share(settings.moving_share, path_share=settings.slow_path_share, percentile=50.0)
        if slower.threshold < 0.5 * motion.threshold:
            again = _find(nothing, slower, samples, like_s)
            return again if again.valid else result
    return result


def _mostly_empty(samples: Samples, settings: CycleSettings) -> str:
    """Return why an even grid would hold hardly anything, and fill the memory: a wrong unit of time, or a clock set."""
    n = len(samples.times_s)
    if n < 2 or (samples.times_s[-1] - samples.times_s[0]) * settings.rate_hz <= _MAX_GRID_PER_SAMPLE * n + _SMALL_GRID:
        return ""
    gaps_s = np.diff(samples.times_s)
    if samples.usual_step_s > 0.5:
        return f"samples are {samples.usual_step_s:.3g} s apart, too far for any cycle: is the unit of time right?"
    widest = int(np.argmax(gaps_s))
    after_s = samples.times_s[widest] - samples.times_s[0]
    return (
        f"a gap of {gaps_s[widest]:.3g} s, {after_s:.3f} s after the first sample: was the clock set there? Cut the "
        "recording, or choose end points"
    )


def _find(nothing: CycleAnalysis, motion: Motion, samples: Samples, like_s: Sequence[float]) -> CycleAnalysis:
    """Search the part of a recording in which the object moves."""
    settings, window = nothing.settings, nothing.window
    first, last = _active(motion, window)
    if last - first < 4:
        return replace(nothing, reasons=("the object does not move",))
    active_s = (motion.start_s + first / motion.rate_hz, motion.start_s + last / motion.rate_hz)
    nothing = replace(nothing, active_s=active_s)
    moving = motion.part(first, last)
    period, smooth_s = search_period(moving, samples, settings)
    settled = None if period is None else _settled(moving, period, smooth_s, settings)
    refused = nothing
    # Below `min_confidence` there is no period, but even swings about one axis may still be cycles of changing tempo:
    # the search goes on, and where that leads to nothing, the refusal for want of a period stands.
    if settled is None or settled.period.confidence < settings.min_confidence:
        refused = replace(
            nothing,
            reasons=(why_no_period(moving, period, settings),),
            period_confidence=0.0 if period is None else period.confidence,
        )
        if settled is None or (settled.pairs == 0 and settled.period.confidence < settings.min_tempo_confidence):
            return refused
    if window is not None:  # the travel to the first and from the last end point may lie outside the window
        margin = int(settled.period.seconds * motion.rate_hz)
        first, last = first - margin, last + margin
    result = _with_endpoints(nothing, samples, motion.part(first, last), settled, smooth_s, like_s)
    return refused if refused.reasons and not result.valid else result


def _settled(motion: Motion, period: Period, smooth_s: float, settings: CycleSettings) -> _Settled:
    """Count how many strokes make a cycle, where the autocorrelation has found a period, and confirm or correct it."""
    length = period.seconds * motion.rate_hz
    head = motion.part(0, int(_JUDGED_PERIODS * length))
    turning = _axis(head, period, smooth_s, settings)
    whole, motion = turning if len(head.omega) == len(motion.omega) else None, head
    seen: list[tuple[float, TurningPoints, Grouping, StrokePairs]] = []
    for level in _LEVELS:
        hysteresis = level * settings.hysteresis
        found = turning_points(turning.angle_rad, hysteresis * turning.swing_rad)
        if len(found) < 2 * _EVEN_PAIRS or (seen and len(found) == len(seen[0][1])):
            continue
        of_motion = strokes(motion, turning, found.first(MAX_POINTS))
        pairs = of_motion.pairs()
        grouping = group((pairs, of_motion.pairs(1)))
        seen.append((hysteresis, found, grouping, pairs))
        if abs(_between(found, grouping.pairs) / length - 1.0) <= _SAME_PERIOD:
            break  # both agree: smaller peaks would change nothing
    if not seen:
        return _Settled(period, turning=whole)
    hysteresis, found, grouping, pairs = min(seen, key=lambda way: way[2].nearness)
    k = grouping.pairs
    between = _between(found, k)
    # Where cycles of the shorter period repeat nearly exactly, kinds that are not obvious must repeat better still.
    if k > 1 and grouping.nearness > OBVIOUS and period.confidence >= _NEARLY_EXACT and between > 1.5 * length:
        better = confidence_at(motion, between / motion.rate_hz, settings) - period.confidence
        if better < 0.5 * (1.0 - period.confidence):
            return _Settled(period, hysteresis=hysteresis, possible=k, turning=whole)
    if abs(between / length - 1.0) <= _SAME_PERIOD:
        return _Settled(period, k if k > 1 else 0, hysteresis, grouping.possible, whole)
    even = (
        between < length
        and grouping.spread <= _EVEN_SPREAD
        and not durations_recur(pairs, max(round(length / between), 2))
    )
    if k == 1 and not even:
        return _Settled(period, possible=grouping.possible, turning=whole)
    seconds = between / motion.rate_hz
    return _Settled(Period(seconds, confidence_at(motion, seconds, settings)), k, hysteresis, grouping.possible)


def _between(found: TurningPoints, pairs: int) -> float:
    """Return the median distance of turning points so many pairs of strokes apart, pauses left out, grid points."""
    distances = found.points[2 * pairs :] - found.points[: -2 * pairs]
    return float(np.median(distances[distances <= _PAUSED * np.percentile(distances, 25)]))


def _spread(result: CycleAnalysis, motion: Motion, turning: AxisAngle, found: TurningPoints) -> float:
    """Return how far neighbouring cycles of the scored run are from each other, in swings; infinite for too few."""
    if len(points := result.endpoints) < 2:
        return float("inf")
    first, last = ((points[k].time_s - motion.start_s) * motion.rate_hz for k in (0, -1))
    margin = 0.6 * (last - first) / (len(points) - 1)
    near = strokes(motion, turning, found.between(first - margin, last + margin).first(MAX_POINTS))
    return min(spread(near.pairs()), spread(near.pairs(1)))


def _axis(motion: Motion, period: Period, smooth_s: float, settings: CycleSettings) -> AxisAngle:
    return motion_axis(
        motion,
        period.seconds,
        sigma_periods=settings.axis_sigma,
        smooth_s=smooth_s,
        speed_limit=settings.speed_limit,
    )


def _active(motion: Motion, window: tuple[float, float] | None) -> tuple[int, int]:
    if window is None:
        return motion.active()
    start, end = (int(np.clip((t - motion.start_s) * motion.rate_hz, 0, len(motion.omega))) for t in window)
    first, last = motion.part(start, end).active()
    return start + first, start + last


def _with_endpoints(
    nothing: CycleAnalysis,
    samples: Samples,
    motion: Motion,
    settled: _Settled,
    smooth_s: float,
    like_s: Sequence[float],
) -> CycleAnalysis:
    settings, period, turning = nothing.settings, settled.period, settled.turning
    if turning is None or len(turning.angle_rad) != len(motion.omega) + 1:
        turning = _axis(motion, period, smooth_s, settings)
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
    found, peaks = _turning_points(motion, turning, settled, settings)
    if peaks == 0:  # every swing is a cycle, of changing length: the autocorrelation saw several as one
        period, peaks = Period(float(np.median(_spacing(found))) / motion.rate_hz, period.confidence), 1
    candidates = [
        _with_runs(result, measure(samples, motion, turning, found, period.seconds, settings, upper=upper), period)
        for upper in (True, False)
    ]
    # A swing that grows or shrinks moves the end points of at least one extreme as drift would.
    moved = [_moved_by_swing(candidate) for candidate in candidates]
    # Primary is the extreme asked for; else the one that a changing swing moves less, or the one with more end points
    # (a grasp takes none away), and of as many the one that is reached first.
    primary, other = sorted(
        candidates,
        key=lambda c: (
            -_count_near(c.endpoints, like_s, 0.25 * period.seconds),
            min(moved) > 0.0 and _moved_by_swing(c) > min(moved),
            -len(c.endpoints) - sum(item.grasp for item in c.left_out),
            sum(LONG_DWELL in point.flags for point in c.endpoints),
            c.endpoints[0].time_s if c.endpoints else np.inf,
        ),
    )
    left_out = [replace(item, primary=True) for item in primary.left_out] + list(other.left_out)
    result = replace(
        primary,
        other_endpoints=other.endpoints,
        left_out=tuple(sorted(left_out, key=lambda item: item.time_s)),
        peaks_per_cycle=peaks,
    )
    apart = _spread(result, motion, turning, found)
    result = with_verdict(result, motion, turning, samples, period, apart)
    if not settled.possible or not result.valid:
        return result
    seconds = period.seconds * settled.possible / max(settled.pairs, 1)
    other_way = _Settled(Period(seconds, period.confidence), settled.possible, settled.hysteresis)
    alternative = _with_endpoints(nothing, samples, motion, other_way, smooth_s, like_s)
    if len(alternative.endpoints) < 2:
        return result
    both = " or ".join(f"{way.period_s:.2f} s with θ̄ {way.theta_bar_deg:.2f}°" for way in (result, alternative))
    return replace(result, warnings=(*result.warnings, f"two periods are possible: {both}"))


def _moved_by_swing(result: CycleAnalysis) -> float:
    """Return how far an extreme moves about the motion axis a cycle, rad, where the swing grows or shrinks; else 0."""
    points = result.endpoints
    if not swing_trend(np.array([point.prominence_deg for point in points])):
        return 0.0
    first, last = points[0].quat_wxyz, points[-1].quat_wxyz
    return abs(float(rotations.log(rotations.difference(last, first)) @ result.axis)) / (len(points) - 1)


def _count_near(endpoints: Sequence[Endpoint], like_s: Sequence[float], within_s: float) -> int:
    """Return how many end points lie at given times."""
    if not like_s or not endpoints:
        return 0
    times_s, like = np.array([point.time_s for point in endpoints]), np.sort(like_s)
    at = np.searchsorted(like, times_s)
    before, after = like[(at - 1).clip(0)], like[at.clip(max=len(like) - 1)]
    return int(np.sum(np.minimum(np.abs(times_s - before), np.abs(times_s - after)) < within_s))


def _turning_points(
    motion: Motion, turning: AxisAngle, settled: _Settled, settings: CycleSettings
) -> tuple[TurningPoints, int]:
    """Find one turning point of each kind per cycle, and how many per cycle the bare hysteresis found.

    Zero stands for: one each, but the period is wrong.
    """
    period = settled.period
    length = period.seconds * motion.rate_hz
    if settled.pairs:
        # About the axis of the right period the range of motion is another one, and so are the peaks that pass.
        for hysteresis, pairs in itertools.product((settled.hysteresis, 0.5 * settled.hysteresis), (settled.pairs, 1)):
            found = turning_points(turning.angle_rad, hysteresis * turning.swing_rad)
            if len(found) <= 2 * pairs or abs(_between(found, pairs) / length - 1.0) > _ALMOST_PERIOD:
                continue
            if pairs == 1:
                return without_short_pairs(found, turning.angle_rad, 0.5 * length), 1
            label = kinds(strokes(motion, turning, found).pairs(), pairs)
            return one_a_cycle(found, turning.angle_rad, label, pairs, length), pairs
    found = turning_points(turning.angle_rad, settings.hysteresis * turning.swing_rad)
    spacing = _spacing(found) / length
    if len(spacing) == 0:
        return found, 1
    if period.confidence < settings.min_confidence:
        return (found, 0) if _even_swings(found, turning.angle_rad, settings) else (NONE_FOUND, 1)
    low, high = settings.spacing
    if low <= np.median(spacing) <= high and np.mean(spacing < low) < 0.2:
        return without_short_pairs(found, turning.angle_rad, 0.5 * length), 1
    if period.confidence < settings.sure_confidence and _even_swings(found, turning.angle_rad, settings):
        return found, int(np.median(spacing) > 1.0)  # longer ones have pauses in them
    pairs = min(round(1.0 / float(np.median(spacing))), MAX_PAIRS)
    if pairs <= 1:
        return without_short_pairs(found, turning.angle_rad, 0.5 * length), 1
    label = kinds(strokes(motion, turning, found).pairs(), pairs)
    return one_a_cycle(found, turning.angle_rad, label, pairs, length), pairs


def _spacing(found: TurningPoints) -> IntArray:
    """Return the distances between turning points of one kind, of both kinds, grid points."""
    return np.concatenate([np.diff(found.points[found.upper == kind]) for kind in (True, False)])


def _even_swings(found: TurningPoints, angle: FloatArray, settings: CycleSettings) -> bool:
    """Return whether four fifths of all swings are of one size: then each to and fro is a cycle, of whatever length."""
    travel = np.abs(np.diff(angle[found.points]))
    size = travel / np.median(travel)
    least, most = settings.even_swings
    return len(travel) >= 5 and float(np.mean((size > least) & (size < most))) >= 0.8


def _with_runs(result: CycleAnalysis, extremes: Extremes, period: Period) -> CycleAnalysis:
    """Split the extremes of one kind into runs, gate their ends, and choose the longest."""
    settings, window = result.settings, result.window
    period_s, any_tempo = period.seconds, period.confidence < settings.min_confidence
    runs: list[tuple[Endpoint, ...]] = []
    left_out = list(extremes.refused)
    for piece in split_runs(extremes, period_s, settings):
        run, off = piece, list[LeftOut]()
        if window is None:
            run, off = gate_ends(extremes, piece, period_s, settings, any_tempo=any_tempo)
            run, grasp = leave_out_grasp(extremes, run, settings)
            off += grasp
        else:
            inside = [k for k in range(piece.start, piece.stop) if _inside(extremes.endpoints[k], window)]
            run = slice(inside[0], inside[-1] + 1) if inside else slice(0, 0)
        left_out += off
        if run.stop - run.start == 1:  # no cycle ends here: an idle pose, or what is left between two pauses
            point = extremes.endpoints[run.start]
            left_out.append(LeftOut(point.time_s, f"alone, held {point.dwell_s:.2f} s", primary=False))
        elif run.stop > run.start:
            runs.append(with_flags(extremes, run, period_s, settings))
    longest = int(np.argmax([len(run) for run in runs])) if runs else 0
    scored = tuple(Run(run, scored=k == longest) for k, run in enumerate(runs))
    return replace(result, runs=scored, left_out=tuple(left_out))


def _inside(point: Endpoint, window: tuple[float, float]) -> bool:
    """Return whether the dwell of an end point touches the window: a window may be cut at the end points themselves."""
    return window[0] - 0.5 * point.dwell_s <= point.time_s <= window[1] + 0.5 * point.dwell_s
