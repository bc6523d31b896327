"""From a recording to the result: cycles, score, trust.

:func:`score_series` is what every command calls, for files, recordings and live trials.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from analysis.cycles.search import CycleAnalysis, Endpoint, Run, find_cycles
from analysis.cycles.settings import AFTER_PAUSE
from analysis.geometry import rotations
from analysis.scoring.card import rotation_drift
from analysis.scoring.choice import EndpointChoice
from analysis.scoring.diagnostics import orientation_at
from analysis.scoring.result import RESULT_FORMAT, Result
from analysis.scoring.result_parts import (
    AutomaticScore,
    CycleSearch,
    ExcludedCycle,
    LeftOutPoint,
    ScoredEndpoint,
    ScoredRun,
    ScoredWindow,
    Settings,
    Source,
    known,
    quaternion_of,
)
from analysis.scoring.trust import with_figures
from analysis.sensor.baseline import StaticBaseline
from analysis.series import LEFT_OUT_LIMIT, FloatArray, OrientationSeries, SeriesError

MIN_CYCLES = 3
"""Fewer cycles are refused. A cycle runs from one end point to the next: 3 cycles are 4 end points and 3 steps."""
_GRASP_RELEASE_NAME = re.compile(r"(?:^|_)GR(?:_|\.|$)")
_GRASP_RELEASE = "grasp-and-release trial (the object is let go and taken up again): no drift can be claimed"


@dataclass(frozen=True, eq=False)
class _Selection:
    """End points to score, and who chose them."""

    endpoints: tuple[ScoredEndpoint, ...]
    other: tuple[ScoredEndpoint, ...]
    window: ScoredWindow
    cycles: CycleAnalysis
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]


def score_series(
    series: OrientationSeries,
    *,
    window: tuple[float | None, float | None] | None = None,
    endpoints: EndpointChoice | Sequence[int] | None = None,
    baseline: StaticBaseline | None = None,
    as_published: bool = False,
    preceding: Sequence[npt.ArrayLike] = (),
    excluded: Sequence[ExcludedCycle] = (),
    same_extreme: bool = False,
) -> Result:
    """Score a recording by the card, with everything a reviewer would ask about it.

    Parameters
    ----------
    series : OrientationSeries
        The recording.
    window : (float or None, float or None), optional
        (from, to): only end points between count, all of them. Seconds since the first sample; what is longer
        than the recording is its own time, e.g. Unix seconds. None in a place leaves that side open.
    endpoints : EndpointChoice or sequence of int, optional
        End points chosen by a person; go before ``window``.
    baseline : StaticBaseline, optional
        The sensor at rest. Without one, rests before and after the motion are used, where there are any.
    as_published : bool, optional
        Also compute the benchmark authors' Euler figure.
    preceding : sequence of array_like, optional
        End points (m, 4) of the motions that the authors' script worked through before this one.
    excluded : sequence of ExcludedCycle, optional
        Cycles that a person left out: the step in which the middle of each lies, or the one of its number where it
        has one, is kept and flagged, but not counted.
    same_extreme : bool, optional
        In a window, stay at the extreme that the search chooses in the whole recording. Without it, the one with more
        end points in the window counts.

    Returns
    -------
    Result
        Never raises for a poor trial: ``valid`` is False and ``reasons`` names why.

    Raises
    ------
    SeriesError
        Chosen end points that are not in the recording, a window outside it, or a left-out cycle of a number that
        there is not.
    """
    if endpoints is None:
        selection = _searched(series, window, same_extreme)
    elif isinstance(endpoints, EndpointChoice):
        selection = _edited(series, endpoints)
    else:
        selection = _edited(series, EndpointChoice("index", tuple(map(float, endpoints))))
    reasons = [*selection.reasons, *(_missed(series) if window is None and endpoints is None else ())]
    points, left_out, not_found = _exclude(selection.endpoints, excluded)
    counted = len(points) - len(left_out)
    if counted <= MIN_CYCLES and not reasons:
        reasons.append(
            f"fewer than {MIN_CYCLES} cycles: {len(points)} end points, {MIN_CYCLES + 1} make {MIN_CYCLES} cycles"
            + (f", and {len(left_out)} cycles are left out" if left_out else "")
        )
    unbroken = [b.time_s - a.time_s for a, b in pairwise(points) if AFTER_PAUSE not in b.flags]
    period_s = float(np.median(unbroken)) if unbroken else selection.cycles.period_s
    result = Result(
        format=RESULT_FORMAT,
        theta_bar_deg=None,
        axis=None,
        n_endpoints=len(points),
        interval_deg=None,
        valid=not reasons,
        reasons=tuple(reasons),
        warnings=(*series.warnings, *selection.warnings, *not_found),
        endpoints=points,
        steps_deg=(),
        flags=tuple(point.flags for point in points),
        period_s=known(period_s),
        other_extreme=None,
        companions=None,
        sensor=None,
        window=selection.window,
        cycles=_cycle_search(selection.cycles),
        losses=None,
        recording=Source(
            source=series.source,
            convention=series.convention,
            n_samples=len(series),
            start_s=float(series.times_s[0]) if len(series) else 0.0,
            duration_s=series.duration_s,
            notes=series.notes,
        ),
        settings=Settings(selection.cycles.settings),
        excluded_cycles=left_out,
    )
    if reasons:
        return result
    return with_figures(result, series, selection.other, baseline, preceding if as_published else None)


def _missed(series: OrientationSeries) -> tuple[str, ...]:
    """Return why a recording of which much was left out is not valid as a whole."""
    share = sum(part.share for part in series.left_out)
    if share <= LEFT_OUT_LIMIT:
        return ()
    parts = "; ".join(part.sentence for part in series.left_out)
    return (f"too much was left out: {parts}; choose what to score with --from and --to, or with --endpoints",)


def _searched(
    series: OrientationSeries, window: tuple[float | None, float | None] | None, same_extreme: bool
) -> _Selection:
    """Return the end points that the search finds, in the whole recording or in a window."""
    own = None if window is None else _own_time(series, window)
    automatic = None if own is None else find_cycles(series)
    # Where the extreme must not change, the window's end points are those like the whole recording's.
    like_s = [point.time_s for point in automatic.endpoints] if same_extreme and automatic is not None else []
    cycles = find_cycles(series, window=own, like_s=like_s)
    points = _scored(cycles.endpoints, series)
    edges = own if own is not None else ((points[0].time_s, points[-1].time_s) if points else (None, None))
    reasons = cycles.reasons
    warnings = cycles.warnings
    if _named_grasp_release(series):
        if not any("no drift can be claimed" in warning for warning in warnings):
            warnings = (*warnings, _GRASP_RELEASE)
        reasons = (*reasons, f"{_GRASP_RELEASE}; choose end points with --endpoints to score it all the same")
    return _Selection(
        endpoints=points,
        other=_scored(cycles.other_endpoints, series),
        window=ScoredWindow(
            kind="automatic" if own is None else "from-to",
            from_s=edges[0],
            to_s=edges[1],
            source="",
            left_out=tuple(LeftOutPoint(item.time_s, item.reason) for item in cycles.left_out if item.primary),
            automatic=None if automatic is None else _automatic_score(automatic, series),
        ),
        cycles=cycles,
        reasons=reasons,
        warnings=warnings,
    )


def _edited(series: OrientationSeries, choice: EndpointChoice) -> _Selection:
    """Return the end points that a person chose, and those of the search beside them."""
    cycles = find_cycles(series)
    points = _chosen(series, choice, cycles.settings.max_gap)
    warnings = [f"the automatic search would not score this: {reason}" for reason in cycles.reasons]
    warnings += [warning for warning in cycles.warnings if warning not in warnings]
    if _named_grasp_release(series):
        warnings.append(_GRASP_RELEASE)
    edges = (points[0].time_s, points[-1].time_s) if points else (None, None)
    inside = [p for p in cycles.other_endpoints if points and points[0].time_s <= p.time_s <= points[-1].time_s]
    return _Selection(
        endpoints=points,
        other=_scored(inside, series),
        window=ScoredWindow(
            kind="endpoints",
            from_s=edges[0],
            to_s=edges[1],
            source=choice.source,
            left_out=(),
            automatic=_automatic_score(cycles, series),
        ),
        cycles=cycles,
        reasons=(),
        warnings=tuple(warnings),
    )


def _exclude(
    points: tuple[ScoredEndpoint, ...], excluded: Sequence[ExcludedCycle]
) -> tuple[tuple[ScoredEndpoint, ...], tuple[ExcludedCycle, ...], list[str]]:
    """Return end points with those of excluded cycles flagged, these cycles with their steps, and warnings."""
    flagged, found, warnings = list(points), {}, []
    for item in excluded:
        step = _numbered(item.step, points) if item.step >= 0 else _step_at(0.5 * (item.from_s + item.to_s), points)
        if step is None:
            warnings.append(f"the cycle left out at {item.to_s:.1f} s is none of those that are scored")
            continue
        if math.isnan(item.from_s):
            item = ExcludedCycle(points[step].time_s, points[step + 1].time_s, item.reason)
        found[step] = replace(item, step=step)
        flagged[step + 1] = replace(
            points[step + 1],
            flags=(*points[step + 1].flags, "left out"),
            reason=item.reason or points[step + 1].reason,
        )
    return tuple(flagged), tuple(found[step] for step in sorted(found)), warnings


def _step_at(middle_s: float, points: tuple[ScoredEndpoint, ...]) -> int | None:
    """Return the step in which a moment lies; None where it lies in none.

    Of a cycle that was left out while it was live the ends have moved a little since; its middle still names it.
    """
    return next((k for k, (a, b) in enumerate(pairwise(points)) if a.time_s <= middle_s < b.time_s), None)


def _numbered(step: int, points: tuple[ScoredEndpoint, ...]) -> int:
    if step < len(points) - 1:
        return step
    there = f"1 to {len(points) - 1}" if len(points) > 1 else "none"
    raise SeriesError(f"there is no cycle {step + 1} to leave out: the cycles of this trial are {there}")


def _own_time(series: OrientationSeries, window: tuple[float | None, float | None]) -> tuple[float, float]:
    if not len(series):
        raise SeriesError("the recording has no samples to take a window of")
    first, last = float(series.times_s[0]), float(series.times_s[-1])
    start = first if window[0] is None else _at(series, window[0])
    end = last if window[1] is None else _at(series, window[1])
    if not (start < end and start <= last and end >= first):
        raise SeriesError(
            f"the window from {start - first:.3f} s to {end - first:.3f} s holds nothing: the recording lasts "
            f"{last - first:.3f} s"
        )
    return start, end


def _at(series: OrientationSeries, value_s: float) -> float:
    """Return a time as given in the recording's own: it is since the first sample unless longer than the recording."""
    first = float(series.times_s[0])
    return value_s if value_s > series.duration_s and value_s >= first else first + value_s


def _chosen(series: OrientationSeries, choice: EndpointChoice, max_gap: float) -> tuple[ScoredEndpoint, ...]:
    if choice.kind != "time_s":
        if choice.kind not in ("index", series.index_kind):
            raise SeriesError(f"this recording names its samples by {series.index_kind}, not by {choice.kind}")
        samples = [series.sample(int(value)) for value in choice.values]
        return tuple(
            _endpoint(series, sample.index, sample.time_s, np.array(sample.quat_wxyz), reason=choice.reason(k))
            for k, sample in enumerate(samples)
        )
    if not len(series):
        raise SeriesError("the recording has no samples to choose end points in")
    points = []
    # A time between samples further apart is refused: interpolating there was wrong by up to 1.66°.
    usual_s = float(np.median(np.diff(choice.values))) if len(choice.values) > 1 else float("inf")
    widest_s = max(max_gap * usual_s, 3.0 * series.interval_s)
    for k, value in enumerate(choice.values):
        time_s = _at(series, value)
        if not series.times_s[0] <= time_s <= series.times_s[-1]:
            raise SeriesError(
                f"end point {k + 1} at {value:g} s is outside the recording (0 to {series.duration_s:g} s)"
            )
        after = int(np.clip(np.searchsorted(series.times_s, time_s), 1, len(series) - 1))
        gap_s = float(series.times_s[after] - series.times_s[after - 1])
        if gap_s > widest_s:
            raise SeriesError(
                f"end point {k + 1} at {value:g} s lies in a gap of {gap_s:.3g} s in the data, where nothing is known; "
                "leave it out or choose a sample by its number"
            )
        nearest = int(np.argmin(np.abs(series.times_s - time_s)))
        quat = orientation_at(series, time_s)
        points.append(_endpoint(series, int(series.index[nearest]), time_s, quat, reason=choice.reason(k)))
    return tuple(points)


def _endpoint(
    series: OrientationSeries,
    index: int,
    time_s: float,
    quat_wxyz: FloatArray,
    flags: tuple[str, ...] = (),
    dwell_s: float | None = None,
    prominence_deg: float | None = None,
    reason: str = "",
) -> ScoredEndpoint:
    return ScoredEndpoint(
        row=index if series.index_kind == "row" else None,
        sequence=index if series.index_kind == "sequence" else None,
        time_s=time_s,
        quat_wxyz=quaternion_of(quat_wxyz),
        flags=flags,
        dwell_s=dwell_s,
        prominence_deg=prominence_deg,
        reason=reason,
    )


def _scored(points: Sequence[Endpoint], series: OrientationSeries) -> tuple[ScoredEndpoint, ...]:
    return tuple(
        _endpoint(series, p.index, p.time_s, p.quat_wxyz, p.flags, p.dwell_s, p.prominence_deg) for p in points
    )


def _cycle_search(found: CycleAnalysis) -> CycleSearch:
    return CycleSearch(
        period_confidence=known(found.period_confidence),
        axis=tuple(map(known, found.axis.tolist())),
        axis_share=known(found.axis_share),
        swing_deg=known(found.swing_deg),
        humps=found.peaks_per_cycle,
        likeness=known(found.likeness),
        irregularity=known(found.irregularity),
        active_s=found.active_s,
        runs=tuple(map(_run, found.runs)),
    )


def _run(run: Run) -> ScoredRun:
    quats = [point.quat_wxyz for point in run.endpoints]
    return ScoredRun(
        from_s=run.start_s,
        to_s=run.end_s,
        n_endpoints=len(quats),
        net_rotation_deg=float(np.degrees(rotations.distance(quats[-1], quats[0]))),
        theta_bar_deg=rotation_drift(quats).theta_bar_deg if len(quats) >= 2 else None,
        scored=run.scored,
    )


def _named_grasp_release(series: OrientationSeries) -> bool:
    return bool(_GRASP_RELEASE_NAME.search(Path(series.source).name))


def _automatic_score(cycles: CycleAnalysis, series: OrientationSeries) -> AutomaticScore:
    points = cycles.endpoints
    few = (f"fewer than {MIN_CYCLES} cycles: {len(points)} end points",) if len(points) <= MIN_CYCLES else ()
    named = (_GRASP_RELEASE,) if _named_grasp_release(series) else ()
    reasons = (*cycles.reasons, *(() if cycles.reasons else few), *named)
    theta = None if reasons else rotation_drift([point.quat_wxyz for point in points]).theta_bar_deg
    return AutomaticScore(not reasons, theta, len(points), tuple(point.index for point in points), reasons)
