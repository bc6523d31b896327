"""What the object remembers of its commands, and what its next STATUS has to report."""

from __future__ import annotations

import numpy as np

from firmware_protocol import packets as p

_RETRY_WINDOW_S = 5.0
_LOW_BATTERY_MV = 3300


class Conversation:
    """Counts commands, and knows the last one that must not be done twice."""

    def __init__(self) -> None:
        self.commands = 0
        """Packets from the host that were answered."""
        self.refusals = 0
        """Of these, those not done."""
        self._last_done: tuple[p.Calibrate | p.Mark, p.AckCode, float] | None = None

    def answer_to_retry(self, command: p.Calibrate | p.Mark, now_s: float) -> p.AckCode | None:
        """Return the answer already given where a command is a retry; None where it is new."""
        if self._last_done is not None:
            done, code, done_s = self._last_done
            if done == command and now_s - done_s < _RETRY_WINDOW_S:
                return code
        return None

    def remember(self, command: p.Calibrate | p.Mark, code: p.AckCode, now_s: float) -> None:
        """Keep a command and its answer, for its retry."""
        self._last_done = (command, code, now_s)

    def forget(self) -> None:
        """Forget the last command: the object was reset. The counts go on."""
        self._last_done = None


class StatusTimer:
    """When the next STATUS is due, and the errors it reports."""

    def __init__(self, interval_s: float) -> None:
        self._interval_s = interval_s
        self._dropped = 0  # samples, as last reported
        self.next_s = np.inf
        """When the next one is due, s; infinite while the object has no power."""
        self.errors = p.DeviceError(0)
        """Errors since the last one."""

    @property
    def is_on(self) -> bool:
        """Whether the object has power."""
        return self.next_s < np.inf

    def power_up(self, now_s: float) -> None:
        """Start with no error."""
        self.errors = p.DeviceError(0)
        self.wait(now_s)

    def power_off(self) -> None:
        """Report no more until :meth:`power_up`."""
        self._dropped = 0
        self.next_s = np.inf

    def wait(self, now_s: float) -> None:
        """Let the next one be due an interval from now."""
        self.next_s = now_s + self._interval_s

    def errors_with(self, dropped: int, battery_mv: int) -> p.DeviceError:
        """Return the errors to report, with those that follow from samples dropped since boot and from the battery."""
        errors = self.errors
        if dropped != self._dropped:
            errors |= p.DeviceError.TRANSMIT_OVERFLOW
        if 0 < battery_mv < _LOW_BATTERY_MV:
            errors |= p.DeviceError.LOW_BATTERY
        return errors

    def reported(self, dropped: int) -> None:
        """Forget what a STATUS that is on its way has reported."""
        self._dropped, self.errors = dropped, p.DeviceError(0)
