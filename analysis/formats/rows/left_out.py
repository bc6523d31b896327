"""How much of a trial the rows are that a reader leaves out: one account for every reader."""

from __future__ import annotations

import numpy as np

from analysis.geometry import rotations
from analysis.series import BoolArray, FloatArray, LeftOut

SAME_DEG = 0.1
"""A row that repeats time and orientation of the row before, within this, is delivered twice: nothing is lost."""


def left_out_holes(times_s: FloatArray, holes_s: FloatArray, rows: int) -> tuple[LeftOut, ...]:
    """Return the account of rows without an orientation.

    A row between others costs nothing where these are as close as usual: a table of several topics has an empty row
    for each message of another topic. What counts is the time that the object is not seen.

    Parameters
    ----------
    times_s : array of float
        (n,) of the rows kept, increasing.
    holes_s : array of float
        (k,) of the rows left out; NaN where a row has no time either.
    rows : int
        All rows.
    """
    if not len(holes_s):
        return ()
    count = len(holes_s)
    known_s = holes_s[np.isfinite(holes_s)]
    if len(times_s) < 2:
        return (LeftOut(count, rows, count / rows, "have no orientation", holes=True),)
    steps_s = np.diff(times_s)
    usual_s = float(np.median(steps_s))
    after = np.unique(np.searchsorted(times_s, known_s))
    inside = after[(after > 0) & (after < len(times_s))]
    missed_s = float(np.maximum(steps_s[inside - 1] - usual_s, 0.0).sum())
    start_s = min(float(times_s[0]), float(known_s.min(initial=times_s[0])))
    end_s = max(float(times_s[-1]), float(known_s.max(initial=times_s[-1])))
    missed_s += (times_s[0] - start_s) + (end_s - times_s[-1])
    share = float(missed_s / (end_s - start_s))
    return (LeftOut(count, rows, max(share, (count - len(known_s)) / rows), "have no orientation", holes=True),)


def left_out_times(times_s: FloatArray, quats_wxyz: FloatArray, keep: BoolArray) -> tuple[LeftOut, ...]:
    """Return the account of rows set aside for their times; those delivered twice count for nothing.

    Parameters
    ----------
    times_s : array of float
        (n,) as found.
    quats_wxyz : array of float
        (n, 4).
    keep : array of bool
        (n,) which rows are kept.
    """
    lost = np.flatnonzero(~keep)
    lost = lost[lost > 0] if len(lost) < len(keep) else lost
    if not len(lost):
        return ()
    before = np.maximum(lost - 1, 0)
    twice = times_s[lost] == times_s[before]
    twice &= np.degrees(rotations.distance(quats_wxyz[lost], quats_wxyz[before])) <= SAME_DEG
    count = int(np.sum(~keep)) - int(np.sum(twice))
    if not count:
        return ()
    return (LeftOut(count, len(keep), count / len(keep), "have a time that does not increase"),)
