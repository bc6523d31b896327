"""The time axis of a capture: one line over all segments of the device clock.

Within a segment it is the device's own clock. Where a new one starts, the device clock cannot say how much time went
by, so the host's does, but never backwards.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from host.stream.blocks import SegmentStart

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

LEAST_STEP_S = 1e-3
"""A new segment starts at least so much behind the newest sample before it."""


class TimeAxis:
    """Places unwrapped device times, s since the first sample."""

    def __init__(self) -> None:
        self.segments: list[SegmentStart] = []
        self.newest_host_ns = 0
        """Reception of the last sample placed."""
        self._reason: str | None = "the capture began"  # why a segment starts with the next sample
        self._origin_us = 0  # device time of the segment's first sample
        self._newest_s = 0.0

    @property
    def is_open(self) -> bool:
        """Whether a sample of the present segment has come."""
        return self._reason is None

    def close(self, reason: str) -> None:
        """End the segment; the next sample opens another. One that no sample has opened keeps its first reason."""
        if self._reason is None:
            self._reason = reason

    def open(self, device_time_us: int, host_time_ns: int) -> None:
        """Start a segment with its first sample."""
        assert self._reason is not None
        offset_s = 0.0
        if self.segments:
            since_s = (host_time_ns - self.segments[0].host_time_ns) / 1e9
            offset_s = max(since_s, self._newest_s + LEAST_STEP_S)
        self._origin_us = device_time_us
        self.segments.append(SegmentStart(len(self.segments), offset_s, host_time_ns, self._reason))
        self._reason = None

    def place(self, device_time_us: IntArray, host_time_ns: int) -> FloatArray:
        """Return the times (n,) of n >= 1 samples of the open segment, unwrapped device time (n,), us."""
        time_s: FloatArray = self.segments[-1].time_s + (device_time_us - self._origin_us) / 1e6
        self._newest_s = max(self._newest_s, float(time_s.max()))
        self.newest_host_ns = host_time_ns
        return time_s

    def at_s(self, device_time_us: int) -> float:
        """Return the time of a moment in the open segment."""
        return self.segments[-1].time_s + (device_time_us - self._origin_us) / 1e6
