"""From raw time stamps to a series: missing, repeated and backward times, and gaps, each handled and noted."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from analysis.series import (
    GAP_FACTOR,
    NORM_TOLERANCE,
    BoolArray,
    FloatArray,
    IntArray,
    OrientationSeries,
    ReaderError,
    SetAside,
)

MAX_SET_ASIDE = 0.5
"""If more than this share of the rows has an impossible time, the time column is not one."""


@dataclass(frozen=True, eq=False)
class RawSamples:
    """What a reader found, before time is looked at. Row k of every array is data row k of the file."""

    quats_wxyz: FloatArray
    """(n, 4) body to world."""
    times_s: FloatArray | None
    """(n,) as found, in any order; None where the file has none."""
    convention: str
    """For people."""
    positions_m: FloatArray | None = None
    """(n, 3)."""
    accelerations_mps2: FloatArray | None = None
    """(n, 3) body frame."""
    notes: tuple[str, ...] = ()
    """What the reader did."""
    warnings: tuple[str, ...] = ()
    """What the reader doubts."""
    assumed_rate_hz: float | None = None
    """Rate of the rig where the file has no time stamps and none is given."""
    index: IntArray | None = None
    """(n,) row numbers where they are not 0 … n−1."""


def to_series(raw: RawSamples, source: str, rate_hz: float | None = None) -> OrientationSeries:
    """Make a series of raw samples; ``rate_hz`` is the sampling rate where the file has no time stamps.

    Rows with a repeated or backward time are set aside (the fewest that must go) and can still be named as end points;
    notes report what was done.

    Raises
    ------
    ReaderError
        No time stamps and no rate; most rows have an impossible time; a quaternion whose norm is not 1.
    """
    n = len(raw.quats_wxyz)
    rows = np.arange(n) if raw.index is None else raw.index
    _check_norms(raw, rows)
    notes = list(raw.notes)
    if raw.times_s is None:
        times_s = _times_from_rate(raw, rate_hz, notes)
    else:
        times_s = raw.times_s
        if rate_hz is not None:
            notes.append(f"the file has time stamps; the rate given ({rate_hz:g} Hz) was not used")
    intervals = np.diff(times_s)
    backward = intervals < 0.0
    # Where time goes backwards, any of the rows around may be the wrong one: the fewest are set aside that leave the
    # rest in order. Where times only repeat, the first of them stays.
    keep = _longest_increasing(times_s) if backward.any() else np.concatenate(([True], intervals > 0.0))[:n]
    lost = int(np.sum(~keep))
    if backward.any():
        first = int(np.argmax(backward)) + 1
        notes.append(
            f"time goes backwards {int(backward.sum())} times, first at row {rows[first]} "
            f"(by {times_s[first - 1] - times_s[first]:.6g} s); {lost} rows set aside"
        )
    elif lost:
        notes.append(f"{lost} rows repeat the time stamp of the row before and were set aside")
    if lost > MAX_SET_ASIDE * n:
        raise ReaderError(f"{lost} of {n} time stamps do not increase; is the time column the right one, and in order?")
    series = OrientationSeries(
        times_s=times_s[keep],
        quats_wxyz=raw.quats_wxyz[keep],
        index=rows[keep],
        positions_m=None if raw.positions_m is None else raw.positions_m[keep],
        accelerations_mps2=None if raw.accelerations_mps2 is None else raw.accelerations_mps2[keep],
        source=source,
        convention=raw.convention,
        notes=tuple(notes),
        warnings=raw.warnings,
        times_measured=raw.times_s is not None,
        set_aside=_set_aside(raw.quats_wxyz[~keep], times_s[~keep], rows[~keep]) if lost else None,
    )
    return series.with_remarks(notes=_gap_notes(series))


def _check_norms(raw: RawSamples, rows: IntArray) -> None:
    with np.errstate(over="ignore"):  # numbers beyond all reason are refused below, without a warning of numpy's
        norms = np.linalg.norm(raw.quats_wxyz, axis=1)
    bad = ~(np.abs(norms - 1.0) <= NORM_TOLERANCE)
    if bad.any():
        first = int(np.argmax(bad))
        raise ReaderError(
            f"row {rows[first]}: the quaternion has norm {norms[first]:.4g}, not 1 ({int(bad.sum())} such rows); "
            "wrong columns, or a sensor that was not ready?"
        )


def _times_from_rate(raw: RawSamples, rate_hz: float | None, notes: list[str]) -> FloatArray:
    rate = rate_hz if rate_hz is not None else raw.assumed_rate_hz
    if rate is None:
        raise ReaderError("the file has no time stamps; give the sampling rate with --rate HZ")
    if not (0.1 <= rate <= 1e5):
        raise ReaderError(f"a sampling rate of {rate:g} Hz makes no sense; 0.1 to 100000 does")
    whence = "as given" if rate_hz is not None else "assumed from the rig; --rate HZ says otherwise"
    notes.append(f"no time stamps in the file: {rate:g} Hz, {whence}")
    return np.arange(len(raw.quats_wxyz)) / rate


def _longest_increasing(times_s: FloatArray) -> BoolArray:
    """Return (n,) a longest strictly increasing subsequence (patience sorting): the fewest rows are lost."""
    tails: list[float] = []  # at k, the lowest time that ends an increasing row of k + 1 of those met so far
    places: list[int] = []  # and where that time stands
    before = np.full(len(times_s), -1)  # the one before each in the longest row that ends with it
    for k, value in enumerate(times_s.tolist()):
        pile = bisect_left(tails, value)
        before[k] = places[pile - 1] if pile else -1
        if pile == len(tails):
            tails.append(value)
            places.append(k)
        else:
            tails[pile] = value
            places[pile] = k
    keep = np.zeros(len(times_s), dtype=bool)
    k = places[-1]
    while k >= 0:
        keep[k] = True
        k = int(before[k])
    return keep


def _set_aside(quats_wxyz: FloatArray, times_s: FloatArray, rows: IntArray) -> SetAside:
    return SetAside(times_s, quats_wxyz / np.linalg.norm(quats_wxyz, axis=1, keepdims=True), rows)


def _gap_notes(series: OrientationSeries) -> tuple[str, ...]:
    """Return a note on where samples are missing."""
    gaps_s = series.gaps()
    if not len(gaps_s):
        return ()
    lengths_s = gaps_s[:, 1] - gaps_s[:, 0]
    longest = int(np.argmax(lengths_s))
    return (
        f"{len(gaps_s)} gaps longer than {GAP_FACTOR:g} times the usual {series.interval_s * 1e3:.3g} ms, longest "
        f"{lengths_s[longest]:.3g} s at {gaps_s[longest, 0] - series.times_s[0]:.3f} s after the first sample",
    )
