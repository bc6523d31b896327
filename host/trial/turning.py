"""How fast the object turns, from a pose now and then."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from analysis.geometry import rotations

TURN_S = 0.5
"""Time over which the turning rate is a mean."""
PEAK_S = 1.0
"""How long the fastest turn is kept: longer than from one picture to the next."""


class Turning:
    """Keeps the poses of the last half second, some 30 ms apart, and the fastest turn between two of them."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, npt.NDArray[np.float64]]] = deque(maxlen=64)
        self._peak_s = -np.inf
        self._peak_dps = 0.0

    def feed(self, time_s: float, quat_wxyz: npt.NDArray[np.float64]) -> bool:
        """Take a pose into account; return whether it was kept: one too close to the one before is not."""
        if self._poses:
            before_s, before = self._poses[-1]
            if time_s - before_s < TURN_S / 16:
                return False
            rate_dps = float(np.degrees(rotations.distance(quat_wxyz, before))) / (time_s - before_s)
            if time_s - self._peak_s > PEAK_S or rate_dps > self._peak_dps:
                self._peak_s, self._peak_dps = time_s, rate_dps
        self._poses.append((time_s, quat_wxyz))
        return True

    @property
    def rate_dps(self) -> float | None:
        """Mean over the last half second, deg/s; None before two poses."""
        if len(self._poses) < 2:
            return None
        time_s, quat = self._poses[-1]
        since_s, before = next(((t, q) for t, q in self._poses if time_s - t <= TURN_S), self._poses[-1])
        if time_s <= since_s:
            return None
        return float(np.degrees(rotations.distance(quat, before))) / (time_s - since_s)

    @property
    def peak_dps(self) -> float | None:
        """The fastest turn of late, deg/s; None before the first pose."""
        return self._peak_dps if self._poses else None
