"""The device's 16-bit sample numbers without their wrap, with the device clock's help."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from firmware_protocol.packets import MAX_RATE_HZ, SEQUENCE_MODULUS
from host.clock.unwrap import changes

IntArray = npt.NDArray[np.int64]

HALF = SEQUENCE_MODULUS // 2
INTERVALS_KEPT = 32
"""The sample period is the median of so many intervals."""
SPARE_SAMPLES = 8
"""Samples that may be missing beyond what the time since the newest one explains."""
FLOOD = 20.0
"""An object may for a while send so many times faster than before; the protocol's fastest rate it may always send."""
LATE_SAMPLES = 64
"""How far behind the newest sample one may be that is not older by the device clock ..."""
LATEST_SAMPLES = 5000
"""... and any other: half a second at ten times the protocol's fastest rate."""
AGREEING = 3
"""So many refused samples in a row that follow each other are believed: then the numbers did start again."""
REFUSED = -(2**62)
"""Number of a sample that is refused."""
LONGEST_US = 2**62
FEW = 24
"""Up to so many samples a loop is faster than arrays. Measured."""


class SequenceUnwrapper:
    """Counts samples over gaps of any length, as long as the device clock runs.

    Between the newest sample so far and the next one the number's change is known modulo 65536. A gap of more than
    32767 samples (33 s at 1 kHz) is ambiguous by itself, so the number of wraps is taken from the time between the two,
    divided by the sample period that was measured on undisturbed neighbours. It is right while the product of gap and
    period error stays below 32768 samples: a day at 1 kHz for 300 ppm.

    A number that the time since the newest sample cannot explain is refused: one damaged number must not make a loss of
    thousands. If the samples after it go on from there, the numbers did start again, and the caller is to know.

    A sample's number follows from the samples before it, never from how many are fed at once: a recording is read in
    other pieces than those in which it came.
    """

    def __init__(self) -> None:
        self._newest: int | None = None  # largest number so far; before the first sample, the one before its number
        self._newest_us = -1  # its device time; negative where no sample has come yet
        self._before: tuple[int, int] | None = None  # number and device time of the last sample in wire order
        self._intervals_us: deque[int] = deque(maxlen=INTERVALS_KEPT)  # between neighbours that nothing came between
        self._odd: tuple[int, int] | None = None  # the last one as on the wire, if it was refused
        self._n_odd = 0  # refused ones in a row that follow each other
        self.n_refused = 0
        """Of those fed last."""
        self._shortest_us = LONGEST_US  # not above any of these; their median is worked out for long pauses alone

    @property
    def period_us(self) -> float | None:
        """Sample period as measured, us of the device clock; None before two neighbours came."""
        found = sorted(self._intervals_us)
        return float(found[len(found) // 2]) if found else None

    def restart(self, start: int | None = None) -> None:
        """Forget the last sample: the device was reset. If a STATUS reported the next number, it is ``start``."""
        self._newest = None if start is None else start - 1
        self._newest_us, self._before, self._odd = -1, None, None

    def rebase_time(self, device_time_us: int) -> None:
        """Set what the device clock would have read at the newest sample, after the clock was stepped."""
        self._newest_us, self._before = device_time_us, None

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
        (k,) int64
            Unwrapped numbers of the first k samples, :data:`REFUSED` for those that cannot be. The first ever is kept
            as it is, or read nearest to ``start``. Where k < n, numbers start again at sample k: call :meth:`restart`,
            and feed the rest.
        """
        self.n_refused = 0
        if len(sequence) == 1:  # most of what comes live
            number = self._next(int(sequence[0]), int(device_time_us[0]))
            self.n_refused += number == REFUSED
            return np.array([] if number is None else [number], dtype=np.int64)
        if len(sequence) > FEW and self._odd is None:
            together = self._together(sequence, device_time_us)
            if together is not None:
                return together
        numbers: list[int] = []
        for number, time_us in zip(sequence.tolist(), device_time_us.tolist(), strict=True):
            unwrapped = self._next(number, time_us)
            if unwrapped is None:
                break
            self.n_refused += unwrapped == REFUSED
            numbers.append(unwrapped)
        return np.array(numbers, dtype=np.int64)

    def _next(self, sequence: int, time_us: int) -> int | None:
        """Unwrap the number of the next sample; None where numbers start again with it."""
        newest = sequence - 1 if self._newest is None else self._newest
        change = (sequence - newest + HALF) % SEQUENCE_MODULUS - HALF
        elapsed_us = time_us - self._newest_us
        # Only a pause that could hold half a wrap is in doubt.
        if self._newest_us >= 0 and elapsed_us > HALF // 2 * self._shortest_us:
            period_us = self.period_us
            if period_us is not None and elapsed_us > HALF // 2 * period_us:
                change += round((elapsed_us / period_us - change) / SEQUENCE_MODULUS) * SEQUENCE_MODULUS
        if not 0 < change <= SPARE_SAMPLES and self._newest_us >= 0 and not self._fits(change, elapsed_us):
            return self._refuse(sequence, time_us)
        self._odd = None
        number = newest + change
        if self._before is not None and number - self._before[0] == 1 and time_us > self._before[1]:
            interval_us = time_us - self._before[1]
            self._intervals_us.append(interval_us)
            self._shortest_us = min(self._shortest_us, interval_us)
        self._before = number, time_us
        if number > newest or self._newest_us < 0:
            self._newest, self._newest_us = number, time_us
        return number

    def _fits(self, change: int, elapsed_us: int) -> bool:
        """Return whether a number can be so far from the newest one, so long after it."""
        if change > 0:
            plain = SPARE_SAMPLES + elapsed_us * MAX_RATE_HZ / 1e6
            return change <= plain or change <= SPARE_SAMPLES + elapsed_us * FLOOD / (self.period_us or LONGEST_US)
        return change >= -LATE_SAMPLES or (elapsed_us <= 0 and change >= -LATEST_SAMPLES)

    def _refuse(self, sequence: int, time_us: int) -> int | None:
        """Refuse a number; None where it and those refused before it follow each other, so that they are believed."""
        odd, self._odd = self._odd, (sequence, time_us)
        step = 0 if odd is None else (sequence - odd[0]) % SEQUENCE_MODULUS
        follows = odd is not None and time_us > odd[1] and step > 0 and self._fits(step, time_us - odd[1])
        self._n_odd = self._n_odd + 1 if follows else 1
        return None if self._n_odd >= AGREEING else REFUSED

    def _together(self, sequence: npt.NDArray[np.uint16], device_time_us: IntArray) -> IntArray | None:
        """Unwrap many at once, as :meth:`_next` would one by one.

        None, and nothing is taken into account, where a number may have to be refused, or a pause may hold half a wrap.
        """
        if self._newest is None or self._newest_us < 0 or self._before is None or not self._intervals_us:
            return None
        before, before_us = self._before
        steps = changes(sequence, before % SEQUENCE_MODULUS).view(np.int16)
        numbers: IntArray = np.cumsum(steps, dtype=np.int64)
        numbers += before
        intervals_us = changes(device_time_us, before_us)
        if before == self._newest and bool((steps > 0).all()):  # each is newer than all before it, as nearly always
            pauses_us, away, last = intervals_us, steps.astype(np.int64), len(numbers) - 1
        else:
            newest = np.maximum.accumulate(np.concatenate(([self._newest], numbers)))
            away = numbers - newest[:-1]
            if int(away.max()) >= HALF or int(away.min()) < -LATE_SAMPLES:
                return None
            # Which sample is the newest so far: the first of those with its number; -1 for the one before them all.
            places = np.maximum.accumulate(np.where(away > 0, np.arange(len(numbers)), -1))
            last = int(places[-1])
            times_us = np.concatenate(([self._newest_us], device_time_us))
            pauses_us = device_time_us - times_us[np.concatenate(([0], places[:-1] + 1))]
        far = away > SPARE_SAMPLES
        if far.any() and (away[far] > SPARE_SAMPLES + pauses_us[far] * MAX_RATE_HZ / 1e6).any():
            return None
        neighbours_us = intervals_us[(steps == 1) & (intervals_us > 0)]
        shortest_us = min(*self._intervals_us, int(neighbours_us.min()) if len(neighbours_us) else LONGEST_US)
        if int(pauses_us.max()) > HALF // 2 * shortest_us:
            return None
        self._intervals_us.extend(neighbours_us[-INTERVALS_KEPT:].tolist())
        self._shortest_us = min(self._intervals_us)
        self._before = int(numbers[-1]), int(device_time_us[-1])
        if last >= 0:
            self._newest, self._newest_us = int(numbers[last]), int(device_time_us[last])
        return numbers
