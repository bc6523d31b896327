"""The object's clock: microseconds since boot by a crystal that is a little off and wanders with temperature.

::

    uptime(t) = start + t · (1 + skew) + w(t) − w(0),   w(t) = Σ_j (A_j / (2π f_j)) · sin(2π f_j t + φ_j)

with three slow terms whose rate errors together stay within the wander. ``device_time_us`` is the uptime modulo 2³².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emulator.motion.rotation import FloatArray
from emulator.settings import Settings, integer, number

_WANDER_STREAM = 21
_TERMS = 3
_ROUNDING_US = 1e-4  # the instant of a tick must not read as one less
_INVERSE_STEPS = 4  # each shrinks the error by the rate error, below 2e-3: 4 reach rounding from any start


@dataclass(frozen=True)
class ClockSettings(Settings):
    """Scenario table ``[clock]``: how the object's clock differs from true time."""

    skew_ppm: float = number(18.0, -1000.0, 1000.0)
    """Constant rate error, parts per million; positive runs fast."""
    wander_ppm: float = number(2.0, 0.0, 500.0)
    """Bound of the changing part of the rate error, parts per million."""
    wander_period_s: float = number(600.0, 10.0, 100_000.0)
    """Typical period of the wander, s."""
    start_us: int = integer(0, 0, 2**52)
    """Uptime at power-up, us: above 4 294 967 296 less a trial's length the clock wraps inside the trial."""


class DeviceClock:
    """True time to device uptime and back; times are seconds since power-up. The wander's phases are seeded."""

    def __init__(self, settings: ClockSettings, seed: int) -> None:
        rng = np.random.default_rng([seed, _WANDER_STREAM])
        self._rate = 1.0 + settings.skew_ppm * 1e-6
        self._angular = 2.0 * np.pi / (settings.wander_period_s * np.array([1.0, 0.6180339887, 0.3819660113]))
        self._phases = rng.uniform(0.0, 2.0 * np.pi, _TERMS)
        shares = rng.dirichlet(np.ones(_TERMS))
        self._amplitudes_us = settings.wander_ppm * shares / self._angular  # ppm · s = us
        self._offset_us = 0.0
        self._offset_us = settings.start_us - self._elapsed_us(np.zeros(1))[0]

    def _elapsed_us(self, times_s: FloatArray) -> FloatArray:
        wander = (np.sin(times_s[:, None] * self._angular + self._phases) * self._amplitudes_us).sum(axis=1)
        elapsed: FloatArray = times_s * (1e6 * self._rate) + wander
        return elapsed

    def uptime_us(self, times_s: FloatArray) -> FloatArray:
        """Return the uptime (n,) at true times (n,), us, without wrap and not rounded."""
        return self._elapsed_us(np.asarray(times_s, dtype=np.float64)) + self._offset_us

    def read_us(self, time_s: float) -> int:
        """Return one reading of the uptime, whole microseconds, rounded down as a counter is."""
        return int(np.floor(self.uptime_us(np.array([time_s]))[0] + _ROUNDING_US))

    def time_s(self, uptime_us: FloatArray) -> FloatArray:
        """Return the true time (n,), s, at which the clock shows an uptime (n,), us, not wrapped; exact to rounding."""
        target = np.asarray(uptime_us, dtype=np.float64) - self._offset_us
        times_s = target / (1e6 * self._rate)
        for _ in range(_INVERSE_STEPS):
            times_s = times_s + (target - self._elapsed_us(times_s)) / (1e6 * self._rate)
        return times_s

    def restart(self, time_s: float) -> None:
        """Start again at 0 us: the object was reset."""
        self.step(time_s, -self.uptime_us(np.array([time_s]))[0])

    def step(self, time_s: float, by_us: float) -> None:
        """Let the reading jump at a true time, not below 0 us."""
        present = self.uptime_us(np.array([time_s]))[0]
        self._offset_us += max(by_us, -present)
