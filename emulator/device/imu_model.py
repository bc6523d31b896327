"""What the IMU makes of the true motion: noise, bias, heading drift, limits; quantisation is the wire's.

Measured orientation::

    q_meas(t) = exp(h(t) · z_world) ⊗ q_true(t) ⊗ exp(n(t))

``h`` is the heading drift of a part without magnetometer. ``n`` is a rotation vector in body axes: white noise per
sample plus a correlated part, a sum of sinusoids whose frequencies are drawn from the Lorentzian spectrum of a
first-order (Ornstein-Uhlenbeck) process, so that its autocorrelation is σ² exp(−|t|/τ) in expectation while it stays a
pure function of time. White noise is drawn in fixed blocks by sample number, so it does not depend on how the run is
stepped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from emulator.motion.rotation import FloatArray, conjugate, from_rotation_vector, multiply, rotate
from emulator.settings import Settings, number, text, vector
from firmware_protocol.packets import OrientationFlag

GYRO_FULL_SCALE_DPS = 2000.0
ACCELERATION_FULL_SCALE_G = 16.0

_CORRELATED_STREAM, _WHITE_STREAM = 31, 32
_SINUSOIDS = 48
_NOISE_BLOCK = 1024
_STILL_POINTS = 4
_WORLD_UP = np.array([0.0, 0.0, 1.0])

TrueMotion = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Times (n,) s -> true orientation (n, 4) and true world-frame rate of turn (n, 3) rad/s."""


@dataclass(frozen=True)
class ImuSettings(Settings):
    """Scenario table ``[imu]``: the sensor's faults. All zero is a perfect sensor."""

    sensor: str = text("virtual 6-axis", 24)
    """Part, as INFO names it."""
    filter: str = text("6-axis complementary", 24)
    """Orientation filter, as INFO names it."""
    noise_deg: float = number(0.02, 0.0, 10.0)
    """White orientation noise, standard deviation about each body axis, degrees."""
    correlated_noise_deg: float = number(0.03, 0.0, 10.0)
    """Correlated orientation noise, standard deviation about each body axis, degrees."""
    correlation_s: float = number(0.5, 0.01, 100.0)
    """Its correlation time, s."""
    heading_drift_deg_per_min: float = number(0.5, -120.0, 120.0)
    """Turn about the world vertical that the sensor makes up, degrees a minute."""
    gyro_bias_dps: tuple[float, float, float] = vector((0.12, -0.07, 0.05), -100.0, 100.0)
    """True gyro bias, deg/s, sensor axes; shows in RAW_IMU, and in STATUS once calibrated."""
    gyro_noise_dps: float = number(0.05, 0.0, 100.0)
    """White noise of each gyro axis, deg/s."""
    acceleration_noise_g: float = number(0.002, 0.0, 10.0)
    """White noise of each accelerometer axis, g."""
    still_below_dps: float = number(0.5, 0.0, 100.0)
    """The still flag is set while the true rate of turn stays below this, deg/s, ..."""
    still_after_s: float = number(0.3, 0.0, 10.0)
    """... for so long, s."""
    accurate_below_dps: float = number(500.0, 1.0, 2000.0)
    """The overrange flag is set above this rate of turn, deg/s."""
    temperature_c: float = number(38.0, -40.0, 125.0, may_be_nan=True)
    """Sensor temperature in STATUS, degree Celsius."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What the sensor measures for a run of n samples."""

    quats_wxyz: FloatArray
    """(n, 4) measured orientation, unit, body to world."""
    flags: npt.NDArray[np.uint8]
    """(n,) bits of OrientationFlag, without CALIBRATED."""
    gyro_dps: FloatArray
    """(n, 3) deg/s, sensor axes, cut at full scale."""
    acceleration_g: FloatArray
    """(n, 3) specific force, g, sensor axes, cut at full scale; the object turns about its sensor: gravity only."""


class ImuModel:
    """The sensor of one object, its noise seeded."""

    def __init__(
        self, settings: ImuSettings, mounting_q_body_sensor: tuple[float, float, float, float], seed: int
    ) -> None:
        self.settings = settings
        self._seed = seed
        self._sensor_from_body = conjugate(np.array(mounting_q_body_sensor))
        rng = np.random.default_rng([seed, _CORRELATED_STREAM])
        # Angular frequencies of a Lorentzian spectrum are Cauchy distributed with scale 1/τ; the far tail is cut off.
        quantiles = (np.arange(_SINUSOIDS) + rng.uniform(size=(3, _SINUSOIDS))) / _SINUSOIDS
        rates = np.tan(0.5 * np.pi * np.minimum(quantiles, 0.99))
        self._angular = rates / settings.correlation_s
        self._phases = rng.uniform(0.0, 2.0 * np.pi, (3, _SINUSOIDS))

    def correlated_noise_rad(self, times_s: FloatArray) -> FloatArray:
        """Return the correlated noise at times (n,) s as rotation vectors (n, 3), rad."""
        sigma = np.radians(self.settings.correlated_noise_deg)
        if sigma == 0.0:
            return np.zeros((len(times_s), 3))
        waves = np.sin(times_s[:, None, None] * self._angular + self._phases).sum(axis=2)
        noise: FloatArray = sigma * np.sqrt(2.0 / _SINUSOIDS) * waves
        return noise

    def heading_rad(self, times_s: FloatArray) -> FloatArray:
        """Return the heading drift (n,) at times since power-up, rad."""
        heading: FloatArray = np.radians(self.settings.heading_drift_deg_per_min / 60.0) * times_s
        return heading

    def _white(self, first: int, n: int, boot: int) -> FloatArray:
        """(n, 9) unit white noise of samples ``first`` onwards: orientation, gyro, accelerometer."""
        blocks = range(first // _NOISE_BLOCK, (first + n - 1) // _NOISE_BLOCK + 1)
        drawn = [
            np.random.default_rng([self._seed, _WHITE_STREAM, boot, block]).standard_normal((_NOISE_BLOCK, 9))
            for block in blocks
        ]
        start = first - blocks.start * _NOISE_BLOCK
        return np.concatenate(drawn)[start : start + n]

    def read(self, times_s: FloatArray, true_motion: TrueMotion, first: int, boot: int) -> Readings:
        """Return what the sensor measures at true times (n,) since power-up, s, n >= 1.

        Parameters
        ----------
        times_s, true_motion : (n,), callable
            When, and the object's motion then.
        first, boot : int
            Number of the first sample since boot, and of the boot, both from 0.
        """
        settings = self.settings
        true_quats, rates_rad_s = true_motion(times_s)
        white = self._white(first, len(times_s), boot)
        noise = np.radians(settings.noise_deg) * white[:, :3] + self.correlated_noise_rad(times_s)
        heading = from_rotation_vector(self.heading_rad(times_s)[:, None] * _WORLD_UP)
        quats = multiply(multiply(heading, true_quats), from_rotation_vector(noise))
        quats /= np.linalg.norm(quats, axis=1, keepdims=True)

        sensor_from_world = multiply(self._sensor_from_body, conjugate(true_quats))
        gyro = np.degrees(rotate(sensor_from_world, rates_rad_s)) + np.array(settings.gyro_bias_dps)
        gyro += settings.gyro_noise_dps * white[:, 3:6]
        acceleration = rotate(sensor_from_world, _WORLD_UP) + settings.acceleration_noise_g * white[:, 6:9]

        speed_dps = np.degrees(np.linalg.norm(rates_rad_s, axis=1))
        saturated = (np.abs(gyro) >= GYRO_FULL_SCALE_DPS).any(axis=1)
        saturated |= (np.abs(acceleration) >= ACCELERATION_FULL_SCALE_G).any(axis=1)
        flags = np.where(self._still(times_s, speed_dps, true_motion), OrientationFlag.STILL, 0)
        flags |= np.where(speed_dps > settings.accurate_below_dps, OrientationFlag.OVERRANGE, 0)
        flags |= np.where(saturated, OrientationFlag.SATURATED, 0)
        return Readings(
            quats_wxyz=quats,
            flags=flags.astype(np.uint8),
            gyro_dps=gyro.clip(-GYRO_FULL_SCALE_DPS, GYRO_FULL_SCALE_DPS),
            acceleration_g=acceleration.clip(-ACCELERATION_FULL_SCALE_G, ACCELERATION_FULL_SCALE_G),
        )

    def _still(self, times_s: FloatArray, speed_dps: FloatArray, true_motion: TrueMotion) -> npt.NDArray[np.bool_]:
        """Return whether the rate of turn was below the threshold now and at points over the time before."""
        still = speed_dps < self.settings.still_below_dps
        for k in range(1, _STILL_POINTS):
            if not still.any():
                break
            back_s = self.settings.still_after_s * k / (_STILL_POINTS - 1)
            _, rates_rad_s = true_motion(times_s - back_s)
            still &= np.degrees(np.linalg.norm(rates_rad_s, axis=1)) < self.settings.still_below_dps
        return still

    def is_still(self, time_s: float, true_motion: TrueMotion) -> bool:
        """Return whether the object is at rest at a time, by the same rule as the flag; CALIBRATE asks."""
        times_s = np.array([time_s])
        _, rates_rad_s = true_motion(times_s)
        return bool(self._still(times_s, np.degrees(np.linalg.norm(rates_rad_s, axis=1)), true_motion)[0])
