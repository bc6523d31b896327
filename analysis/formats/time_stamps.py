"""From raw time stamps to a series: missing, repeated and backward times, and gaps, each handled and noted."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from analysis.formats.rows.clocks import session_starts, unwrapped
from analysis.formats.rows.left_out import left_out_holes, left_out_times
from analysis.formats.rows.streams import (
    LabelArray,
    SeveralStreamsError,
    StreamChoice,
    alternating_deg,
    chosen,
    counted,
)
from analysis.formats.source import plain
from analysis.geometry import rotations
from analysis.series import (
    GAP_FACTOR,
    LEFT_OUT_WARNING,
    NORM_TOLERANCE,
    BoolArray,
    FloatArray,
    IntArray,
    OrientationSeries,
    ReaderError,
    SetAside,
)

MAX_TIME_S = 1e15
"""Beyond any date since 1970, even in milliseconds: nanoseconds that are taken for seconds, or a counter."""
MAX_SET_ASIDE = 0.5
"""If more than this share of the rows has an impossible time, the time column is not one."""

MAX_ALTERNATING_ROWS = 20_000
"""Rows looked at for two streams in one."""


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
    labels: LabelArray | None = None
    """(n,) which sensor each row is of, where there are several; empty for a row of none."""
    label_kind: str = "sensor"
    """What the labels name: ``sensor`` or ``channel``."""
    starts: IntArray | None = None
    """Places in these arrays at which the source shows a new session."""
    stated_rate_hz: float | None = None
    """Rate that the file states beside its rows."""
    received_s: FloatArray | None = None
    """(n,) when each row was received, where that is known besides its own time."""

    def part(self, rows: IntArray | BoolArray) -> RawSamples:
        """Return some of the rows; they keep their numbers."""
        index = np.arange(len(self.quats_wxyz)) if self.index is None else self.index
        places = np.arange(len(index))[rows]

        def of(values: FloatArray | None) -> FloatArray | None:
            return None if values is None else values[places]

        return replace(
            self,
            quats_wxyz=self.quats_wxyz[places],
            times_s=of(self.times_s),
            positions_m=of(self.positions_m),
            accelerations_mps2=of(self.accelerations_mps2),
            received_s=of(self.received_s),
            index=index[places],
            labels=None if self.labels is None else self.labels[places],
            starts=None if self.starts is None else np.searchsorted(places, self.starts),
        )


def to_series(
    raw: RawSamples, source: str, rate_hz: float | None = None, choice: StreamChoice | None = None
) -> OrientationSeries:
    """Make a series of raw samples; ``rate_hz`` is the sampling rate where the file has no time stamps.

    Rows without an orientation are left out. Rows with a repeated or backward time are set aside (the fewest that must
    go) and can still be named as end points; notes report what was done, and :attr:`OrientationSeries.left_out` how
    much of the trial that is.

    Raises
    ------
    SeveralStreamsError
        Several sensors or sessions, and no choice.
    ReaderError
        No time stamps and no rate; most rows have an impossible time; a quaternion whose norm is not 1; rows of two
        sensors that nothing tells apart.
    """
    choice = choice or StreamChoice()
    raw = _one_stream(raw, choice)
    notes = list(raw.notes)
    if raw.times_s is None:
        raw = replace(raw, times_s=_times_from_rate(raw, rate_hz, notes))
        measured = False
    else:
        measured = True
        if rate_hz is not None:
            notes.append(f"the file has time stamps; the rate given ({rate_hz:g} Hz) was not used")
    assert raw.times_s is not None
    whole = np.isfinite(raw.quats_wxyz).all(axis=1) & np.isfinite(raw.times_s)
    holes_s = raw.times_s[~whole]
    n_rows = len(whole)
    if not whole.all():
        raw = raw.part(whole)
        if not len(raw.quats_wxyz):
            raise ReaderError("no row holds both a time and an orientation: are the columns the right ones?")
    assert raw.times_s is not None
    _check_times(raw.times_s, np.arange(len(raw.times_s)) if raw.index is None else raw.index)
    raw = _one_session(raw, choice, notes)
    times_s, n = raw.times_s, len(raw.quats_wxyz)
    assert times_s is not None
    assert raw.index is not None or whole.all()
    rows = np.arange(n) if raw.index is None else raw.index
    _check_norms(raw, rows)
    _check_alternation(raw.quats_wxyz)
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
    left_out = (
        *left_out_holes(times_s[keep], holes_s, n_rows),
        *left_out_times(times_s, raw.quats_wxyz, keep),
    )
    series = OrientationSeries(
        times_s=times_s[keep],
        quats_wxyz=raw.quats_wxyz[keep],
        index=rows[keep],
        positions_m=None if raw.positions_m is None else raw.positions_m[keep],
        accelerations_mps2=None if raw.accelerations_mps2 is None else raw.accelerations_mps2[keep],
        source=source,
        convention=raw.convention,
        notes=tuple(notes),
        warnings=(*raw.warnings, *(part.sentence for part in left_out if part.share > LEFT_OUT_WARNING)),
        times_measured=measured,
        set_aside=_set_aside(raw.quats_wxyz[~keep], times_s[~keep], rows[~keep]) if lost else None,
        left_out=left_out,
    )
    small = tuple(part.sentence for part in left_out if part.share <= LEFT_OUT_WARNING and part.holes)
    return series.with_remarks(notes=(*small, *_gap_notes(series)))


def _one_stream(raw: RawSamples, choice: StreamChoice) -> RawSamples:
    """Return the rows of one sensor."""
    if raw.labels is None:
        return raw
    names = list(dict.fromkeys(raw.labels[raw.labels != ""].tolist()))
    wanted = choice.channel if raw.label_kind == "channel" else choice.sensor
    name = chosen(raw.label_kind, sorted(names, key=_by_number), wanted)
    note = (
        () if len(names) == 1 else (f"{counted(raw.label_kind, sorted(names, key=_by_number))}; {plain(name)} is read",)
    )
    return replace(raw.part(raw.labels == name), labels=None, notes=(*raw.notes, *note))


def _by_number(name: str) -> tuple[float, str]:
    try:
        return float(name), name
    except ValueError:
        return float("inf"), name


def _one_session(raw: RawSamples, choice: StreamChoice, notes: list[str]) -> RawSamples:
    """Return the rows of one session, its clock unwrapped; a clock that starts again is put together by reception."""
    assert raw.times_s is not None
    if raw.received_s is not None and (np.diff(raw.times_s) < 0.0).any():
        raw = _by_reception(raw, notes)
    assert raw.times_s is not None
    clock = unwrapped(raw.times_s)
    if clock.note:
        notes.append(clock.note)
        raw = replace(raw, times_s=clock.times_s)
    assert raw.times_s is not None
    known = np.empty(0, dtype=np.int64) if raw.starts is None else raw.starts
    starts = session_starts(raw.times_s, known)
    n_sessions = len(starts) + 1
    if choice.session is not None and not 1 <= choice.session <= n_sessions:
        raise ReaderError(f"no session {choice.session}; there are {n_sessions}")
    if n_sessions == 1:
        return raw
    edges = [0, *starts.tolist(), len(raw.times_s)]
    rows = np.arange(len(raw.times_s)) if raw.index is None else raw.index
    listed = [f"{k + 1} (rows {rows[a]} to {rows[b - 1]})" for k, (a, b) in enumerate(pairwise(edges))]
    if choice.session is None:
        raise SeveralStreamsError(
            f"{counted('session', listed)}; choose with --session 1", "session", [str(k + 1) for k in range(n_sessions)]
        )
    k = choice.session - 1
    notes.append(f"{counted('session', listed)}; session {choice.session} is read")
    return raw.part(np.arange(edges[k], edges[k + 1]))


def _by_reception(raw: RawSamples, notes: list[str]) -> RawSamples:
    """Return rows whose device clock started again with times that go on: as much later as they were received."""
    assert raw.times_s is not None
    assert raw.received_s is not None
    starts = session_starts(unwrapped(raw.times_s).times_s, np.empty(0, dtype=np.int64), 0.0)
    if not len(starts) or (np.diff(raw.received_s) < 0.0).any():
        return raw
    times_s = raw.times_s.copy()
    for row in starts.tolist():
        apart_s = float(raw.received_s[row] - raw.received_s[row - 1])
        times_s[row:] += times_s[row - 1] + apart_s - times_s[row]
    many = "once" if len(starts) == 1 else f"{len(starts)} times"
    first = int(starts[0]) if raw.index is None else int(raw.index[starts[0]])
    notes.append(
        f"the device's clock starts again {many}, first at row {first}; put together by the times of reception"
    )
    return replace(raw, times_s=times_s)


def _check_alternation(quats_wxyz: FloatArray) -> None:
    """Refuse rows that go to and fro between two orientations: those of two sensors that nothing tells apart."""
    quats = quats_wxyz[:MAX_ALTERNATING_ROWS]
    if len(quats) < 3:
        return
    apart = alternating_deg(
        np.degrees(rotations.distance(quats[1:], quats[:-1])), np.degrees(rotations.distance(quats[2:], quats[:-2]))
    )
    if apart is not None:
        raise ReaderError(
            f"the rows alternate between two orientations {apart:.3g}° apart: two sensors or two publishers in one "
            "stream, which nothing tells apart; record them apart, or add a column with the sensor's number"
        )


def _check_times(times_s: FloatArray, rows: IntArray) -> None:
    """Refuse times that no clock has: what is worked out of them would overflow, or fill the memory."""
    bad = ~(np.abs(times_s) <= MAX_TIME_S)
    if bad.any():
        first = int(np.argmax(bad))
        raise ReaderError(
            f"row {rows[first]}: a time of {times_s[first]:.4g} s ({int(bad.sum())} such rows); is the time column the "
            "right one, and in the right unit?"
        )


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
    rates = (rate_hz, raw.assumed_rate_hz, raw.stated_rate_hz)
    rate = next((value for value in rates if value is not None), None)
    if rate is None:
        raise ReaderError("the file has no time stamps; give the sampling rate with --rate HZ")
    if not (0.1 <= rate <= 1e5):
        raise ReaderError(f"a sampling rate of {rate:g} Hz makes no sense; 0.1 to 100000 does")
    whence = "as given" if rate_hz is not None else "assumed from the rig; --rate HZ says otherwise"
    if rate_hz is None and raw.assumed_rate_hz is None:
        whence = "as its heading states"
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
