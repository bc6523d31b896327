"""Angular velocity on an even time grid: what the search for cycles works on.

Working on ω instead of on the pose has three gains: drift does not reach the period, no reference pose is needed, and
nothing is cut at ±180°. ω is in world axes, so a different mounting of the sensor in the object leaves it unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.cycles.usable_samples import Samples
from analysis.geometry import rotations
from analysis.series import FloatArray

_BLOCK = 32768  # grid points worked on at once: bounds the scratch memory whatever the length
_SPEED_SIGMA_S = 0.5
_MIN_SPEED = 2e-5  # rad/s: rounding errors are no motion
_NOISE_SIGMA_S = 0.12
_WIDE_SIGMA = 5.0
"""Smoothing over so many grid points and more takes less time in the frequency domain. Measured."""
_FFT_WIDTHS = 48
"""Length of a piece there, σ."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Angular velocity of a recording on an even grid, and where the object moves."""

    start_s: float
    """Time of the first grid point, s."""
    rate_hz: float
    """Grid points per second."""
    omega: FloatArray
    """(m, 3) angular velocity in world axes between grid points k and k+1, rad/s."""
    speed: FloatArray
    """(m,) |ω| smoothed over half a second, rad/s."""
    threshold: float
    """Speed that counts as moving, rad/s."""

    @property
    def times_s(self) -> FloatArray:
        """(m + 1,) times of the grid points, s."""
        return self.start_s + np.arange(len(self.omega) + 1) / self.rate_hz

    def part(self, first: int, last: int) -> Motion:
        """Cut out the motion between two grid points (``last`` excluded from ω)."""
        first, last = max(first, 0), min(last, len(self.omega))
        return Motion(
            self.start_s + first / self.rate_hz,
            self.rate_hz,
            self.omega[first:last],
            self.speed[first:last],
            self.threshold,
        )

    def smoothed(self, sigma_s: float) -> Motion:
        """Smooth ω further with a Gaussian, s; 0 leaves it as it is."""
        return replace(self, omega=_gaussian(self.omega, sigma_s * self.rate_hz)) if sigma_s > 0.0 else self

    def with_moving_share(self, moving_share: float, *, path_share: float = 0.5, percentile: float = 90.0) -> Motion:
        """Set again what counts as moving: a share of a percentile of the speed, idle time set aside.

        Idle time is what is slower than a twentieth of the speed up to which ``path_share`` of all turning is done: a
        trial of 20 s in a recording of ten minutes has the same working speed as the trial alone.
        """
        ordered = np.sort(self.speed)
        path = np.cumsum(ordered)
        middle = ordered[min(int(np.searchsorted(path, path_share * path[-1])), len(ordered) - 1)]
        busy = ordered[np.searchsorted(ordered, 0.05 * middle) :]
        return replace(self, threshold=max(moving_share * float(np.percentile(busy, percentile)), _MIN_SPEED))

    def limited(self, factor: float) -> Motion:
        """Cut speeds above ``factor`` times the usual one (the median while moving); directions stay.

        Dropping the object or putting it in place is often faster than any cycle. Uncut, one such stroke outweighs a
        whole slow trial in every sum over ω².
        """
        speed = rotations.row_lengths(self.omega)
        moving = speed[self.speed > self.threshold]
        limit = factor * float(np.median(moving if len(moving) else speed)) if len(speed) else 0.0
        if limit <= 0.0 or speed.max() <= limit:
            return self
        return replace(self, omega=self.omega * np.minimum(1.0, limit / np.maximum(speed, 1e-300))[:, None])

    def active(self) -> tuple[int, int]:
        """Return first and last (excluded) grid interval whose speed counts as moving; (0, 0) where nothing moves."""
        moving = np.flatnonzero(self.speed > self.threshold)
        return (int(moving[0]), int(moving[-1]) + 1) if len(moving) else (0, 0)


def angular_velocity(samples: Samples, *, rate_hz: float, sigma_s: float, moving_share: float) -> Motion | None:
    """Resample to an even grid, smooth with a Gaussian, and differentiate.

    ω_k = log(q_{k+1} ⊗ q_k⁻¹) · rate.

    Parameters
    ----------
    samples : Samples
        Evenly spaced or not.
    rate_hz : float
        Grid points per second.
    sigma_s : float
        Standard deviation of the Gaussian, s.
    moving_share : float
        What counts as moving, see :meth:`Motion.with_moving_share`.

    Returns
    -------
    None where the recording is too short (under 10 samples or under 4 σ).
    """
    times_s, quats = samples.times_s, samples.quats_wxyz
    if len(times_s) < 10 or times_s[-1] - times_s[0] < 4.0 * sigma_s:
        return None
    count = int((times_s[-1] - times_s[0]) * rate_hz) + 1
    omega = np.empty((count - 1, 3))
    margin = int(np.ceil(4.0 * sigma_s * rate_hz)) + 1
    for start in range(0, count - 1, _BLOCK):
        stop = min(start + _BLOCK, count - 1)
        first, last = max(start - margin, 0), min(stop + 1 + margin, count)
        grid = _resample(times_s, quats, times_s[0] + np.arange(first, last) / rate_hz)
        smooth = _gaussian(rotations.continuous_signs(grid), sigma_s * rate_hz)
        smooth /= rotations.row_lengths(smooth)[:, None]
        steps = rotations.log(rotations.difference(smooth[1:], smooth[:-1])) * rate_hz
        omega[start:stop] = steps[start - first : stop - first]
    steady = _gaussian(omega, _NOISE_SIGMA_S * rate_hz)  # hours of noise at rest must not outweigh a minute of motion
    speed = _gaussian(rotations.row_lengths(steady), _SPEED_SIGMA_S * rate_hz)
    return Motion(float(times_s[0]), rate_hz, omega, speed, _MIN_SPEED).with_moving_share(moving_share)


def _resample(times_s: FloatArray, quats: FloatArray, grid_s: FloatArray) -> FloatArray:
    """Slerp between the neighbouring samples."""
    right = np.clip(np.searchsorted(times_s, grid_s, side="right"), 1, len(times_s) - 1)
    left = right - 1
    fraction = np.clip((grid_s - times_s[left]) / (times_s[right] - times_s[left]), 0.0, 1.0)
    return rotations.slerp(quats[left], quats[right], fraction)


def _gaussian(values: FloatArray, sigma: float) -> FloatArray:
    """Smooth (m,) or (m, k) values along the first axis; beyond the ends they stay as they are there."""
    from scipy import ndimage  # slow to import; `rotdrift --help` must not pay for it

    if sigma < _WIDE_SIGMA or len(values) < 2 * _FFT_WIDTHS * sigma:
        return np.asarray(ndimage.gaussian_filter1d(values, sigma, axis=0, mode="nearest"), dtype=np.float64)
    columns = values.reshape(len(values), -1).T
    return np.stack([_wide_gaussian(column, sigma) for column in columns], axis=-1).reshape(values.shape)


def _wide_gaussian(values: FloatArray, sigma: float) -> FloatArray:
    """Smooth (m,) values as :func:`scipy.ndimage.gaussian_filter1d` does, piece by piece in the frequency domain."""
    from scipy import fft

    reach = int(4.0 * sigma + 0.5)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    size = fft.next_fast_len(int(_FFT_WIDTHS * sigma), real=True)
    step = size - 2 * reach
    padded = np.pad(values, (reach, reach + step), mode="edge")
    pieces = np.lib.stride_tricks.sliding_window_view(padded, size)[::step]
    transformed = fft.rfft(kernel / kernel.sum(), size)
    smooth = np.empty((len(pieces), step))
    rows = max(_BLOCK // size, 1)
    for first in range(0, len(pieces), rows):
        part = slice(first, first + rows)
        smooth[part] = fft.irfft(fft.rfft(pieces[part]) * transformed, size)[:, 2 * reach :]
    return smooth.reshape(-1)[: len(values)]
