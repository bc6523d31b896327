"""The period that the strokes confirm or correct, and the turning points of it: one of each kind a cycle.

The autocorrelation proposes a period. Strokes at two hystereses are grouped (:mod:`analysis.cycles.pairing.grouping`);
what they show goes before it where it is clear, and where it is not, both are kept as possible.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.cycles.axis import AxisAngle, motion_axis
from analysis.cycles.motion import Motion
from analysis.cycles.pairing.grouping import (
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
from analysis.cycles.pairing.strokes import StrokePairs, strokes
from analysis.cycles.period import Period, confidence_at
from analysis.cycles.settings import CycleSettings, Endpoint
from analysis.cycles.turning_points import NONE_FOUND, TurningPoints, turning_points, without_short_pairs
from analysis.series import FloatArray, IntArray

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
class Settled:
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


def settle(motion: Motion, period: Period, smooth_s: float, settings: CycleSettings) -> Settled:
    """Return the period that the strokes confirm or correct, where the autocorrelation has found one.

    Parameters
    ----------
    motion : Motion
        The part in which the object moves.
    period : Period
        That of the autocorrelation.
    smooth_s : float
        Further smoothing with which it was found, s.
    settings : CycleSettings
        Hysteresis and what else the search works with.
    """
    length = period.seconds * motion.rate_hz
    head = motion.part(0, int(_JUDGED_PERIODS * length))
    turning = axis_of(head, period, smooth_s, settings)
    # The axis of all motion need not be found again, if this is all motion.
    whole = turning if len(head.omega) == len(motion.omega) else None
    motion = head
    # At each hysteresis: the turning points, how their strokes group, and the pairs that were grouped.
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
        return Settled(period, turning=whole)
    # Where the two disagree, the one whose kinds of pairs lie further apart counts.
    hysteresis, found, grouping, pairs = min(seen, key=lambda way: way[2].nearness)
    k = grouping.pairs
    between = _between(found, k)
    # Where cycles of the shorter period repeat nearly exactly, kinds that are not obvious must repeat better still.
    if k > 1 and grouping.nearness > OBVIOUS and period.confidence >= _NEARLY_EXACT and between > 1.5 * length:
        better = confidence_at(motion, between / motion.rate_hz, settings) - period.confidence
        if better < 0.5 * (1.0 - period.confidence):
            return Settled(period, hysteresis=hysteresis, possible=k, turning=whole)
    if abs(between / length - 1.0) <= _SAME_PERIOD:
        return Settled(period, k if k > 1 else 0, hysteresis, grouping.possible, whole)
    # Every pair is a cycle only where the pairs hardly differ, nor recur in their durations.
    even = (
        between < length
        and grouping.spread <= _EVEN_SPREAD
        and not durations_recur(pairs, max(round(length / between), 2))
    )
    if k == 1 and not even:
        return Settled(period, possible=grouping.possible, turning=whole)
    seconds = between / motion.rate_hz
    return Settled(Period(seconds, confidence_at(motion, seconds, settings)), k, hysteresis, grouping.possible)


def turning_points_of(
    motion: Motion, turning: AxisAngle, settled: Settled, settings: CycleSettings
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
    spacing = spacing_of(found) / length
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


def axis_of(motion: Motion, period: Period, smooth_s: float, settings: CycleSettings) -> AxisAngle:
    """Return the rotation about the motion axis, with the window that a period asks for."""
    return motion_axis(
        motion,
        period.seconds,
        sigma_periods=settings.axis_sigma,
        smooth_s=smooth_s,
        speed_limit=settings.speed_limit,
    )


def cycles_apart(points: Sequence[Endpoint], motion: Motion, turning: AxisAngle, found: TurningPoints) -> float:
    """Return how far the cycles between end points are from their neighbours, in swings; infinite for too few."""
    if len(points) < 2:
        return float("inf")
    first, last = ((points[k].time_s - motion.start_s) * motion.rate_hz for k in (0, -1))
    margin = 0.6 * (last - first) / (len(points) - 1)
    near = strokes(motion, turning, found.between(first - margin, last + margin).first(MAX_POINTS))
    return min(spread(near.pairs()), spread(near.pairs(1)))


def _between(found: TurningPoints, pairs: int) -> float:
    """Return the median distance of turning points so many pairs of strokes apart, pauses left out, grid points."""
    distances = found.points[2 * pairs :] - found.points[: -2 * pairs]
    return float(np.median(distances[distances <= _PAUSED * np.percentile(distances, 25)]))


def spacing_of(found: TurningPoints) -> IntArray:
    """Return the distances between turning points of one kind, of both kinds, grid points."""
    return np.concatenate([np.diff(found.points[found.upper == kind]) for kind in (True, False)])


def _even_swings(found: TurningPoints, angle: FloatArray, settings: CycleSettings) -> bool:
    """Return whether four fifths of all swings are of one size: then each to and fro is a cycle, of whatever length."""
    travel = np.abs(np.diff(angle[found.points]))
    size = travel / np.median(travel)
    least, most = settings.even_swings
    return len(travel) >= 5 and float(np.mean((size > least) & (size < most))) >= 0.8
