"""How similar the cycles are to each other, and how often the object rests in them."""

from __future__ import annotations

import numpy as np

from analysis.cycles.motion import Motion
from analysis.geometry import averages, rotations
from analysis.geometry.rotations import row_lengths
from analysis.series import BoolArray, FloatArray

_PHASES = 48
_MAX_CYCLES = 2000
_ROUNDING = 1e-9
_MIN_TREND, _TREND_CHANCE, _MIN_SLOPE = 5, 0.005, 0.01


def likeness(motion: Motion, endpoint_s: FloatArray, paused: BoolArray | None = None) -> float:
    """Return the median correlation of each cycle's angular velocity with the mean of its six neighbours.

    Cycles are scaled to one length first, so tempo does not matter; nor does the size of the motion. Neighbours
    only, because drift slowly turns the motion axis away from where it was.

    Parameters
    ----------
    motion : Motion
        Angular velocity of the trial, smoothed to a fortieth of a period or so: noise in ω must not count.
    endpoint_s : array of float
        (n,) times of the end points, n ≥ 3, s.
    paused : array of bool, optional
        (n − 1,) cycles with a pause in them: they have another shape, and are not compared.

    Returns
    -------
    −1 to 1; above 0.9 for a hand that repeats itself, 0.5 and less for random motion.
    """
    used = np.flatnonzero(~paused) if paused is not None and np.sum(~paused) >= 2 else np.arange(len(endpoint_s) - 1)
    used = used[:_MAX_CYCLES]
    cycles = len(used)
    grid_s = motion.start_s + (np.arange(len(motion.omega)) + 0.5) / motion.rate_hz
    phase = (np.arange(_PHASES) + 0.5) / _PHASES
    length_s = np.diff(endpoint_s)[used]
    at_s = endpoint_s[used, None] + phase * length_s[:, None]
    shape = np.stack([np.interp(at_s, grid_s, motion.omega[:, axis]) for axis in range(3)], axis=-1)
    shape = (shape * length_s[:, None, None]).reshape(cycles, -1)
    # Sums of neighbours from one cumulative sum: three before to three after, the cycle itself taken off.
    total = np.concatenate((np.zeros((1, shape.shape[1])), np.cumsum(shape, axis=0)))
    row = np.arange(cycles)
    others = total[np.minimum(row + 4, cycles)] - total[np.maximum(row - 3, 0)] - shape
    scale = np.linalg.norm(shape, axis=1) * np.linalg.norm(others, axis=1)
    return float(np.median((shape * others).sum(axis=1) / np.maximum(scale, 1e-300)))


def irregularity(spacing_s: FloatArray | None, prominence: FloatArray) -> float:
    """Return the spread of the distances between end points and of the swings, as a share of their medians.

    Each spread is 1.25 times the mean deviation from the median (the standard deviation of normal values), so that
    one slip among few cycles does not count as irregular motion.

    Parameters
    ----------
    spacing_s : array of float or None
        Distances between end points without those across a pause, s; None where any tempo will do.
    prominence : array of float
        (n,) swing of each, any unit.
    """
    total = 0.0
    for values in (prominence,) if spacing_s is None or not len(spacing_s) else (spacing_s, prominence):
        middle = float(np.median(values))
        total += (1.25 * float(np.mean(np.abs(values - middle))) / max(middle, 1e-300)) ** 2
    return float(np.sqrt(total))


def rests(motion: Motion, period_s: float) -> tuple[float, float]:
    """Return how often per cycle the object rests, and for which share of the time.

    A rest is at least 3 % of a period at less than a tenth of the speed at which the turning is done (the mean of ω²
    weighted by |ω|). A hand that turns an object to and fro rests twice per cycle at most; one that lets go, opens,
    comes back, closes and lifts rests between all of these.

    Parameters
    ----------
    motion : Motion
        Angular velocity between the first and the last end point.
    period_s : float
        Length of a cycle, s.
    """
    speed = row_lengths(motion.omega)
    level = 0.1 * np.sqrt((speed**3).sum() / max(float(speed.sum()), 1e-300))
    edges = np.diff(np.concatenate(([False], speed < level, [False])).astype(np.int8))
    length_s = (np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)) / motion.rate_hz
    length_s = length_s[length_s > 0.03 * period_s]
    total_s = len(speed) / motion.rate_hz
    return len(length_s) * period_s / total_s, float(length_s.sum()) / total_s


def swing_trend(prominence: FloatArray) -> float:
    """Return by which share the swing grows a cycle where it does so steadily, below 0 where it shrinks; else 0.

    A straight line through the logarithms; steady where its slope has a chance below 0.005 (Student's t) and is 1 % or
    more.

    Parameters
    ----------
    prominence : array of float
        (n,) swing of each cycle, any unit.
    """
    n = len(prominence)
    if n < _MIN_TREND or not np.all(prominence > 0.0):
        return 0.0
    from scipy import special  # slow to import

    row, logs = np.arange(n) - 0.5 * (n - 1), np.log(prominence / prominence.mean())
    power = float(row @ row)
    slope = float(row @ logs) / power
    left = logs - logs.mean() - slope * row
    error = np.sqrt(float(left @ left) / (n - 2) / power)
    chance = 2.0 * float(special.stdtr(n - 2, -abs(slope) / max(error, 1e-12)))
    return float(np.expm1(slope)) if chance < _TREND_CHANCE and abs(slope) >= _MIN_SLOPE else 0.0


def alternation(steps: FloatArray) -> float:
    """Return the lag-1 correlation of (n, 3) rotation vectors about their mean: near −1 where they come and go.

    It is 0 where all are the same, as far as rounding lets them.
    """
    apart = steps - steps.mean(axis=0)
    power = float(np.einsum("ij,ij->", apart, apart))
    least = _ROUNDING * float(np.einsum("ij,ij->", steps, steps))
    return float(np.einsum("ij,ij->", apart[1:], apart[:-1])) / power if power > least else 0.0


def agreement(steps: FloatArray, swing_rad: float) -> float:
    """Return how far steps agree with each other: 1 where all are one rotation, below 0.9 where a mean claims little.

    The share of the largest eigenvalue of the card's matrix M, its angles taken in units of half the swing: the mean
    cos² of each step's distance from the mean step in swings, at most a quarter turn. As M stands, the share depends on
    how far the motion goes: poses that scatter by a third of the swing give 0.997 for a swing of 20° and 0.4 for 300°.
    A share of 0.9 is a scatter (root mean square) of a third of the swing.

    Parameters
    ----------
    steps : array of float
        (n, 4) step rotations, n ≥ 1.
    swing_rad : float
        Range of motion, rad.
    """
    apart = rotations.distance(steps, averages.average(steps)) / max(swing_rad, 1e-12)
    return float(np.mean(np.cos(np.minimum(apart, 0.5 * np.pi)) ** 2))
