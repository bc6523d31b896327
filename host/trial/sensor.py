"""The sensor as the samples show it: its last orientation and flags, and its own drift from a rest."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt

from analysis.scoring.trust import MIN_REST_FOR_FLOOR_S
from analysis.sensor.baseline import StaticBaseline, baseline_from_holds
from analysis.sensor.still_holds import still_holds
from analysis.series import OrientationSeries
from firmware_protocol.packets import Info, OrientationFlag, Status
from host.stream.blocks import SampleBlock
from host.text import plain
from host.trial.state import SensorView, plain_quaternion

SATURATION_S = 1.0
"""How long a saturated sample is shown."""
MAX_POSES = 4000
"""Two minutes: of a longer rest the end counts."""


class SensorWatch:
    """Follows the sensor of one trial; without a baseline, it is measured in the rest before the motion."""

    def __init__(self, baseline: StaticBaseline | None) -> None:
        self._baseline = baseline
        self._resting = baseline is None  # until the first end point
        self._poses: deque[tuple[float, npt.NDArray[np.float64]]] = deque(maxlen=MAX_POSES)  # of the rest
        self._floor_known = baseline is not None  # a short rest shows the drift, but no floor
        self._saturated_s = -math.inf
        self._last: SampleBlock | None = None

    def feed(self, block: SampleBlock, newest_s: float) -> None:
        """Note samples; ``newest_s`` is the newest time on the time axis so far."""
        self._last = block
        if np.any(block.flags & OrientationFlag.SATURATED):
            self._saturated_s = newest_s

    def feed_pose(self, time_s: float, quat_wxyz: npt.NDArray[np.float64]) -> None:
        """Note one of the poses that :class:`host.trial.turning.Turning` keeps: it may be of the rest."""
        if self._resting:
            self._poses.append((time_s, quat_wxyz))

    def end_rest(self) -> None:
        """Measure the rests among the poses, if any lasted 3 s: the motion has begun."""
        if self._resting and len(self._poses) > 1:
            times_s, quats = zip(*self._poses, strict=True)
            series = OrientationSeries(np.array(times_s), np.array(quats), np.arange(len(times_s)))
            self._baseline = baseline_from_holds(still_holds(series))
            self._floor_known = self._baseline is not None and self._baseline.duration_s >= MIN_REST_FOR_FLOOR_S
        self._resting = False
        self._poses.clear()

    def view(
        self, info: Info | None, status: Status | None, newest_s: float, period_s: float | None, n_endpoints: int
    ) -> SensorView:
        """Return what is known of the object and its sensor now; the floor depends on the motion so far."""
        block, baseline = self._last, self._baseline
        flags = None if block is None else OrientationFlag(int(block.flags[-1]))
        floor_deg = None
        if baseline is not None and self._floor_known and period_s is not None:
            floor_deg = baseline.detectable_deg(period_s, max(2, n_endpoints))
        return SensorView(
            name="" if info is None else plain(info.name, 32),
            device_id="" if info is None else f"{info.device_id:016x}",
            still=None if flags is None else OrientationFlag.STILL in flags,
            saturated=newest_s - self._saturated_s < SATURATION_S,
            calibrated=None if flags is None else OrientationFlag.CALIBRATED in flags,
            temperature_c=status.temperature_c if status is not None and math.isfinite(status.temperature_c) else None,
            battery_v=status.battery_mv / 1000 if status is not None and status.battery_mv else None,
            heading_deg_per_min=None if baseline is None else baseline.total_rate_deg_per_min,
            floor_deg=floor_deg,
            orientation_wxyz=None if block is None else plain_quaternion(block.quats_wxyz[-1]),
        )
