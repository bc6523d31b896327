"""From turning points to end points: place, orientation, gates at the ends, runs."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from analysis import averages, rotations
from analysis.angular_velocity import BoolArray, usable_rows
from analysis.cycle_analysis import CycleSettings, Endpoint, LeftOut
from analysis.cycle_likeness import sample_noise_rad
from analysis.series import FloatArray, IntArray, OrientationSeries
from analysis.turning_points import TurningPoints, dwell, swings

_GROUP = 256  # end points averaged together


@dataclass(frozen=True, eq=False)
class Samples:
    """Usable samples of a recording: what end points are measured from."""

    times_s: FloatArray
    """(n,) strictly increasing, s."""
    quats_wxyz: FloatArray
    """(n, 4) unit, scalar first."""
    index: IntArray
    """(n,) names of the samples in their source."""
    usual_step_s: float
    """Median distance between samples, s."""
    noise_rad: float
    """Noise of a single sample about each axis, rad."""

    @staticmethod
    def of(series: OrientationSeries) -> Samples:
        """Take the usable samples of a recording; at least three."""
        rows = usable_rows(series.times_s)
        times_s, quats = series.times_s[rows], series.quats_wxyz[rows]
        step_s = float(np.median(np.diff(times_s)))
        return Samples(times_s, quats, series.index[rows], step_s, sample_noise_rad(quats))

    def bracket_s(self, time_s: float) -> float:
        """Distance between the samples around a moment, s; infinite outside the data."""
        right = int(np.searchsorted(self.times_s, time_s))
        if right == 0 or right == len(self.times_s):
            return 0.0 if time_s in (self.times_s[0], self.times_s[-1]) else float("inf")
        return float(self.times_s[right] - self.times_s[right - 1])

    def longest_step_s(self, start_s: float, end_s: float) -> float:
        """Longest distance between neighbouring samples in a stretch, s."""
        first = max(int(np.searchsorted(self.times_s, start_s)) - 1, 0)
        last = int(np.searchsorted(self.times_s, end_s)) + 1
        steps = np.diff(self.times_s[first:last])
        return float(steps.max()) if len(steps) else float("inf")

    def nearest(self, time_s: float) -> int:
        """Name of the sample nearest to a moment."""
        right = int(np.clip(np.searchsorted(self.times_s, time_s), 1, len(self.times_s) - 1))
        nearer_left = time_s - self.times_s[right - 1] <= self.times_s[right] - time_s
        return int(self.index[right - 1 if nearer_left else right])

    def orientations(self, moments_s: FloatArray, reach_s: float) -> FloatArray:
        """(k, 4) average of the samples around each of k moments, weights falling linearly to 0 at ``reach_s``.

        At least the three nearest samples are used. Each stands for the time around it, so that the average is one
        over time and lost samples do not pull it to one side. The weights fall to 0, so that a moment that shifts by a
        rounding error never takes in or loses a whole sample.
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
        # Groups of alike size together: one between lost samples must not make all others as long.
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
            found[group] = averages.average_each(self.quats_wxyz[rows], np.where(inside, weights * own, 0.0))
        return found


@dataclass(frozen=True, eq=False)
class Extremes:
    """All extremes of one kind, in time order, measured."""

    endpoints: tuple[Endpoint, ...]
    """One per extreme, without flags."""
    inner_swing: FloatArray
    """(k, 2) travel before and after each, as a share of the range of motion."""
    refused: tuple[LeftOut, ...]
    """Extremes inside data gaps."""


def measure(
    samples: Samples,
    found: TurningPoints,
    angle: FloatArray,
    grid_s: tuple[float, float],
    swing_rad: float,
    period_s: float,
    settings: CycleSettings,
    *,
    upper: bool,
) -> Extremes:
    """Place every extreme of one kind in the middle of its dwell and take its orientation.

    Parameters
    ----------
    samples
        Where orientations come from.
    found
        Turning points of both kinds.
    angle
        (m + 1,) rotation about the motion axis, rad.
    grid_s
        Time of the first grid point and distance between grid points, s.
    swing_rad
        Range of motion, rad.
    period_s
        Length of a cycle, s.
    settings
        Depth of the dwell, width of the average, largest gap.
    upper
        Which kind.
    """
    start_s, step_s = grid_s
    before, after = swings(found, angle)
    bounds = np.concatenate(([0], found.points, [len(angle) - 1]))
    max_gap_s = max(settings.max_gap * period_s, 3.0 * samples.usual_step_s)
    kept: list[Endpoint] = []
    travel: list[tuple[float, float]] = []
    refused: list[LeftOut] = []
    for k in np.flatnonzero(found.upper == upper).tolist():
        small = min(float(before[k]), float(after[k])) / settings.hysteresis  # below R where humps were passed over
        depth = settings.dwell_depth * min(swing_rad, small)
        first, last = dwell(angle, int(found.points[k]), int(bounds[k]), int(bounds[k + 2]), depth)
        time_s = float(start_s + 0.5 * (first + last) * step_s)
        gap_s = samples.bracket_s(time_s)
        if gap_s > max_gap_s:
            refused.append(LeftOut(time_s, f"inside a gap of {gap_s:.3g} s in the data", primary=False))
            continue
        stretch_s = samples.longest_step_s(start_s + first * step_s, start_s + last * step_s)
        kept.append(
            Endpoint(
                time_s=time_s,
                index=samples.nearest(time_s),
                quat_wxyz=rotations.IDENTITY,  # all at once below
                dwell_s=float((last - first) * step_s),
                prominence_deg=float(np.degrees(min(before[k], after[k]))),
                flags=("gap nearby",) if stretch_s > max_gap_s else (),
            )
        )
        travel.append((float(before[k]) / swing_rad, float(after[k]) / swing_rad))
    quats = samples.orientations(np.array([point.time_s for point in kept]), settings.average * period_s)
    kept = [replace(point, quat_wxyz=quat) for point, quat in zip(kept, quats, strict=True)]
    return Extremes(tuple(kept), np.array(travel).reshape(-1, 2), tuple(refused))


def split_runs(extremes: Extremes, period_s: float, settings: CycleSettings) -> list[slice]:
    """Stretches of extremes without a pause, in time order."""
    times_s = np.array([point.time_s for point in extremes.endpoints])
    cuts = 1 + np.flatnonzero(np.diff(times_s) > settings.pause * period_s)
    edges = [0, *cuts.tolist(), len(times_s)]
    return [slice(a, b) for a, b in itertools.pairwise(edges) if b > a]


def gate_ends(
    extremes: Extremes, run: slice, period_s: float, settings: CycleSettings, *, any_tempo: bool = False
) -> tuple[slice, list[LeftOut]]:
    """Leave out idle poses and irregular cycles at the two ends of a run; the inside is never touched.

    Parameters
    ----------
    extremes
        All extremes of one kind.
    run
        Which of them.
    period_s
        Length of a cycle, s.
    settings
        What is regular.
    any_tempo
        Tempo changes so much that the length of a cycle is judged by that of the next one.

    Returns
    -------
    run, left_out
        What remains, and what was taken off with the reason.
    """
    first, last = run.start, run.stop
    left_out: list[LeftOut] = []
    usual_dwell_s = float(np.median([point.dwell_s for point in extremes.endpoints[run]]))
    times_s = [point.time_s for point in extremes.endpoints]

    def usual_s(inner: int, further: int) -> float:
        return abs(times_s[further] - times_s[inner]) if any_tempo and last - first >= 3 else period_s

    while last - first >= 2 and (
        why := _irregular(extremes, first, first + 1, usual_s(first + 1, first + 2), usual_dwell_s, settings)
    ):
        left_out.append(LeftOut(extremes.endpoints[first].time_s, f"first cycle: {why}", primary=False))
        first += 1
    while last - first >= 2 and (
        why := _irregular(extremes, last - 1, last - 2, usual_s(last - 2, last - 3), usual_dwell_s, settings)
    ):
        left_out.append(LeftOut(extremes.endpoints[last - 1].time_s, f"last cycle: {why}", primary=False))
        last -= 1
    return slice(first, last), left_out


def _irregular(
    extremes: Extremes, end: int, inner: int, period_s: float, usual_dwell_s: float, settings: CycleSettings
) -> str:
    """Why the extreme at an end of a run is no end point; empty where it is one."""
    points = extremes.endpoints
    spacing = abs(points[inner].time_s - points[end].time_s) / period_s
    outward, inward = extremes.inner_swing[end][[0, 1] if inner > end else [1, 0]].tolist()
    if outward < settings.hysteresis:
        return "the pose before the motion or after it"
    if points[end].dwell_s > 2.0 * usual_dwell_s + 0.25 * period_s:
        return f"idle pose, held {points[end].dwell_s:.2f} s"
    if not settings.spacing[0] <= spacing <= settings.spacing[1]:
        return f"{spacing:.2f} periods from the next"
    if not settings.swing[0] <= inward <= settings.swing[1]:
        return f"swing of {inward:.2f} times the usual"
    return ""


def with_flags(extremes: Extremes, run: slice, period_s: float, settings: CycleSettings) -> tuple[Endpoint, ...]:
    """Flag what is odd about the end points of a run; nothing is dropped."""
    points = extremes.endpoints[run]
    travel = extremes.inner_swing[run]
    spacing = np.diff([point.time_s for point in points]) / period_s
    odd_spacing = ~((spacing >= settings.spacing[0]) & (spacing <= settings.spacing[1]))
    odd_swing = np.any((travel < settings.swing[0]) | (travel > settings.swing[1]), axis=1).tolist()
    usual_dwell_s = float(np.median([point.dwell_s for point in points]))
    jump = pose_jumps(np.array([point.quat_wxyz for point in points]))
    flagged = []
    for k, point in enumerate(points):
        flags = list(point.flags)
        if k and odd_spacing[k - 1]:
            flags.append("odd spacing")
        if odd_swing[k]:
            flags.append("odd swing")
        if k and jump[k - 1]:
            flags.append("pose jump")
        if point.dwell_s > 2.0 * usual_dwell_s + 0.25 * period_s:
            flags.append("long dwell")
        flagged.append(replace(point, flags=tuple(flags)))
    return tuple(flagged)


def pose_jumps(quats: FloatArray) -> BoolArray:
    """Find steps far larger than the others: slips.

    Parameters
    ----------
    quats
        (k, 4) orientations at the end points.

    Returns
    -------
    (k − 1,) True where the angle of a step is above the median by 6 times the spread and 0.1°.
    """
    if len(quats) < 4:
        return np.zeros(max(len(quats) - 1, 0), dtype=bool)
    steps = rotations.distance(quats[1:], quats[:-1])
    middle = float(np.median(steps))
    spread = float(np.median(np.abs(steps - middle)))
    return np.asarray(steps > middle + 6.0 * 1.4826 * spread + np.radians(0.1), dtype=np.bool_)
