"""Locking on to cycles of any shape: the speed along and across the motion axis over one cycle as a template."""

from __future__ import annotations

import numpy as np

from analysis.cycles.motion import Motion
from analysis.cycles.turning_points import TurningPoints
from analysis.geometry.rotations import row_lengths
from analysis.series import FloatArray, IntArray

_MIN_LIKENESS = 0.3
_MIN_ENERGY_SHARE = 0.1
_MIN_SPACING = 0.7
_ROUNDS = 3
_SEARCH_PERIODS = 0.15


def axis_speeds(motion: Motion, angle: FloatArray, speed_limit: float) -> FloatArray:
    """Return the speed along the motion axis, and across it.

    Unlike ω itself, these stay the same from cycle to cycle when drift has turned the motion axis far away.

    Parameters
    ----------
    motion : Motion
        m grid intervals.
    angle : array of float
        (m + 1,) angle about the motion axis, rad.
    speed_limit : float
        Faster strokes are cut to this many times the usual speed (:meth:`Motion.limited`).

    Returns
    -------
    (m, 2) rad/s.
    """
    along = np.diff(angle) * motion.rate_hz
    speed = row_lengths(motion.omega)
    limited = row_lengths(motion.limited(speed_limit).omega)
    along *= limited / np.maximum(speed, 1e-300)
    return np.stack((along, np.sqrt(np.maximum(limited * limited - along * along, 0.0))), axis=1)


def locked_cycles(speeds: FloatArray, period: int) -> IntArray:
    """Find the starts of the cycles that look like the most typical one.

    The template starts as the cycle most like the one after it and becomes the mean of all cycles found, three times.

    Parameters
    ----------
    speeds : array of float
        (m, 2) what is compared, from :func:`axis_speeds`.
    period : int
        Grid intervals per cycle, at most m / 2.

    Returns
    -------
    (c,) grid intervals where cycles start, at least 0.7 periods apart; the first may be negative: a piece of a cycle.
    """
    from scipy import signal  # slow to import

    if period < 4 or len(speeds) < 2 * period:
        return np.empty(0, dtype=np.int64)
    # The cut between cycles falls anywhere: at both ends there may be a piece of a cycle, and rest beyond it.
    speeds = np.pad(speeds, ((period, period), (0, 0)))
    work = np.concatenate(([0.0], np.cumsum(np.einsum("ij,ij->i", speeds, speeds))))
    work = work[period:] - work[:-period]
    at_rest = work < _MIN_ENERGY_SHARE * np.median(work)
    speeds = np.stack((speeds[:, 0], speeds[:, 1] - speeds[:, 1].mean()), axis=1)  # the second is never below 0
    power = np.concatenate(([0.0], np.cumsum(np.einsum("ij,ij->i", speeds, speeds))))
    energy = np.maximum(power[period:] - power[:-period], 1e-100)  # of the window starting at each interval
    products = np.concatenate(([0.0], np.cumsum(np.einsum("ij,ij->i", speeds[period:], speeds[:-period]))))
    overlap = products[period:] - products[:-period]
    this, following = energy[: len(overlap)], energy[period : period + len(overlap)]
    likeness = overlap / np.sqrt(this * following)
    likeness[at_rest[: len(overlap)] | at_rest[period : period + len(overlap)]] = -1.0  # all rests look the same
    seed = int(np.argmax(likeness))
    template = speeds[seed : seed + period]
    starts = np.empty(0, dtype=np.int64)
    for _ in range(_ROUNDS):
        # Normalised cross-correlation of the template with every window of its length.
        own = float(np.einsum("ij,ij->", template, template))
        match = sum(signal.oaconvolve(speeds[:, k], template[::-1, k], mode="valid") for k in range(speeds.shape[1]))
        likeness = np.asarray(match, dtype=np.float64) / np.sqrt(energy * own)
        likeness[at_rest | (energy < _MIN_ENERGY_SHARE * own)] = -1.0
        padded = np.concatenate(([-2.0], likeness, [-2.0]))
        peaks, _ = signal.find_peaks(padded, height=_MIN_LIKENESS, distance=max(int(_MIN_SPACING * period), 1))
        if len(peaks) == 0:
            break
        starts = np.asarray(peaks, dtype=np.int64) - 1
        template = np.mean([speeds[start : start + period] for start in starts[:2000]], axis=0)
    return starts - period


def template_turning_points(angle: FloatArray, starts: IntArray, period: int) -> TurningPoints:
    """Return one upper and one lower extreme per cycle, each always at the same phase.

    The mean cycle, its drift removed, shows at which phase the highest and the lowest point lie; in every cycle the
    extreme nearest to that phase counts, however many peaks there are.

    Parameters
    ----------
    angle : array of float
        (m + 1,) rotation about the motion axis at the grid points.
    starts : array of int
        (c,) starts of the cycles, grid points.
    period : int
        Grid intervals per cycle.
    """
    whole = starts[(starts >= 0) & (starts + period < len(angle))]
    if len(whole) == 0:
        return TurningPoints(np.empty(0, dtype=np.int64), np.empty(0, dtype=bool))
    mean = np.mean([angle[start : start + period + 1] - angle[start] for start in whole[:2000]], axis=0)
    mean -= np.linspace(mean[0], mean[-1], period + 1)
    phases = {True: int(np.argmax(mean[:-1])), False: int(np.argmin(mean[:-1]))}
    reach = max(int(_SEARCH_PERIODS * period), 1)
    found: dict[int, bool] = {}
    for upper, phase in phases.items():
        for target in (starts + phase).tolist():
            first, last = target - reach, target + reach + 1
            if first < 0 or last > len(angle):
                continue
            window = angle[first:last]
            found[first + int(np.argmax(window) if upper else np.argmin(window))] = upper
    points = sorted(found)
    return TurningPoints(np.array(points, dtype=np.int64), np.array([found[p] for p in points], dtype=bool))
