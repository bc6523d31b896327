"""From turning points to end points: place, orientation, runs, flags."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from analysis.cycles.axis import AxisAngle
from analysis.cycles.motion import Motion
from analysis.cycles.settings import AFTER_PAUSE, LONG_DWELL, CycleSettings, Endpoint, LeftOut
from analysis.cycles.turning_points import TurningPoints, dwell, swings
from analysis.cycles.usable_samples import Samples
from analysis.geometry import rotations
from analysis.series import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Extremes:
    """All extremes of one kind, in time order, measured."""

    endpoints: tuple[Endpoint, ...]
    """One per extreme, without flags."""
    inner_swing: FloatArray
    """(k, 2) travel before and after each, as a share of the range of motion."""
    goes_on: BoolArray
    """(k − 1,) whether one cycle, however long, lies between each and the next: a pause in it only makes it longer."""
    refused: tuple[LeftOut, ...]
    """Extremes inside data gaps."""


def measure(
    samples: Samples,
    motion: Motion,
    turning: AxisAngle,
    found: TurningPoints,
    period_s: float,
    settings: CycleSettings,
    *,
    upper: bool,
) -> Extremes:
    """Place every extreme of one kind in the middle of its dwell and take its orientation.

    Parameters
    ----------
    samples : Samples
        Where orientations come from.
    motion : Motion
        The grid.
    turning : AxisAngle
        Rotation about the motion axis, on it.
    found : TurningPoints
        Turning points of both kinds.
    period_s : float
        Length of a cycle, s.
    settings : CycleSettings
        Depth of the dwell, width of the average, largest gap.
    upper : bool
        Which kind.
    """
    angle, start_s, step_s = turning.angle_rad, motion.start_s, 1.0 / motion.rate_hz
    before, after = swings(found, angle)
    bounds = np.concatenate(([0], found.points, [len(angle) - 1]))
    max_gap_s = max(settings.max_gap * period_s, 3.0 * samples.usual_step_s)
    chosen = np.flatnonzero(found.upper == upper)
    least = np.minimum(before, after)[chosen]
    # The depth is a share of the range of motion; of less where a turning point with less travel than usual was found,
    # as at the peaks within a cycle: at most of the range for which its travel would just count.
    depths = settings.dwell_depth * np.minimum(turning.swing_rad, least / settings.hysteresis)
    dwells = [
        dwell(angle, int(found.points[k]), int(bounds[k]), int(bounds[k + 2]), depth)
        for k, depth in zip(chosen.tolist(), depths.tolist(), strict=True)
    ]
    first, last = np.array(dwells).reshape(-1, 2).T
    times_s = start_s + 0.5 * (first + last) * step_s
    # An end point inside a gap has no orientation and is refused; a gap elsewhere in its dwell only earns it a flag.
    gaps_s = samples.brackets_s(times_s)
    near_gaps = samples.have_gaps(start_s + first * step_s, start_s + last * step_s, max_gap_s)
    names = samples.nearest(times_s)
    kept = np.flatnonzero(gaps_s <= max_gap_s)
    quats = samples.orientations(times_s[kept], settings.average * period_s)
    endpoints = tuple(
        Endpoint(
            time_s=float(times_s[k]),
            index=int(names[k]),
            quat_wxyz=quat,
            dwell_s=float((last[k] - first[k]) * step_s),
            prominence_deg=float(np.degrees(least[k])),
            flags=("gap nearby",) if near_gaps[k] else (),
        )
        for k, quat in zip(kept.tolist(), quats, strict=True)
    )
    refused = tuple(
        LeftOut(float(times_s[k]), f"inside a gap of {gaps_s[k]:.3g} s in the data", primary=False)
        for k in np.flatnonzero(gaps_s > max_gap_s).tolist()
    )
    travel = np.stack([before, after], axis=1)[chosen[kept]] / turning.swing_rad
    # One turning point of the other kind between two, as far off as usual, and all of it seen.
    whole = (travel[:-1, 1] >= settings.swing[0]) & (travel[1:, 0] >= settings.swing[0])
    whole &= np.all((travel[:-1, 1:] <= settings.swing[1]) & (travel[1:, :1] <= settings.swing[1]), axis=1)
    whole &= np.diff(chosen[kept]) == 2
    whole &= ~samples.have_gaps(times_s[kept[:-1]], times_s[kept[1:]], max_gap_s)
    whole &= _as_far_as_one(motion, times_s[kept], settings)
    return Extremes(endpoints, travel, whole, refused)


def _as_far_as_one(motion: Motion, times_s: FloatArray, settings: CycleSettings) -> BoolArray:
    """Return (k − 1,) whether the object turns as far between each moment and the next as in one cycle.

    A pause is rest. Where turning points were missed, the object turns on instead, as far as in two cycles.
    """
    path = np.concatenate(([0.0], np.cumsum(rotations.row_lengths(motion.omega) * (motion.speed > motion.threshold))))
    turned = np.diff(np.interp(times_s, motion.times_s, path))
    return np.asarray(turned <= settings.swing[1] * np.median(turned)) if len(turned) else np.ones(0, dtype=bool)


def split_runs(extremes: Extremes, period_s: float, settings: CycleSettings) -> list[slice]:
    """Return the runs of extremes, in time order: a pause ends one unless the phase goes on behind it."""
    times_s = np.array([point.time_s for point in extremes.endpoints])
    cuts = 1 + np.flatnonzero((np.diff(times_s) > settings.pause * period_s) & ~extremes.goes_on)
    edges = [0, *cuts.tolist(), len(times_s)]
    return [slice(a, b) for a, b in itertools.pairwise(edges) if b > a]


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
        if k and spacing[k - 1] > settings.pause:
            flags.append(AFTER_PAUSE)
        elif k and odd_spacing[k - 1]:
            flags.append("odd spacing")
        if odd_swing[k]:
            flags.append("odd swing")
        if k and jump[k - 1]:
            flags.append("pose jump")
        if point.dwell_s > 2.0 * usual_dwell_s + 0.25 * period_s:
            flags.append(LONG_DWELL)
        flagged.append(replace(point, flags=tuple(flags)))
    return tuple(flagged)


def pose_jumps(quats: FloatArray) -> BoolArray:
    """Find steps far larger than the others: slips.

    Parameters
    ----------
    quats : array of float
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
