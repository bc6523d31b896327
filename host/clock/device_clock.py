"""The device's clock on the host's time line: unwrapping and estimate together, one per object.

``feed`` each chunk's device times and the chunk's arrival; get back unwrapped device time and host time. The parts are
:mod:`host.clock.unwrap`, :mod:`host.clock.estimator` and, for recordings, :mod:`host.clock.remap`; how it works and how
well: ``docs/time.md``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from host.clock.estimate import ClockEstimate, EstimatorSettings
from host.clock.estimator import ClockEstimator
from host.clock.unwrap import ClockStep, ClockUnwrapper, UnwrapSettings

__all__ = [
    "ClockEstimate",
    "ClockEstimator",
    "ClockStep",
    "ClockUnwrapper",
    "DeviceClock",
    "EstimatorSettings",
    "MappedTimes",
    "UnwrapSettings",
]

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class MappedTimes:
    """The n samples of one chunk on both time lines."""

    device_time_unwrapped_us: IntArray
    """(n,) device time, us; compares within one segment of the unwrapper only."""
    host_time_ns: IntArray
    """(n,) host time at which the sample was taken, plus the link's constant delay, ns, as known at arrival. From chunk
    to chunk it may go back by the estimate's correction: order samples by device time."""
    segment: IntArray
    """(n,) clock segment of each sample, from 0."""
    steps: tuple[ClockStep, ...]
    """Steps of the device clock met in this chunk."""

    def __len__(self) -> int:
        return len(self.host_time_ns)


class DeviceClock:
    """Unwraps and maps the device clock of one object, chunk by chunk.

    Parameters
    ----------
    unwrap
        Bounds of the unwrapping.
    estimator
        Windows and bounds of the estimate.
    """

    def __init__(self, unwrap: UnwrapSettings | None = None, estimator: EstimatorSettings | None = None) -> None:
        self._unwrapper = ClockUnwrapper(unwrap)
        self._estimator = ClockEstimator(estimator)
        self._boot_id: int | None = None
        self._last_ns = 0  # arrival of the previous chunk

    @property
    def segment(self) -> int:
        """Number of the present clock segment, from 0."""
        return self._estimator.segment

    def new_segment(self) -> int:
        """Start a new segment: the port was reopened, so the device may have been reset unseen.

        Returns
        -------
        int
            Its number; unchanged if the present one has no sample yet.
        """
        if self._unwrapper.newest_us is None:
            return self.segment
        self._unwrapper.new_segment()
        return self._estimator.new_segment()

    def boot(self, boot_id: int) -> bool:
        """Take note of INFO's boot id; return whether it differs from the last one, which starts a new segment."""
        rebooted = self._boot_id is not None and boot_id != self._boot_id
        self._boot_id = boot_id
        if rebooted:
            self.new_segment()
        return rebooted

    def feed(self, device_time_us: npt.ArrayLike, host_time_ns: int) -> MappedTimes:
        """Unwrap and map one chunk's samples.

        Parameters
        ----------
        device_time_us : (n,) uint32
            Device clock in order of reception; n may be 0.
        host_time_ns
            Arrival of the chunk, ``time.monotonic_ns()``.

        Raises
        ------
        ValueError
            ``device_time_us`` is not one-dimensional.
        """
        unwrapped_us = self._unwrapper.feed(device_time_us, host_time_ns)
        n = len(unwrapped_us)
        host_ns = np.empty(n, dtype=np.int64)
        segment = np.empty(n, dtype=np.int64)
        steps: list[ClockStep] = []
        start = 0
        for step in [*self._unwrapper.take_steps(), None]:
            stop = n if step is None else step.index
            if stop > start:
                piece = unwrapped_us[start:stop]
                newest_us, oldest_us = int(piece.max()), int(piece.min())
                moved_ns = self._estimator.feed(newest_us, host_time_ns, newest_us - oldest_us)
                if moved_ns is not None:
                    steps.append(self._small_step(start, host_time_ns, moved_ns))
                line = self._estimator.line
                assert line is not None  # it has just been fed
                host_ns[start:stop] = line.to_host_ns(piece)
                segment[start:stop] = self.segment
            if step is not None:
                steps.append(replace(step, segment=self._estimator.new_segment()))
            start = stop
        if n:
            self._last_ns = host_time_ns
        return MappedTimes(unwrapped_us, host_ns, segment, tuple(steps))

    def feed_round_trip(
        self, host_send_ns: int, receive_uptime_us: int, transmit_uptime_us: int, host_receive_ns: int
    ) -> ClockStep | None:
        """Bound the offset by a TIME_REQUEST and its TIME_REPLY.

        Parameters
        ----------
        host_send_ns, host_receive_ns
            Host time just before the request was written and when the reply's chunk arrived, ns, monotonic.
        receive_uptime_us, transmit_uptime_us
            The reply's two readings of the device clock, us, wrapped or not.

        Returns
        -------
        ClockStep or None
            The step if the round trip proves one: a new segment has begun, to which the next samples belong.
            A reply that does not belong to the present segment is ignored.
        """
        receive_us = self._unwrapper.locate(receive_uptime_us, host_receive_ns)
        transmit_us = self._unwrapper.locate(transmit_uptime_us, host_receive_ns)
        if receive_us is None or transmit_us is None:
            return None
        moved_ns = self._estimator.feed_round_trip(host_send_ns, receive_us, transmit_us, host_receive_ns)
        return None if moved_ns is None else self._small_step(0, host_receive_ns, moved_ns)

    def estimate(self) -> ClockEstimate | None:
        """Return what is known now; None before the segment's first sample."""
        return self._estimator.estimate()

    def _small_step(self, index: int, host_time_ns: int, moved_ns: float) -> ClockStep:
        """Describe a step too small for the unwrapper, whose count goes on."""
        return ClockStep(index, self.segment, host_time_ns, -round(moved_ns / 1000), host_time_ns - self._last_ns)
