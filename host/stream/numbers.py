"""The device's 16-bit sample numbers without their wrap, with the device clock's help."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_protocol.packets import SEQUENCE_MODULUS

IntArray = npt.NDArray[np.int64]

HALF = SEQUENCE_MODULUS // 2
MAX_PERIOD_SAMPLES = 32
"""Longest run over which the sample period is measured."""
FEW = 100
"""Up to so many samples a loop is faster than arrays. Measured."""


class SequenceUnwrapper:
    """Counts samples over gaps of any length, as long as the device clock runs.

    Between two samples the number's change is known modulo 65536. A gap of more than 32767 samples (33 s at 1 kHz) is
    ambiguous by itself, so the number of wraps is taken from the time between the samples, divided by the sample period
    that was measured on undisturbed neighbours. It is right while the product of gap and period error stays below 32768
    samples: a day at 1 kHz for 300 ppm.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._last_us = 0
        self.period_us: float | None = None
        """Sample period as measured, us of the device clock; None before two neighbours came."""

    def restart(self, start: int | None = None) -> None:
        """Forget the last sample: the device was reset. If a STATUS reported the next number, it is ``start``."""
        self._last = None if start is None else start - 1
        self._last_us = -1

    def rebase_time(self, device_time_us: int) -> None:
        """Set what the device clock would have read at the last sample, after the clock was stepped."""
        self._last_us = device_time_us

    def feed(self, sequence: npt.NDArray[np.uint16], device_time_us: IntArray) -> IntArray:
        """Unwrap the numbers of n >= 1 samples in wire order.

        Parameters
        ----------
        sequence : (n,) uint16
            As received, with repeated and late ones.
        device_time_us : (n,) int64
            Unwrapped device time.

        Returns
        -------
        (n,) int64
            Unwrapped numbers. The first ever is kept as it is, or read nearest to ``start``.
        """
        run = self._undisturbed_run(sequence, device_time_us)
        if run is not None:
            return run
        numbers = sequence.astype(np.int64)
        if self._last is None:
            self._last, self._last_us = int(numbers[0]) - 1, -1
        change = np.diff(numbers, prepend=self._last)
        change = (change + HALF) % SEQUENCE_MODULUS - HALF
        if self.period_us is not None and self._last_us >= 0:
            elapsed_us = np.diff(device_time_us, prepend=self._last_us)
            # Only a pause that could hold half a wrap is in doubt; the arithmetic is skipped for all others.
            if elapsed_us.max() > HALF // 2 * self.period_us:
                wraps = np.rint((elapsed_us / self.period_us - change) / SEQUENCE_MODULUS).astype(np.int64)
                change += np.where(elapsed_us > HALF // 2 * self.period_us, wraps, 0) * SEQUENCE_MODULUS
        unwrapped: IntArray = self._last + np.cumsum(change)
        self._measure(unwrapped, device_time_us)
        newest = int(np.argmax(unwrapped))
        if unwrapped[newest] >= self._last or self._last_us < 0:
            self._last, self._last_us = int(unwrapped[newest]), int(device_time_us[newest])
        return unwrapped

    def _undisturbed_run(self, sequence: npt.NDArray[np.uint16], device_time_us: IntArray) -> IntArray | None:
        """Count on where every sample follows the one before, as nearly always, without the cost of arrays."""
        if self._last is None or self.period_us is None or self._last_us < 0:
            return None
        n = len(sequence)
        elapsed_us = int(device_time_us[-1]) - self._last_us
        if not 0 < elapsed_us < HALF // 2 * self.period_us:
            return None
        wanted = self._last + 1
        if n > FEW:
            run = np.arange(wanted, wanted + n, dtype=np.int64)
            if not np.array_equal(run.astype(np.uint16), sequence):  # the cast wraps as the numbers do
                return None
            wanted += n
        else:
            for number in sequence.tolist():
                if number != wanted % SEQUENCE_MODULUS:
                    return None
                wanted += 1
            run = np.arange(self._last + 1, wanted, dtype=np.int64)
        self._last, self._last_us = wanted - 1, int(device_time_us[-1])
        self.period_us += (elapsed_us / n - self.period_us) / MAX_PERIOD_SAMPLES
        return run

    def _measure(self, unwrapped: IntArray, device_time_us: IntArray) -> None:
        """Learn the sample period: the median of what lies between undisturbed neighbours."""
        numbers, times_us = unwrapped[-MAX_PERIOD_SAMPLES:], device_time_us[-MAX_PERIOD_SAMPLES:]
        if self._last is not None and self._last_us >= 0 and len(numbers) == len(unwrapped):
            numbers, times_us = np.append(self._last, numbers), np.append(self._last_us, times_us)
        between_us = np.diff(times_us)[np.diff(numbers) == 1]
        if len(between_us) and np.median(between_us) > 0:
            self.period_us = float(np.median(between_us))
