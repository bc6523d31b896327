"""The rest before the motion: what it shows of the sensor's own drift, live as in the score at the end."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from analysis.sensor.baseline import StaticBaseline, baseline_from_holds
from analysis.sensor.still_holds import still_holds
from analysis.series import OrientationSeries

POSE_S = 0.03
"""A pose is kept every so often."""
MAX_POSES = 4000
"""Two minutes: of a longer rest the end counts."""


class FirstRest:
    """Keeps poses until the first end point is known."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, npt.NDArray[np.float64]]] = deque(maxlen=MAX_POSES)

    def feed(self, time_s: float, quat_wxyz: npt.NDArray[np.float64]) -> None:
        """Keep a pose; one that is earlier than, or too close to, the one before is passed over."""
        if not self._poses or time_s - self._poses[-1][0] >= POSE_S:
            self._poses.append((time_s, quat_wxyz))

    def baseline(self) -> StaticBaseline | None:
        """Measure the sensor by the rests among the poses; None where none lasted 3 s."""
        if len(self._poses) < 2:
            return None
        times_s, quats = zip(*self._poses, strict=True)
        series = OrientationSeries(np.array(times_s), np.array(quats), np.arange(len(times_s)))
        return baseline_from_holds(still_holds(series))
