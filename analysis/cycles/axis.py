"""The axis a motion turns about, followed over time, and the angle turned about it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.cycles.motion import Motion
from analysis.series import BoolArray, FloatArray

_BINS_PER_PERIOD = 12


@dataclass(frozen=True, eq=False)
class AxisAngle:
    """Rotation about the slowly changing motion axis."""

    angle_rad: FloatArray
    """(m + 1,) s = ∫ n·ω dt at the grid points, rad; starts at 0 and is not cut at ±180°."""
    axes: FloatArray
    """(b, 3) unit motion axis per bin, world frame, sign-continuous."""
    bin_points: int
    """Grid intervals per bin."""
    share: float
    """Median share of the largest eigenvalue of the smoothed ωωᵀ: 1 for one axis, 0.5 for a circular motion."""
    swing_rad: float
    """Range of motion R: median of (max − min of s) in windows of 1.2 periods, rad."""

    @property
    def mean_axis(self) -> FloatArray:
        """(3,) unit mean axis, world frame, its largest component positive."""
        mean = self.axes.mean(axis=0)
        mean /= max(float(np.linalg.norm(mean)), 1e-300)
        return np.asarray(mean if mean[np.argmax(np.abs(mean))] > 0.0 else -mean, dtype=np.float64)


def motion_axis(
    motion: Motion, period_s: float, *, sigma_periods: float, smooth_s: float = 0.0, speed_limit: float = float("inf")
) -> AxisAngle:
    """Return the top eigenvector of ωωᵀ under a Gaussian window, and the angle about it.

    Taken from ω and not from the poses: where drift is strong, the poses spread along the *drift* axis.

    Parameters
    ----------
    motion : Motion
        m grid intervals; must not be empty.
    period_s : float
        Length of one cycle, s.
    sigma_periods : float
        Standard deviation of the window in periods.
    smooth_s : float, optional
        Further smoothing of ω for the axis (not for the angle), s: where noise would blur it.
    """
    from scipy import ndimage  # slow to import

    omega, rate = motion.omega, motion.rate_hz
    m, smooth = len(omega), motion.smoothed(smooth_s).limited(speed_limit).omega
    width = max(int(period_s * rate / _BINS_PER_PERIOD), 1)
    edges = np.arange(0, m, width)
    # ωωᵀ is summed over bins of a twelfth of a period first: the window is much wider, so nothing is lost.
    upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
    tensor = np.empty((len(edges), 3, 3))
    for row, column in upper:
        sums = np.add.reduceat(smooth[:, row] * smooth[:, column], edges)
        local = ndimage.gaussian_filter1d(sums, sigma_periods * period_s * rate / width, mode="constant")
        tensor[:, row, column] = tensor[:, column, row] = local
    values, vectors = np.linalg.eigh(tensor)
    axes = vectors[:, :, -1]
    # An eigenvector has no sign: each is turned the way of the one before it.
    flips = np.einsum("ij,ij->i", axes[1:], axes[:-1]) < 0.0
    axes = np.where(np.concatenate(([False], np.logical_xor.accumulate(flips)))[:, None], -axes, axes)
    share = float(np.median(values[:, -1] / np.maximum(values.sum(axis=1), 1e-300)))
    centres, points = edges + 0.5 * width, np.arange(m) + 0.5
    # n · ω with n interpolated between the bins, and made unit again by its length.
    along, length = np.zeros(m), np.zeros(m)
    for component in range(3):
        axis = np.interp(points, centres, axes[:, component])
        along += axis * omega[:, component]
        length += axis * axis
    angle = np.concatenate(([0.0], np.cumsum(along / np.sqrt(length) / rate)))
    moving = motion.speed > motion.threshold
    return AxisAngle(angle, axes, width, share, _range_of_motion(angle, moving, int(1.2 * period_s * rate)))


def _range_of_motion(angle: FloatArray, moving: BoolArray, window: int) -> float:
    """Return the median of max − min in windows centred where the object moves."""
    from scipy import ndimage  # slow to import

    window = min(max(window, 2), len(angle))
    spread = ndimage.maximum_filter1d(angle, window) - ndimage.minimum_filter1d(angle, window)
    half = window // 2
    inside = spread[half : len(spread) - half] if len(spread) > 2 * window else spread
    centre = moving[half : half + len(inside)] if len(spread) > 2 * window else moving[: len(inside)]
    chosen = inside[: len(centre)][centre]
    return float(np.median(chosen if len(chosen) else spread))
