"""The offline pass: map a recording's device times to host time with windows centred on each moment.

A live estimate looks back only; with the whole recording at hand the window lies on both sides, which halves the reach
of the line and needs no warm-up. Where segments start, whoever unwrapped the device times has decided.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from host.clock.envelope import DelayLine, Point, envelope_line, hull_line, line_with_slope
from host.clock.estimator import BURSTY_WINDOW_S, WANDER_PPM, WINDOW_S, ClockEstimator
from host.clock.interval import NO_ROUND_TRIPS, OffsetInterval, RoundTrips, offset_interval, unwrapped_round_trips
from host.clock.seconds import SECOND_NS
from host.clock.unwrap import ClockUnwrapper

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

BLOCK_NS = SECOND_NS // 4
"""Steps are measured as if all chunks of so much host time had come with the last of them."""
SHORT_S = 10.0
"""Over less than this the skew of the longest segment is used: a few seconds show no skew."""


@dataclass(frozen=True, slots=True)
class ClockStep:
    """The device clock jumped: a reset, a step, or a host clock that stood still (suspend). A new segment starts."""

    index: int
    """First sample of the new segment."""
    disagreement_us: int
    """Device reading minus the host's prediction of it, modulo the wrap, in [-2**31, 2**31) us."""
    gap_ns: int
    """Host time since the previous chunk, ns."""


@dataclass(frozen=True, slots=True)
class RemappedSegment:
    """One clock segment of a recording."""

    start: int
    """First sample."""
    stop: int
    """One past the last sample."""
    skew_ppm: float
    """Mean rate of the device clock over the host's, minus one; NaN where host time stands still, as no clock does."""
    jitter_p50_ns: float
    """Median of arrival minus mapped time over the chunks' newest samples, ns."""
    jitter_p99_ns: float
    """99th percentile of the same, ns."""
    n_chunks: int
    window_s: float
    """Width of the centred window, s."""
    bursty: bool
    offset_ns: float
    """Host minus device time as mapped, in the middle of the segment, ns."""
    interval: OffsetInterval
    """How far true from mapped time may be, anywhere in the segment."""


@dataclass(frozen=True, slots=True, eq=False)
class RemappedClock:
    """The n samples of a recording on the host's time line."""

    host_time_ns: IntArray
    """(n,) host time at which each sample was taken plus the link's constant delay, ns; continuous in a segment."""
    segment: IntArray
    """(n,) number of each sample's clock segment, from 0."""
    segments: tuple[RemappedSegment, ...]
    """In order."""
    steps: tuple[ClockStep, ...]
    """Steps of the device clock; ``index`` counts samples of the recording. Known starts are not among them."""


def remap(
    device_us: npt.ArrayLike,
    arrival_ns: npt.ArrayLike,
    segment_starts: Collection[int] = (),
    jumps: Collection[int] = (),
    round_trips: RoundTrips = NO_ROUND_TRIPS,
) -> RemappedClock:
    """Map device times to host time by the lower envelope in a centred window.

    Parameters
    ----------
    device_us : (n,) int64
        Device times of the samples, unwrapped, in order of reception, us.
    arrival_ns : (n,) int64
        Host time of each sample's chunk, ns, monotonic; samples of one chunk have the same.
    segment_starts : collection of int
        Samples at which a new clock segment starts for a known cause: another boot id, a reopened port.
    jumps : collection of int
        Samples at which one starts because the device clock jumped: the steps of the result, with the small ones that
        only the envelope shows.
    round_trips : RoundTrips
        Answers to TIME_REQUEST: they bound the offset, and do not change the mapping.

    Raises
    ------
    ValueError
        Shapes differ, or arrival goes backwards.
    """
    unwrapped = np.asarray(device_us, dtype=np.int64)
    arrival = np.asarray(arrival_ns, dtype=np.int64)
    if unwrapped.ndim != 1 or unwrapped.shape != arrival.shape:
        raise ValueError(f"device times {unwrapped.shape} and arrivals {arrival.shape} do not fit together")
    if len(arrival) > 1 and (np.diff(arrival) < 0).any():
        raise ValueError(f"arrival goes backwards at sample {int(np.argmax(np.diff(arrival) < 0)) + 1}")
    n = len(unwrapped)
    known = sorted({start for start in segment_starts if 0 < start < n})
    starts = sorted({*known, *(start for start in jumps if 0 < start < n)})
    chunks = _Chunks.of(unwrapped, arrival, starts)
    small, bursty = _small_steps(chunks, starts)
    steps = sorted([*_measured(unwrapped, arrival, known, starts), *small], key=lambda step: step.index)
    starts = sorted({*starts, *(step.index for step in steps)})
    bounds = [0, *starts, n] if n else [0]
    segment = np.searchsorted(starts, np.arange(n), side="right").astype(np.int64)
    window_s = BURSTY_WINDOW_S if bursty else WINDOW_S
    pieces = [chunks.within(start, stop) for start, stop in pairwise(bounds)]
    slope = _longest_slope(pieces)
    trips, trip_segment = unwrapped_round_trips(round_trips, unwrapped, arrival, segment)
    host_ns = np.empty(n, dtype=np.int64)
    segments = []
    for number, ((start, stop), piece) in enumerate(zip(pairwise(bounds), pieces, strict=True)):
        knots = _knots(piece, slope, window_s)
        host_ns[start:stop] = _mapped(knots, unwrapped[start:stop])
        residual = piece.arrival_ns - _mapped(knots, piece.newest_us)
        p50, p99 = np.percentile(residual, [50, 99]).tolist()
        mean_slope = (knots[-1][1] - knots[0][1]) / (knots[-1][0] - knots[0][0]) if len(knots) > 1 else slope
        middle_us = (knots[0][0] + knots[-1][0]) // 2
        own = trips.chosen(trip_segment == number)
        interval = offset_interval(
            piece.newest_us,
            residual.astype(float),
            own,
            (_mapped(knots, own.receive_us), _mapped(knots, own.transmit_us)),
            window_s,
            # Over the window the line may be off by what the crystal wanders and by what the link usually adds.
            1e-3 * WANDER_PPM + p50 / (1e6 * window_s),
        )
        segments.append(
            RemappedSegment(
                start=start,
                stop=stop,
                skew_ppm=_skew_ppm(mean_slope),
                jitter_p50_ns=p50,
                jitter_p99_ns=p99,
                n_chunks=len(residual),
                window_s=window_s,
                bursty=bursty,
                offset_ns=float(_mapped(knots, np.array([middle_us]))[0] - 1000 * middle_us),
                interval=interval,
            )
        )
    return RemappedClock(host_ns, segment, tuple(segments), tuple(steps))


@dataclass(frozen=True, slots=True, eq=False)
class _Chunks:
    """m chunks, cut where segments start."""

    first: IntArray  # (m,) index of the first sample
    newest_us: IntArray
    span_us: IntArray
    arrival_ns: IntArray

    @classmethod
    def of(cls, unwrapped: IntArray, arrival: IntArray, starts: list[int]) -> _Chunks:
        if not len(unwrapped):
            return cls(*(np.empty(0, np.int64),) * 4)
        first = np.unique([0, *starts, *(np.flatnonzero(np.diff(arrival)) + 1)]).astype(np.int64)
        newest = np.maximum.reduceat(unwrapped, first)
        return cls(first, newest, newest - np.minimum.reduceat(unwrapped, first), arrival[first])

    def within(self, start: int, stop: int) -> _Chunks:
        piece = slice(*np.searchsorted(self.first, [start, stop]))
        return _Chunks(self.first[piece], self.newest_us[piece], self.span_us[piece], self.arrival_ns[piece])


def _measured(unwrapped: IntArray, arrival: IntArray, known: list[int], starts: list[int]) -> list[ClockStep]:
    """Measure the jumps of the device clock, each against what the segment before it predicts, in blocks of host time.

    Blocks end where segments start for a known cause as well.
    """
    steps: list[ClockStep] = []
    if len(starts) == len(known):
        return steps
    blocks = np.unique([0, *known, *(np.flatnonzero(np.diff(arrival // BLOCK_NS)) + 1), len(arrival)])
    for start, index in pairwise([0, *starts]):
        if index in known:
            continue
        unwrapper = ClockUnwrapper()
        whole = blocks[slice(*np.searchsorted(blocks, [start, index], side="right"))]
        for first, last in pairwise([start, *whole.tolist()]):
            unwrapper.unwrap(unwrapped[first:last], int(arrival[last - 1]))
        end_ns = int(arrival[blocks[np.searchsorted(blocks, index, side="right")] - 1])
        if not len(whole):  # the segment before started in this very block: its first sample has to predict
            unwrapper.unwrap(unwrapped[start : start + 1], end_ns)
        disagreement_us, gap_ns = unwrapper.jump(int(unwrapped[index]), end_ns)
        steps.append(ClockStep(index, disagreement_us, gap_ns))
    return steps


def _small_steps(chunks: _Chunks, starts: list[int]) -> tuple[list[ClockStep], bool]:
    """Find the steps that only the causal estimate can see, and whether the link is bursty."""
    estimator = ClockEstimator()
    steps: list[ClockStep] = []
    start_set = set(starts)
    before_ns = bursty = 0
    columns = (chunks.first, chunks.newest_us, chunks.span_us, chunks.arrival_ns)
    for first, newest_us, span_us, arrival_ns in zip(*(column.tolist() for column in columns), strict=True):
        if first in start_set:
            estimator.new_segment()
        moved_ns = estimator.feed(newest_us, arrival_ns, span_us)
        if moved_ns is not None:
            chunk = int(np.searchsorted(chunks.arrival_ns, estimator.segment_start_ns))
            steps.append(ClockStep(int(chunks.first[chunk]), -round(moved_ns / 1000), arrival_ns - before_ns))
        before_ns = arrival_ns
        bursty += 1 if estimator.bursty else -1
    return steps, bursty > 0


def _least_delayed(chunks: _Chunks, slope: float) -> list[Point]:
    """Return the least delayed chunk of every second, in order of device time."""
    delay_ns = chunks.arrival_ns - 1000 * chunks.newest_us
    level_ns = delay_ns - slope * (chunks.newest_us - chunks.newest_us[0])
    order = np.lexsort((level_ns, chunks.arrival_ns // SECOND_NS))
    _, best = np.unique(chunks.arrival_ns[order] // SECOND_NS, return_index=True)
    keep = order[best]
    return sorted(zip(chunks.newest_us[keep].tolist(), delay_ns[keep].tolist(), strict=True))


def _skew_ppm(slope: float) -> float:
    """Return how much faster the device clock runs where delay changes by ``slope`` ns per us of device time."""
    host_ns = 1000.0 + slope  # per us of device time; a damaged recording may claim none at all
    return 1e6 * (1000.0 / host_ns - 1.0) if host_ns > 0.0 else math.nan


def _longest_slope(pieces: list[_Chunks]) -> float:
    """Return the slope of the segment that spans the most device time, ns per us."""
    if not pieces:
        return 0.0
    longest = max(pieces, key=lambda piece: int(piece.newest_us[-1] - piece.newest_us[0]))
    return envelope_line(_least_delayed(longest, 0.0)).slope


def _knots(chunks: _Chunks, slope: float, window_s: float) -> list[tuple[int, float]]:
    """Return device times and the delay there; between them, and beyond, delay is a straight line.

    There is one wherever a sixtieth of the window has passed since the last and a sample came.
    """
    points = _least_delayed(chunks, slope)
    first, last = points[0][0], points[-1][0]
    if last - first < 1e6 * SHORT_S:
        line = line_with_slope(points, slope)
        return [(first, line.delay_at(first)), (last + 1, line.delay_at(last + 1))]
    times = np.array([x for x, _ in points])
    window_us = int(1e6 * window_s)
    spacing_us = window_us // 60
    knots: list[tuple[int, float]] = []
    lines: dict[tuple[int, int], DelayLine] = {}
    for x, _ in points:
        if knots and (x == knots[-1][0] or (x != last and x - knots[-1][0] < spacing_us)):
            continue
        # Near an end the window is the outermost whole one, and its middle line is carried on to the end.
        low = max(first, min(x - window_us // 2, last - window_us))
        high = min(last, low + window_us)
        inside = (int(np.searchsorted(times, low)), int(np.searchsorted(times, high, side="right")))
        if inside not in lines or (low > first and high < last):
            lines[inside] = hull_line(points[inside[0] : inside[1]], (low + high) // 2)
        knots.append((x, lines[inside].delay_at(x)))
    return knots


def _mapped(knots: list[tuple[int, float]], device_us: IntArray) -> IntArray:
    base_ns = round(knots[0][1])  # what is left fits a float
    x = np.array([x for x, _ in knots], dtype=np.int64)
    delay_ns = np.array([delay - base_ns for _, delay in knots])
    within = np.interp((device_us - x[0]).astype(float), (x - x[0]).astype(float), delay_ns)
    if len(knots) > 1:  # np.interp stays level outside; the line goes on
        slopes = np.diff(delay_ns) / np.diff(x)
        within += np.minimum(device_us - x[0], 0) * slopes[0] + np.maximum(device_us - x[-1], 0) * slopes[-1]
    mapped: IntArray = 1000 * device_us + (np.rint(within).astype(np.int64) + base_ns)
    return mapped
