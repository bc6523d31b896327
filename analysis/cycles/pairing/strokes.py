"""Strokes between turning points in pairs, there and back, each in one form: what shows how many pairs make a cycle.

Neither tempo, nor rests, nor drift may matter when pairs are compared, so each runs over equal phases of its strokes,
starts at zero, and is divided by the swing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.cycles.axis import AxisAngle
from analysis.cycles.motion import Motion
from analysis.cycles.turning_points import TurningPoints, dwell
from analysis.series import FloatArray

_PHASES = 16
"""Points on a stroke."""
_DEPTH = 0.1
"""The rest at a turning point is not part of a stroke: what stays this near to it, share of the swing, ..."""
_TRAVEL = 0.25
"""... and of the travel to its neighbours: the smallest strokes keep half of theirs."""


@dataclass(frozen=True, eq=False)
class StrokePairs:
    """Pairs of strokes in time order; each ends where the next one starts."""

    shapes: FloatArray
    """(n, f) turn about the motion axis and across it since the start of the pair, in swings; its norm is an RMS."""
    durations: FloatArray
    """(n, 2) logarithm of the time that each stroke takes, without rests."""

    def __len__(self) -> int:
        return len(self.shapes)


@dataclass(frozen=True, eq=False)
class Strokes:
    """What the object does between each turning point and the next."""

    along: FloatArray
    """(s, phases, 3) turn about the motion axis and across it, in swings."""
    starts: FloatArray
    """(s, 3) the same at the turning points."""
    durations: FloatArray
    """(s,) logarithm of the time that each takes, without rests."""

    def pairs(self, first: int = 0) -> StrokePairs:
        """Return the strokes two by two, from the first or from the second turning point on."""
        n = max((len(self.along) - first) // 2, 0)
        used = slice(first, first + 2 * n)
        turned = self.along[used].reshape(n, 2 * _PHASES, 3) - self.starts[used][::2, None]
        return StrokePairs(turned.reshape(n, 6 * _PHASES) / np.sqrt(2 * _PHASES), self.durations[used].reshape(n, 2))


def strokes(motion: Motion, turning: AxisAngle, found: TurningPoints) -> Strokes:
    """Return the strokes between turning points.

    Parameters
    ----------
    motion : Motion
        m grid intervals.
    turning : AxisAngle
        Rotation about the motion axis, on the same grid.
    found : TurningPoints
        Alternating extremes of its angle.
    """
    points, angle = found.points, turning.angle_rad
    if len(points) < 2:
        return Strokes(np.empty((0, _PHASES, 3)), np.empty((0, 3)), np.empty(0))
    travel = np.abs(np.diff(angle[points]))
    least = np.minimum(np.append(travel, travel[-1]), np.insert(travel, 0, travel[0]))
    depths = np.minimum(_DEPTH * turning.swing_rad, _TRAVEL * least)
    bounds = np.concatenate((points[:1], points, points[-1:])).tolist()
    rests = np.array(
        [dwell(angle, bounds[k + 1], bounds[k], bounds[k + 2], depth) for k, depth in enumerate(depths.tolist())]
    )
    starts, ends = rests[:-1, 1], rests[1:, 0]
    places = (starts[:, None] + (np.arange(_PHASES) + 0.5) / _PHASES * (ends - starts)[:, None]).ravel()
    turned = _turned(motion, turning, int(points[0]), int(points[-1])) / turning.swing_rad
    grid = np.arange(points[0], points[-1] + 1)
    along = np.stack([np.interp(places, grid, component) for component in turned.T], axis=1)
    at = turned[points[:-1] - points[0]]
    return Strokes(along.reshape(-1, _PHASES, 3), at, np.log(np.maximum(ends - starts, 1.0)))


def _turned(motion: Motion, turning: AxisAngle, first: int, last: int) -> FloatArray:
    """Return (last − first + 1, 3) ∫ω dt about the motion axis and two axes across it, carried along with it."""
    axes = turning.axes
    # The direction that is across the motion axis as far as one can be throughout fixes the other two.
    steady = np.linalg.eigh(axes.T @ axes)[1][:, 0]
    across = np.cross(steady, axes)
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    centres, grid = (np.arange(len(axes)) + 0.5) * turning.bin_points, np.arange(first, last) + 0.5
    parts = []
    for frame in (axes, across, np.cross(axes, across)):
        carried = np.stack([np.interp(grid, centres, component) for component in frame.T], axis=1)
        carried /= np.maximum(np.linalg.norm(carried, axis=1), 1e-12)[:, None]
        parts.append(np.einsum("ij,ij->i", carried, motion.omega[first:last]))
    return np.concatenate((np.zeros((1, 3)), np.cumsum(np.stack(parts, axis=1), axis=0) / motion.rate_hz))
