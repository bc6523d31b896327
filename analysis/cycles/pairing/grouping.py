"""How many pairs of strokes make a cycle, and which pair of its cycle each one is.

The autocorrelation cannot separate a motion of two similar peaks a cycle from one of half the period. Pairs of strokes
can: every k-th pair is similar where k make a cycle, and those between are not. Two tests, for two kinds of evidence:

* clear: pairs that are a multiple of k apart lie much nearer to each other than all others. A pair too many or too few,
  from a slip or a pause, spoils few of these distances.
* fine: where all pairs are nearly the same, whether the few ways in which they do differ recur every k pairs, more than
  in any other order of the same pairs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.cycles.pairing.strokes import StrokePairs
from analysis.cycles.turning_points import NONE_FOUND, TurningPoints
from analysis.series import FloatArray, IntArray

MAX_PAIRS = 4
"""Most pairs a cycle."""
_JUDGED = 200
"""Pairs that are compared, the first ones: as many as make any motion clear."""
MAX_POINTS = 2 * _JUDGED + 2
"""Turning points of so many pairs."""
_CLEAR = 0.45
"""Largest distance a multiple of k apart, share of the smallest of the others."""
_SURE_CHANCE, _CLEAR_CHANCE, _NO_CHANCE = 0.01, 0.02, 0.05
OBVIOUS = 0.2
"""So much smaller that no other order of the pairs need be tried: few pairs have few orders."""
_APART = 0.06
"""Distance that is one: less is how a hand repeats itself, in swings."""
_FINE_SHARE, _FINE_CHANCE, _FINE_PAIRS = 0.7, 0.001, 8
_POSSIBLE_SHARE, _POSSIBLE_CHANCE = 0.5, 0.005
_SHARE_TRIED = 0.2
_WAYS = 3
"""Ways in which pairs differ: leading principal components."""
_ROUNDING = 1e-9
_ORDERS = 4000
_SHIFT_COST = 6.0
"""Cost of a pair that is not the next of its cycle, in squared distances between pairs of one kind."""


@dataclass(frozen=True)
class Grouping:
    """How many pairs of strokes make a cycle."""

    pairs: int
    """Pairs a cycle, from 1."""
    nearness: float
    """Distance between pairs of one kind, share of that between kinds; 1 for one pair a cycle."""
    spread: float
    """Median distance between neighbouring pairs of one kind, in swings."""
    possible: int = 0
    """Another number that cannot be ruled out; 0 where there is none."""


def group(starting: tuple[StrokePairs, StrokePairs]) -> Grouping:
    """Return how many pairs make a cycle.

    Parameters
    ----------
    starting : tuple of StrokePairs
        The same strokes in pairs from the first turning point on, and from the second.
    """
    shapes = [_without_trend(pairs.shapes[:_JUDGED]) for pairs in starting if len(pairs) >= 2]
    if not shapes:
        return Grouping(1, 1.0, float("inf"))
    distances = [_distances(each) for each in shapes]
    found = Grouping(1, 1.0, min(_spread(each, 1) for each in distances))
    for k in range(2, MAX_PAIRS + 1):
        nearness = min((_nearness(each, k) for each in distances if len(each) > 2 * k), default=np.inf)
        if nearness < found.nearness and nearness <= _CLEAR:
            clear, sure = _is_clear(distances, k)
            if clear:
                spread_k = min(_spread(each, k) for each in distances)
                found = Grouping(k, nearness, spread_k, possible=0 if sure else 1)
    if found.pairs > 1:
        return found
    # From either turning point on, the pairs are the same strokes: what is there must show in both.
    ways = [_ways(each) for each in shapes]
    for k in range(2, MAX_PAIRS + 1):
        shares, chances = zip(*(_recurrence(each, k) for each in ways), strict=True)
        if max(shares) < _POSSIBLE_SHARE or min(chances) > _POSSIBLE_CHANCE or max(chances) > _NO_CHANCE:
            continue
        if k == 2 and max(shares) >= _FINE_SHARE and min(chances) <= _FINE_CHANCE:
            return Grouping(k, 1.0, min(_spread(each, k) for each in distances), possible=1)
        return replace(found, possible=k)
    return found


def spread(pairs: StrokePairs) -> float:
    """Return the median distance between neighbouring pairs, in swings; infinite for too few."""
    return _spread(_distances(_without_trend(pairs.shapes[:_JUDGED])), 1)


def durations_recur(pairs: StrokePairs, k: int) -> bool:
    """Return whether the duration of strokes recurs every k pairs, where their shapes may not."""
    durations = _without_trend(pairs.durations[:_JUDGED])
    if len(durations) <= 2 * k:
        return False
    return _recurrence(_ways(durations), k)[1] <= _NO_CHANCE


def kinds(pairs: StrokePairs, k: int) -> IntArray:
    """Return (n,) which pair of its cycle each one is, 0 to k − 1: the cheapest way through all pairs.

    Each pair costs its squared distance from the mean of its kind, and a pair that is not the next of its cycle costs
    more: a slip or a pause may add or hide one, and must not turn all kinds after it.
    """
    shapes = _without_trend(pairs.shapes)
    n = len(shapes)
    if n < 2 * k:
        return np.arange(n) % k
    # The k pairs in a row that all others are nearest to stand for the kinds at first.
    sample = _distances(shapes[:_JUDGED])
    nearest = np.lib.stride_tricks.sliding_window_view(sample, k, axis=1).min(axis=2)
    first = int(np.argmin(nearest.sum(axis=0)))
    means = shapes[first : first + k]
    label = np.empty(0, dtype=np.int64)
    for _ in range(3):
        costs = ((shapes[:, None] - means) ** 2).sum(axis=2)
        label = _cheapest(costs / max(float(np.median(costs.min(axis=1))), 1e-12))
        means = np.stack(
            [shapes[label == kind].mean(axis=0) if (label == kind).any() else means[kind] for kind in range(k)]
        )
    return label


def _cheapest(costs: FloatArray) -> IntArray:
    """Return (n,) the cheapest sequence of kinds through (n, k) costs: Viterbi's algorithm."""
    n, k = costs.shape
    kind = np.arange(k)
    change = np.where((kind[:, None] + 1) % k == kind, 0.0, _SHIFT_COST)  # from, to
    total, came = costs[0], np.empty((n, k), dtype=np.int64)
    for j in range(1, n):
        ways = total[:, None] + change
        came[j] = np.argmin(ways, axis=0)
        total = ways[came[j], kind] + costs[j]
    path = np.empty(n, dtype=np.int64)
    path[-1] = np.argmin(total)
    for j in range(n - 1, 0, -1):
        path[j - 1] = came[j, path[j]]
    return path


def one_a_cycle(found: TurningPoints, angle: FloatArray, label: IntArray, k: int, period: float) -> TurningPoints:
    """Return one upper and one lower turning point a cycle, each always at the same phase.

    Parameters
    ----------
    found : TurningPoints
        All turning points.
    angle : array of float
        (m,) what they were found in.
    label : array of int
        (n,) which pair of its cycle each pair is, the first one starting at the first turning point.
    k : int
        Pairs a cycle.
    period : float
        Length of a cycle, grid points.
    """
    from scipy import ndimage  # slow to import

    if len(label) == 0:
        return NONE_FOUND
    # What follows the last whole pair is of the next kind.
    of_pair = np.append(label, (label[-1] + 1) % k)[np.arange(len(found)) // 2]
    middle = ndimage.uniform_filter1d(angle, max(round(period), 1))
    height = (angle[found.points] - middle[found.points]) * np.where(found.upper, 1.0, -1.0)
    phases = [
        [np.flatnonzero((found.upper == upper) & (of_pair == kind)) for kind in range(k)] for upper in (True, False)
    ]
    furthest = [max((p for p in kind if len(p)), key=lambda p: float(np.median(height[p]))) for kind in phases]
    # A trial that starts or ends in the middle of a cycle may reach another phase once more than both of these.
    usual = max(len(places) for places in furthest)
    most = [max(kind, key=len) for kind in phases]
    order = np.sort(np.concatenate([m if len(m) > usual else f for m, f in zip(most, furthest, strict=True)]))
    chosen = TurningPoints(found.points[order], found.upper[order])
    return chosen.apart(0.5 * period)


def _without_trend(values: FloatArray) -> FloatArray:
    """Take a straight line off every column, where there are rows enough to have one."""
    values = values - values.mean(axis=0) if len(values) else values
    if len(values) < 5:
        return values
    row = np.arange(len(values)) - 0.5 * (len(values) - 1)
    return values - np.outer(row, row @ values / (row @ row))


def _distances(shapes: FloatArray) -> FloatArray:
    squares = np.einsum("ij,ij->i", shapes, shapes)
    between: FloatArray = np.maximum(squares[:, None] + squares - 2.0 * shapes @ shapes.T, 0.0)
    return np.sqrt(between)


def _by_lag(distances: FloatArray, order: IntArray, most: int) -> FloatArray:
    """Return (..., most) median distance of pairs 1, 2 ... apart in (..., n) orders."""
    lags = range(1, most + 1)
    return np.stack([np.median(distances[order[..., lag:], order[..., :-lag]], axis=-1) for lag in lags], axis=-1)


def _split(distances: FloatArray, order: IntArray, k: int) -> tuple[FloatArray, FloatArray]:
    by_lag = _by_lag(distances, order, min(2 * k, len(distances) - 1))
    same = np.arange(1, by_lag.shape[-1] + 1) % k == 0
    return by_lag[..., same].max(axis=-1), by_lag[..., ~same].min(axis=-1)


def _nearness(distances: FloatArray, k: int) -> float:
    near, far = _split(distances, np.arange(len(distances)), k)
    return float(near / far) if far >= _APART else np.inf


def _is_clear(distances: list[FloatArray], k: int) -> tuple[bool, bool]:
    """Return whether pairs k apart are nearer than others, as few orders of them are, and whether that is sure.

    Sizes that vary at random alternate by chance now and then, seen from one of the two turning points. From the other
    one the pairs are the same strokes: what is not obvious must show there as well, if less.
    """
    long_enough = [each for each in distances if len(each) > 2 * k]
    nearness = [_nearness(each, k) for each in long_enough]
    if min(nearness) <= OBVIOUS:
        return True, True
    chances = [_chance(each, k) for each in long_enough]
    clear = any(near <= _CLEAR and chance <= _CLEAR_CHANCE for near, chance in zip(nearness, chances, strict=True))
    return clear and max(chances) <= _NO_CHANCE, max(chances) <= _SURE_CHANCE


def _chance(distances: FloatArray, k: int) -> float:
    """Return the share of other orders of the pairs in which those k apart are as near to each other."""
    n = len(distances)
    near, far = _split(distances, np.arange(n), k)
    other_near, other_far = _split(distances, _orders(n, _ORDERS // 10), k)
    return float(np.mean(other_near * far <= near * other_far))


def _spread(distances: FloatArray, k: int) -> float:
    return float(np.median(np.diagonal(distances, k))) if len(distances) > k else float("inf")


def _orders(n: int, count: int) -> IntArray:
    return np.random.default_rng(0).permuted(np.tile(np.arange(n), (count, 1)), axis=1)


def _ways(values: FloatArray) -> FloatArray:
    """Return (n, up to 3) how much of each way in which pairs differ each pair has: leading principal components."""
    if len(values) < _FINE_PAIRS:
        return np.empty((len(values), 0))
    scores, sizes, _ = np.linalg.svd(values, full_matrices=False)
    leading: FloatArray = scores[:, :_WAYS][:, sizes[:_WAYS] > _ROUNDING]
    return leading


def _recurrence(scores: FloatArray, k: int) -> tuple[float, float]:
    """Return the largest share of a way in which pairs differ that recurs every k pairs, and the chance of it."""
    n = len(scores)
    if n <= 2 * k or scores.shape[1] == 0:
        return 0.0, 1.0
    counts = np.array([len(range(kind, n, k)) for kind in range(k)])

    def shares(order: IntArray) -> FloatArray:
        ordered = scores[order]
        sums = np.stack([ordered[..., kind::k, :].sum(axis=-2) for kind in range(k)])
        shape = (k,) + (1,) * (sums.ndim - 1)
        return np.asarray((sums**2 / counts.reshape(shape)).sum(axis=0).max(axis=-1))

    share = float(shares(np.arange(n)))
    if share < _SHARE_TRIED:
        return share, 1.0
    return share, float(np.mean(shares(_orders(n, _ORDERS)) >= share - 1e-9))
