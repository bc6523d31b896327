"""Where the object is at rest, and how fast its orientation creeps there: the sensor's own heading drift."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.geometry import rotations
from analysis.series import FloatArray, IntArray, OrientationSeries

MIN_HOLD_S = 3.0
"""A shorter rest is too short to measure degrees per minute."""
MAX_SPEED_DEG_S = 0.5
"""Faster than this over half a second is motion, unless the noise alone explains it: 6 deg/min is 0.1 deg/s."""
_BLOCK_S = 0.5


@dataclass(frozen=True, eq=False)
class Creep:
    """Orientation of a resting object over time: a line and what is left of it. World axes."""

    n_samples: int
    """Samples it was made of."""
    from_s: float
    """First of them, recording's own time, s."""
    to_s: float
    """Last of them."""
    rate_deg_per_min: FloatArray
    """(3,) slope of the rotation vector."""
    rate_error_deg_per_min: FloatArray
    """(3,) standard error of the slope from half-second means, so that slow noise counts in full."""
    noise_deg: float
    """Noise of one sample, root mean square of the rotation angle about the line's slow part."""

    @property
    def duration_s(self) -> float:
        """First to last sample, s."""
        return self.to_s - self.from_s


def measure_creep(times_s: FloatArray, quats_wxyz: FloatArray) -> Creep:
    """Return a line fitted through the rotation vector of a resting object.

    Parameters
    ----------
    times_s : (n,) float64
        s, n ≥ 4 and at least two seconds.
    quats_wxyz : (n, 4) float64
        Unit, scalar first.
    """
    blocks = block_orientations(times_s, quats_wxyz)
    at, means = blocks.at_s, blocks.path_deg
    centred = at - at.mean()
    spread = float(centred @ centred)
    slope = centred @ means / spread
    left = means - means.mean(axis=0) - centred[:, None] * slope
    freedom = max(len(at) - 2, 1)
    return Creep(
        n_samples=len(times_s),
        from_s=float(times_s[0]),
        to_s=float(times_s[-1]),
        rate_deg_per_min=slope * 60.0,
        rate_error_deg_per_min=np.sqrt(np.sum(left**2, axis=0) / freedom / spread) * 60.0,
        noise_deg=blocks.noise_deg(times_s, quats_wxyz),
    )


@dataclass(frozen=True, eq=False)
class BlockOrientations:
    """Mean orientation over blocks of equal length in time."""

    starts: IntArray
    """(b,) first sample of each block."""
    at_s: FloatArray
    """(b,) mean time of each block, s."""
    quats_wxyz: FloatArray
    """(b, 4) mean orientation."""
    path_deg: FloatArray
    """(b, 3) sum of the rotation vectors from block to block: follows slow drift past half a turn."""

    def noise_deg(self, times_s: FloatArray, quats_wxyz: FloatArray) -> float:
        """Return the noise of one sample about its block, the block's own creep subtracted; root mean square angle."""
        counts = np.diff(np.append(self.starts, len(times_s)))
        number = np.repeat(np.arange(len(self.at_s)), counts)
        off = np.degrees(rotations.log(rotations.difference(quats_wxyz, self.quats_wxyz[number])))
        rate = np.gradient(self.path_deg, self.at_s, axis=0) if len(self.at_s) > 1 else np.zeros((1, 3))
        off -= rate[number] * (times_s - self.at_s[number])[:, None]
        freedom = max(len(times_s) - len(self.at_s), 1)  # each block's mean is subtracted
        return float(np.sqrt(np.sum(off**2) / freedom))


def block_orientations(times_s: FloatArray, quats_wxyz: FloatArray, block_s: float = _BLOCK_S) -> BlockOrientations:
    """Return mean orientations over blocks of equal length in time; for objects that hardly turn within one.

    Parameters
    ----------
    times_s : (n,) float64
        s, increasing.
    quats_wxyz : (n, 4) float64
        Unit, scalar first.
    block_s : float, optional
        Length of a block, s.
    """
    number = ((times_s - times_s[0]) / block_s).astype(np.int64)
    starts = np.flatnonzero(np.concatenate(([True], np.diff(number) > 0)))
    counts = np.diff(np.append(starts, len(times_s)))
    # The mean of a block with few samples (the last one, usually) is noisier than the others: it joins its predecessor.
    starts = starts[np.concatenate(([True], counts[1:] >= 0.5 * np.median(counts)))]
    counts = np.diff(np.append(starts, len(times_s)))
    sums = np.add.reduceat(rotations.continuous_signs(quats_wxyz), starts, axis=0)
    means = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    steps = np.degrees(rotations.log(rotations.difference(means[1:], means[:-1])))
    return BlockOrientations(
        starts=starts,
        at_s=np.add.reduceat(times_s, starts) / counts,
        quats_wxyz=means,
        path_deg=np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0))),
    )


def still_holds(series: OrientationSeries, active_s: tuple[float, float] | None = None) -> tuple[Creep, ...]:
    """Return the rests of a recording in time order; those before and after the motion where ``active_s`` is given.

    ``active_s`` is (from, to) of the motion in the recording's own time, s.
    """
    if active_s is None:
        return tuple(_holds(series.times_s, series.quats_wxyz))
    before, after = np.searchsorted(series.times_s, active_s)
    parts = (slice(0, int(before)), slice(int(after), len(series)))
    return tuple(hold for part in parts for hold in _holds(series.times_s[part], series.quats_wxyz[part]))


def _holds(times_s: FloatArray, quats_wxyz: FloatArray) -> Iterator[Creep]:
    if len(times_s) < 8 or times_s[-1] - times_s[0] < MIN_HOLD_S:
        return
    blocks = block_orientations(times_s, quats_wxyz)
    at = blocks.at_s
    if len(at) < 4:
        return
    # A mean of k samples jitters by noise/√k; the limit leaves room for it, so that a noisy tracker can rest too.
    jitter = _quiet_noise_deg(quats_wxyz, blocks) / np.sqrt(max(len(times_s) / len(at), 1.0))
    speed = np.linalg.norm(np.diff(blocks.path_deg, axis=0), axis=1) / np.diff(at)
    still = (speed < MAX_SPEED_DEG_S + 4.0 * jitter / _BLOCK_S) & (np.diff(at) < 2.0 * _BLOCK_S)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], still.astype(np.int8), [0]))))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        # Blocks first … last are at rest; one that has motion next to it may hold some of it.
        start = at[first + 1] - 0.5 * _BLOCK_S if first else times_s[0]
        end = at[last - 1] + 0.5 * _BLOCK_S if last < len(still) else times_s[-1]
        rows = slice(int(np.searchsorted(times_s, start)), int(np.searchsorted(times_s, end, side="right")))
        if rows.stop - rows.start >= 8 and times_s[rows.stop - 1] - times_s[rows.start] >= 0.98 * MIN_HOLD_S:
            yield measure_creep(times_s[rows], quats_wxyz[rows])


def _quiet_noise_deg(quats_wxyz: FloatArray, blocks: BlockOrientations) -> float:
    """Return the noise of one sample in the quietest tenth of the blocks, from differences between neighbours, deg."""
    steps = np.degrees(rotations.distance(quats_wxyz[1:], quats_wxyz[:-1]))
    counts = np.diff(np.append(blocks.starts, len(quats_wxyz)))
    powers = np.add.reduceat(np.append(steps**2, 0.0), blocks.starts) / counts
    return float(np.sqrt(0.5 * np.percentile(powers, 10.0)))
