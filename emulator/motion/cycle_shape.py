"""The shape of one hand cycle: how far the object has turned, and how much of the path is done, at each phase.

Every shape is a chain of turning points joined by half cosines, so it is known in closed form and its rate is zero at
every turning point::

    height(u) = h_j + (h_{j+1} − h_j) · (1 − cos π w) / 2,   w = (u − u_j) / (u_{j+1} − u_j)

A phase ``u`` is in [0, 1): height 0, the *near* extreme, is at u = 0; height 1, the *far* extreme, is at ``far_phase``.
The *path* is the distance travelled since u = 0 as a fraction of the whole cycle; it stands still where the hand does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emulator.motion.rotation import FloatArray


@dataclass(frozen=True)
class CycleShape:
    """A periodic shape through turning points."""

    phases: tuple[float, ...]
    """Phases of the turning points, increasing from 0 to 1."""
    heights: tuple[float, ...]
    """Heights there, in [0, 1]; the first and the last are 0, one is 1. Equal neighbours are a dwell."""
    far_phase: float
    """Phase of the far extreme: the middle of its dwell, where it has one."""

    def evaluate(self, phase: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Evaluate the shape at phases (n,) in cycles; only their fraction counts.

        Returns
        -------
        height : numpy.ndarray
            (n,) in [0, 1].
        height_rate : numpy.ndarray
            (n,) per cycle.
        path : numpy.ndarray
            (n,) fraction of the cycle's path since the last near extreme, plus the whole cycles; never decreases.
        path_rate : numpy.ndarray
            (n,) per cycle.
        """
        knots, heights = np.array(self.phases), np.array(self.heights)
        travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(heights)))])
        travelled /= travelled[-1]
        whole = np.floor(phase)
        within = phase - whole
        j = np.clip(np.searchsorted(knots, within, side="right") - 1, 0, len(knots) - 2)
        span = knots[j + 1] - knots[j]
        angle = np.pi * (within - knots[j]) / span
        eased, eased_rate = 0.5 * (1.0 - np.cos(angle)), 0.5 * np.pi * np.sin(angle) / span
        rise, way = heights[j + 1] - heights[j], travelled[j + 1] - travelled[j]
        return (
            heights[j] + rise * eased,
            rise * eased_rate,
            whole + travelled[j] + way * eased,
            way * eased_rate,
        )


def cosine() -> CycleShape:
    """Return (1 − cos 2πu) / 2: there and back without a stop."""
    return CycleShape((0.0, 0.5, 1.0), (0.0, 1.0, 0.0), far_phase=0.5)


def trapezoid(dwell: float) -> CycleShape:
    """Return a shape that rests at both extremes, each for ``dwell`` of the cycle (0 <= dwell < 0.5).

    Phase 0 and ``far_phase`` are the middles of the two dwells.
    """
    half = 0.5 * dwell
    if half == 0.0:
        return cosine()
    return CycleShape((0.0, half, 0.5 - half, 0.5 + half, 1.0 - half, 1.0), (0.0, 0.0, 1.0, 1.0, 0.0, 0.0), 0.5)


def two_hump(second_height: float, saddle_height: float) -> CycleShape:
    """Return a shape that goes to the far extreme, half back, and up again to a lower peak before it returns.

    The second peak's height is below 1 and above that of the saddle, the turn between the peaks, which is above 0.
    """
    return CycleShape((0.0, 0.3, 0.5, 0.7, 1.0), (0.0, 1.0, saddle_height, second_height, 0.0), far_phase=0.3)


def double_peak(second_height: float, saddle_height: float) -> CycleShape:
    """Return a shape of two peaks half a cycle apart: but for the heights, two cycles of half the period.

    The second peak's height is at most 1, as high as the far extreme, and above that of the saddle, which is above 0.
    """
    return CycleShape((0.0, 0.25, 0.5, 0.75, 1.0), (0.0, 1.0, saddle_height, second_height, 0.0), far_phase=0.25)
