"""Device time and flags of every sample, from TIME and SAMPLE_STATE frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.mapping import COUNTER_MODULUS, sample_times_us
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US, MAX_RATE_HZ, MIN_RATE_HZ

IntArray = npt.NDArray[np.int64]
CodeArray = npt.NDArray[np.uint64]


def unwrapped(counters: npt.NDArray[np.uint32], reference: int) -> IntArray:
    """Return u32 counters as the integers nearest to a reference."""
    steps = (counters - np.uint32(reference % COUNTER_MODULUS)).view(np.int32)
    return np.asarray(reference + steps.astype(np.int64))


class Newest(NamedTuple):
    """The newest TIME and SAMPLE_STATE."""

    mark_counter: int
    """Of TIME, unwrapped."""
    mark_time_us: int
    """Device time of that sample, µs."""
    state_counter: int
    """Of SAMPLE_STATE, unwrapped."""
    flags: int
    rate_hz: int


class Timeline:
    """The TIME and SAMPLE_STATE frames of one boot that still matter."""

    def __init__(self) -> None:
        self._newest: Newest | None = None
        self._mark_counters = np.empty(0, np.int64)
        self._mark_times_us = np.empty(0, np.int64)
        self._state_counters = np.empty(0, np.int64)
        self._state_flags = np.empty(0, np.uint8)
        self._state_rates_hz = np.empty(0, np.int64)

    @property
    def is_known(self) -> bool:
        """Whether times and flags of samples are known: one frame of each kind has come."""
        return len(self._mark_counters) > 0 and len(self._state_counters) > 0

    @property
    def period_ns(self) -> float:
        """Sample period by the newest SAMPLE_STATE; infinite before the first."""
        return 1e9 / float(self._state_rates_hz[-1]) if len(self._state_rates_hz) else float("inf")

    @property
    def newest(self) -> Newest | None:
        """The newest frame of each kind; None before both."""
        if self._newest is None and self.is_known:
            self._newest = Newest(
                int(self._mark_counters[-1]),
                int(self._mark_times_us[-1]),
                int(self._state_counters[-1]),
                int(self._state_flags[-1]),
                int(self._state_rates_hz[-1]),
            )
        return self._newest

    def is_before(self, counter: int) -> bool:
        """Return whether all frames came in order, and none is of a sample behind this one."""
        both = self._mark_counters, self._state_counters
        return all((np.diff(edges) >= 0).all() and (edges <= counter).all() for edges in both)

    def add_marks(self, codes: CodeArray, reference: int) -> IntArray:
        """Enter TIME frames (k,) as u64; return their counters (k,), unwrapped near the reference."""
        self._newest = None
        counters = unwrapped(codes.astype(np.uint32), reference)
        self._mark_counters = np.concatenate([self._mark_counters, counters])
        self._mark_times_us = np.concatenate([self._mark_times_us, (codes >> np.uint64(32)).astype(np.int64)])
        return counters

    def add_states(self, codes: CodeArray, reference: int) -> int:
        """Enter SAMPLE_STATE frames (k,) as u64; return how many were impossible and left out."""
        self._newest = None
        rates_hz = (codes >> np.uint64(40) & np.uint64(0xFFFF)).astype(np.int64)
        good = (rates_hz >= MIN_RATE_HZ) & (rates_hz <= MAX_RATE_HZ)
        codes, rates_hz = codes[good], rates_hz[good]
        self._state_counters = np.concatenate([self._state_counters, unwrapped(codes.astype(np.uint32), reference)])
        self._state_flags = np.concatenate([self._state_flags, (codes >> np.uint64(32)).astype(np.uint8)])
        self._state_rates_hz = np.concatenate([self._state_rates_hz, rates_hz])
        return int(len(good) - good.sum())

    def device_times_us(self, counters: IntArray) -> npt.NDArray[np.uint32]:
        """Return the device time (n,) of samples, u32, wrapped; only where :attr:`is_known`."""
        mark = _last_before(self._mark_counters, counters)
        state = _last_before(self._state_counters, counters)
        times = sample_times_us(
            counters, self._mark_counters[mark], self._mark_times_us[mark], self._state_rates_hz[state]
        )
        return (times % DEVICE_CLOCK_MODULUS_US).astype(np.uint32)

    def flags(self, counters: IntArray) -> npt.NDArray[np.uint8]:
        """Return the flags (n,) of samples."""
        return np.asarray(self._state_flags[_last_before(self._state_counters, counters)])

    def forget_before(self, counter: int) -> None:
        """Drop what no sample from ``counter`` on needs."""
        mark = int(_last_before(self._mark_counters, np.array([counter]))[0]) if len(self._mark_counters) else 0
        state = int(_last_before(self._state_counters, np.array([counter]))[0]) if len(self._state_counters) else 0
        self._mark_counters, self._mark_times_us = self._mark_counters[mark:], self._mark_times_us[mark:]
        self._state_counters = self._state_counters[state:]
        self._state_flags = self._state_flags[state:]
        self._state_rates_hz = self._state_rates_hz[state:]


def _last_before(edges: IntArray, counters: IntArray) -> npt.NDArray[np.intp]:
    """Return the index of the last edge at or before each counter; the first edge for those before all."""
    return np.maximum(np.searchsorted(edges, counters, side="right") - 1, 0)
