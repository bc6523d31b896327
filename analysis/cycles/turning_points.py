"""Turning points of an angle that swings: where, how far, and how long it stays there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.series import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class TurningPoints:
    """Alternating extremes of an angle, in time order."""

    points: IntArray
    """(k,) grid points of the extremes."""
    upper: BoolArray
    """(k,) True where it is a maximum; alternates."""

    def __len__(self) -> int:
        return len(self.points)

    def first(self, count: int) -> TurningPoints:
        """Return the first ones."""
        return TurningPoints(self.points[:count], self.upper[:count])

    def between(self, first: float, last: float) -> TurningPoints:
        """Return those between two grid points."""
        inside = (self.points >= first) & (self.points <= last)
        return TurningPoints(self.points[inside], self.upper[inside])

    def apart(self, spacing: float) -> TurningPoints:
        """Return those that follow the one before of their kind by this many grid points."""
        kept = np.ones(len(self), dtype=bool)
        for kind in (True, False):
            places = np.flatnonzero(self.upper == kind)
            last = -np.inf
            for place in places.tolist():
                kept[place] = self.points[place] - last >= spacing
                last = float(self.points[place]) if kept[place] else last
        return TurningPoints(self.points[kept], self.upper[kept])


NONE_FOUND = TurningPoints(np.empty(0, dtype=np.int64), np.empty(0, dtype=bool))


def turning_points(angle: FloatArray, hysteresis: float) -> TurningPoints:
    """Find the extremes between which the angle travels at least ``hysteresis`` each way.

    The first and the last one found are bounded on one side only by the ends of the data; they are left out unless
    the angle travels that far on both of their sides.

    Parameters
    ----------
    angle : array of float
        (m,) any unit.
    hysteresis : float
        Same unit; above 0.
    """
    slope = np.sign(np.diff(angle))
    slope = slope[np.maximum.accumulate(np.where(slope != 0.0, np.arange(len(slope)), 0))]  # plateaus carry on
    bends = 1 + np.flatnonzero(slope[1:] != slope[:-1])
    candidates = np.concatenate(([0], bends, [len(angle) - 1]))
    # Watch the highest point so far while rising, the lowest while falling, and both until the first turn; once the
    # angle is `hysteresis` away from the one watched, that is an extreme, and the other is watched from here on.
    found: list[int] = []
    kinds: list[bool] = []
    low = high = 0
    low_value = high_value = float(angle[0])
    rising: bool | None = None
    for point, value in zip(candidates.tolist(), angle[candidates].tolist(), strict=True):
        if value > high_value:
            high, high_value = point, value
        if value < low_value:
            low, low_value = point, value
        if rising is not False and high_value - value >= hysteresis:
            if rising or high_value - angle[0] >= hysteresis:
                found.append(high)
                kinds.append(True)
            rising, low, low_value = False, point, value
        elif rising is not True and value - low_value >= hysteresis:
            if rising is False or angle[0] - low_value >= hysteresis:
                found.append(low)
                kinds.append(False)
            rising, high, high_value = True, point, value
    return TurningPoints(np.array(found, dtype=np.int64), np.array(kinds, dtype=bool))


def without_short_pairs(found: TurningPoints, angle: FloatArray, min_spacing: float) -> TurningPoints:
    """Take out the smallest there-and-back wherever two extremes of one kind are nearer than ``min_spacing``.

    A slip in the middle of a cycle turns the angle back for a moment: two turning points that end no cycle.

    Parameters
    ----------
    found : TurningPoints
        Alternating extremes.
    angle : array of float
        (m,) what they were found in.
    min_spacing : float
        Grid points between two extremes of one kind.
    """
    points, upper = found.points.tolist(), found.upper.tolist()
    while len(points) > 3:
        spacing = np.diff(points, n=1)
        near = np.flatnonzero(spacing[1:] + spacing[:-1] < min_spacing)
        if len(near) == 0:
            break
        swings = np.abs(np.diff(angle[points]))
        pairs = np.unique(np.concatenate((near, near + 1)))
        smallest = int(pairs[np.argmin(swings[pairs])])
        del points[smallest : smallest + 2], upper[smallest : smallest + 2]
    return TurningPoints(np.array(points, dtype=np.int64), np.array(upper, dtype=bool))


def swings(found: TurningPoints, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far the angle travels to each extreme and away from it.

    Returns
    -------
    before, after
        (k,) each; beyond the first and last extreme, the largest travel up to the ends of the data.
    """
    points = found.points
    if len(points) == 0:
        return np.empty(0), np.empty(0)
    starts = np.concatenate(([0], points))
    low, high = np.minimum.reduceat(angle, starts), np.maximum.reduceat(angle, starts)
    values = angle[points]
    low[1:-1], high[1:-1] = np.minimum(low[1:-1], values[1:]), np.maximum(high[1:-1], values[1:])  # ends included
    before = np.where(found.upper, values - low[:-1], high[:-1] - values)
    after = np.where(found.upper, values - low[1:], high[1:] - values)
    return before, after


def dwell(angle: FloatArray, point: int, first: int, last: int, depth: float) -> tuple[float, float]:
    """Return the part around an extreme in which the angle stays within ``depth`` of it, in grid points.

    The middle of this part is a steadier mark than the extreme itself, which wanders on a plateau.

    Parameters
    ----------
    angle : array of float
        (m,) any unit.
    point : int
        The extreme.
    first, last : int
        Bounds of the search: the neighbouring extremes.
    depth : float
        Same unit as ``angle``.

    Returns
    -------
    start, end
        Fractional grid points, where the angle crosses the depth (linear between points), or the bounds.
    """
    away = np.abs(angle[first : last + 1] - angle[point])
    middle = point - first
    outside = away > depth  # never at the extreme itself
    start, end = float(first), float(last)
    k = middle - int(np.argmax(outside[middle::-1]))
    if outside[k]:
        start = first + k + (away[k] - depth) / (away[k] - away[k + 1])
    k = middle + int(np.argmax(outside[middle:]))
    if outside[k]:
        end = first + k - (away[k] - depth) / (away[k] - away[k - 1])
    return start, end
