"""Clocks in files: counters that wrap, and sessions that follow each other in one file.

A step back in time is one of three things. *A wrap*: the counter came near its end and went on from its start, so that
with one period added the next stamp comes as soon as the others do. *Another session*: time starts again, and runs on
from there for many rows. *A row out of place*: time goes back, and soon on from where it was; such rows are set aside
where the series is made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.series import BoolArray, FloatArray, IntArray

_DAY_S = 86_400.0
PERIODS_S: tuple[tuple[float, str], ...] = (
    *(
        (2.0**bits * tick_s, f"{bits}-bit counter of {name}")
        for bits, name, tick_s in (
            (16, "ms", 1e-3),
            (24, "µs", 1e-6),
            (32, "ns", 1e-9),
            (32, "µs", 1e-6),
            (32, "0.1 ms", 1e-4),
            (32, "ms", 1e-3),
            (16, "ticks", 1.0),
            (24, "ticks", 1.0),
            (32, "ticks", 1.0),
        )
    ),
    (_DAY_S, "clock of one day"),
)
"""After how long clocks wrap, s, and what wraps so."""
NEAR_INTERVALS = 10.0
"""A stamp behind a wrap comes within so many usual intervals: a wrap is no time to lose many samples."""
EDGE_INTERVALS = 3.0
"""The stamps around a wrap are so near to the ends of the counter; those of a counter that was shifted ..."""
FIT = 0.6
"""... come a usual interval apart, but for this share of it."""
MIN_SESSION_ROWS = 10
"""Fewer rows than these are rows out of place, not a session."""
MIN_STEP_BACK_S = 1.0
"""Time that goes back by less is that of rows out of place."""


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """Times with every wrap undone."""

    times_s: FloatArray
    """(n,)."""
    note: str
    """What wrapped; empty where nothing did."""


def unwrapped(times_s: FloatArray) -> Unwrapped:
    """Return times, s, with the wraps of one period undone.

    Parameters
    ----------
    times_s : array of float
        (n,) as found in the file.
    """
    steps = np.diff(times_s)
    back = np.flatnonzero(steps < 0.0)
    forward = steps[steps > 0.0]
    if not len(back) or len(forward) < 2:
        return Unwrapped(times_s, "")
    usual_s = float(np.median(forward))
    span_s = float(times_s.max() - times_s.min())
    before_s, after_s = times_s[back], times_s[back + 1]
    for period_s, what in PERIODS_S:
        ahead = steps[back] + period_s
        # A session may happen to be about as long as a period: then its last stamp is not at the counter's very end.
        edge_s = EDGE_INTERVALS * usual_s
        ends = ((after_s >= 0.0) & (after_s < edge_s) & (before_s >= period_s - edge_s) & (before_s < period_s)) | (
            (after_s < -0.5 * period_s + edge_s) & (before_s >= 0.5 * period_s - edge_s)
        )
        fits = np.where(ends, ahead <= NEAR_INTERVALS * usual_s, np.abs(ahead - usual_s) <= FIT * usual_s)
        wraps = back[(ahead > 0.0) & fits & (NEAR_INTERVALS * usual_s < 0.5 * period_s)]
        # All of one period's stamps lie within it; a session that happens to be as long starts elsewhere.
        if len(wraps) and span_s < period_s * (1.0 + 1e-9):
            turns = np.zeros(len(times_s))
            turns[wraps + 1] = period_s
            rows = ", ".join(str(row + 1) for row in wraps[:5].tolist())
            many = (
                f"{len(wraps)} times, first"
                if len(wraps) > 5
                else "once,"
                if len(wraps) == 1
                else f"{len(wraps)} times,"
            )
            return Unwrapped(
                times_s + np.cumsum(turns),
                f"the clock of the file wraps {many} before row {rows} ({what}, {period_s:g} s) and was unwrapped",
            )
    return Unwrapped(times_s, "")


def session_starts(times_s: FloatArray, known: IntArray, step_back_s: float = MIN_STEP_BACK_S) -> IntArray:
    """Return (k,) the rows with which another session starts, the first row not among them.

    Parameters
    ----------
    times_s : array of float
        (n,) with wraps undone.
    known : array of int
        Rows at which something else shows a new session.
    step_back_s : float, optional
        Time that goes back by less is that of rows out of place.
    """
    steps = np.diff(times_s)
    forward = steps[steps > 0.0]
    usual_s = float(np.median(forward)) if len(forward) else 0.0
    least_s = max(step_back_s, NEAR_INTERVALS * usual_s)
    starts: list[int] = []
    backs = np.flatnonzero(steps < 0.0) + 1
    for row in backs[steps[backs - 1] <= -least_s].tolist():
        # A stamp far ahead makes the next one a step back, but few rows are later than where time goes on.
        before = times_s[starts[-1] if starts else 0 : row]
        later = int(np.sum(before >= times_s[row]))
        if later >= MIN_SESSION_ROWS and _runs_on(times_s, row, -float(steps[row - 1]), least_s):
            starts.append(row)
    found = np.union1d(np.array(starts, dtype=np.int64), known[(known > 0) & (known < len(times_s))])
    return found[_long_enough(found, len(times_s))]


def _runs_on(times_s: FloatArray, row: int, back_s: float, least_s: float) -> bool:
    """Return whether time runs on from a step back, and does not return to where it was."""
    following = np.diff(times_s[row : row + 1000])
    breaks = np.flatnonzero((following <= -least_s) | (following > max(0.5 * back_s, least_s)))
    end = int(breaks[0]) if len(breaks) else len(following)
    if len(breaks) and following[end] > 0.0 and times_s[row + end + 1] >= times_s[row - 1]:
        return False  # rows that came late: time is where it was
    return end + 1 >= MIN_SESSION_ROWS


def _long_enough(starts: IntArray, n: int) -> BoolArray:
    """Return which starts are those of sessions: enough rows before and behind."""
    edges = np.concatenate(([0], starts, [n]))
    lengths = np.diff(edges)
    return np.asarray((lengths[1:] >= MIN_SESSION_ROWS) & (lengths[:-1] >= MIN_SESSION_ROWS))
