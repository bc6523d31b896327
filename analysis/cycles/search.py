"""Where each cycle ends, found offline from the orientation alone, with no number set per recording.

The steps, in order: angular velocity on an even grid (:mod:`analysis.cycles.motion`); the active part; the period
(:mod:`analysis.cycles.period`); the motion axis and the angle about it (:mod:`analysis.cycles.axis`); its turning
points (:mod:`analysis.cycles.turning_points`); how many strokes between them make a cycle, which may correct the period
(:mod:`analysis.cycles.pairing.settled`); end points in the middle of their dwell and runs
(:mod:`analysis.cycles.endpoints`); gates at the ends only (:mod:`analysis.cycles.gates`); what may be claimed
(:mod:`analysis.cycles.verdict`).
Irregular cycles inside a trial are kept and flagged, never dropped: a slip is what the benchmark measures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.bounds import MAX_GRID_POINTS
from analysis.cycles.endpoints import Extremes, measure, split_runs, with_flags
from analysis.cycles.gates import gate_ends, leave_out_grasp
from analysis.cycles.motion import Motion, angular_velocity
from analysis.cycles.pairing.settled import Settled, axis_of, cycles_apart, settle, spacing_of, turning_points_of
from analysis.cycles.period import Period, search_period
from analysis.cycles.repetition import swing_trend
from analysis.cycles.settings import LONG_DWELL, CycleAnalysis, CycleSettings, Endpoint, LeftOut, Run
from analysis.cycles.usable_samples import Samples
from analysis.cycles.verdict import why_no_period, with_verdict
from analysis.geometry import rotations
from analysis.series import OrientationSeries

__all__ = ["CycleAnalysis", "CycleSettings", "Endpoint", "LeftOut", "Run", "find_cycles"]

_DEFAULTS = CycleSettings()
_MAX_GRID_PER_SAMPLE = 50
_SMALL_GRID = 1_000_000  # costs nothing, however empty


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
    points = (samples.times_s[-1] - samples.times_s[0]) * settings.rate_hz if n else 0.0
    if n < 2 or points <= min(_MAX_GRID_PER_SAMPLE * n + _SMALL_GRID, MAX_GRID_POINTS):
        return ""
    if points <= _MAX_GRID_PER_SAMPLE * n:
        hours = points / settings.rate_hz / 3600.0
        return f"{hours:.0f} hours are too long for one search: cut the recording into trials, or choose end points"
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
    settled = None if period is None else settle(moving, period, smooth_s, settings)
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
    settled: Settled,
    smooth_s: float,
    like_s: Sequence[float],
) -> CycleAnalysis:
    settings, period, turning = nothing.settings, settled.period, settled.turning
    if turning is None or len(turning.angle_rad) != len(motion.omega) + 1:
        turning = axis_of(motion, period, smooth_s, settings)
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
    found, peaks = turning_points_of(motion, turning, settled, settings)
    if peaks == 0:  # every swing is a cycle, of changing length: the autocorrelation saw several as one
        period, peaks = Period(float(np.median(spacing_of(found))) / motion.rate_hz, period.confidence), 1
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
    apart = cycles_apart(result.endpoints, motion, turning, found)
    result = with_verdict(result, motion, turning, samples, period, apart)
    if not settled.possible or not result.valid:
        return result
    seconds = period.seconds * settled.possible / max(settled.pairs, 1)
    other_way = Settled(Period(seconds, period.confidence), settled.possible, settled.hysteresis)
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
