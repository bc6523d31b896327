"""From a recording to the result: cycles, score, trust.

:func:`score_series` is what every command calls, for files, recordings and live trials alike.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from analysis.cycles.search import CycleAnalysis, CycleSettings, Endpoint, find_cycles
from analysis.scoring.card import rotation_drift
from analysis.scoring.choice import EndpointChoice, as_choice
from analysis.scoring.diagnostics import orientation_at
from analysis.scoring.score_parts import AutomaticScore, ExcludedCycle, ScoredEndpoint, Window
from analysis.scoring.trial_score import TrialScore
from analysis.scoring.trust import endpoint_quats, with_figures
from analysis.sensor.baseline import StaticBaseline
from analysis.series import OrientationSeries, SeriesError

MIN_CYCLES = 3
"""Fewer cycles are refused. A cycle runs from one end point to the next: 3 cycles are 4 end points and 3 steps."""
MAX_GAP = 0.05
"""A chosen time between samples further apart than this is refused, periods: interpolating was wrong by up to 1.66°."""
_GRASP_RELEASE_NAME = re.compile(r"(?:^|_)GR(?:_|\.|$)")
_GRASP_RELEASE = "grasp-and-release trial (the object is let go and taken up again): no drift can be claimed"


@dataclass(frozen=True, eq=False)
class _Selection:
    """End points to score, and who chose them."""

    endpoints: tuple[ScoredEndpoint, ...]
    other: tuple[ScoredEndpoint, ...]
    window: Window
    cycles: CycleAnalysis
    automatic: CycleAnalysis | None  # the automatic search, where another window was used
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]


def score_series(
    series: OrientationSeries,
    *,
    window: tuple[float | None, float | None] | None = None,
    endpoints: EndpointChoice | Sequence[int] | None = None,
    baseline: StaticBaseline | None = None,
    settings: CycleSettings | None = None,
    losses: Mapping[str, int | float] | None = None,
    as_published: bool = False,
    preceding: Sequence[npt.ArrayLike] = (),
    excluded: Sequence[ExcludedCycle] = (),
    same_extreme: bool = False,
) -> TrialScore:
    """Score a recording by the card, with everything a reviewer would ask about it.

    Parameters
    ----------
    series
        The recording.
    window
        (from, to): only end points between are taken, all of them. Seconds since the first sample; what is longer
        than the recording is its own time, e.g. Unix seconds. None in a place leaves that side open.
    endpoints
        End points chosen by a person; go before ``window``.
    baseline
        The sensor at rest. Without one, rests before and after the motion are used, where there are any.
    settings
        Numbers of the search for cycles.
    losses
        What the link lost, for the result.
    as_published
        Also compute the benchmark authors' Euler figure.
    preceding
        End points (m, 4) of the motions that the authors' script worked through before this one.
    excluded
        Cycles that a person left out: the step in which the middle of each lies is kept and flagged, but not counted.
    same_extreme
        In a window, stay at the extreme that the search takes in the whole recording. Without it the one with more end
        points in the window is taken.

    Returns
    -------
    TrialScore
        Never raises for a poor trial: ``valid`` is False and ``reasons`` say why.

    Raises
    ------
    SeriesError
        Chosen end points that are not in the recording, or a window outside it.
    """
    chosen = settings if settings is not None else CycleSettings()
    if endpoints is not None:
        selection = _edited(series, as_choice(endpoints, series.index_kind), chosen)
    else:
        selection = _searched(series, window, chosen, same_extreme)
    points = selection.endpoints
    reasons = list(selection.reasons)
    points, left_out, not_found = _exclude(points, excluded)
    counted = len(points) - len(left_out)
    if counted <= MIN_CYCLES and not reasons:
        reasons.append(
            f"fewer than {MIN_CYCLES} cycles: {len(points)} end points, {MIN_CYCLES + 1} make {MIN_CYCLES} cycles"
            + (f", and {len(left_out)} cycles are left out" if left_out else "")
        )
    times_s = np.array([point.time_s for point in points])
    period_s = float(np.median(np.diff(times_s))) if len(points) > 1 else selection.cycles.period_s
    score = TrialScore(
        valid=not reasons,
        reasons=tuple(reasons),
        warnings=(*series.warnings, *selection.warnings, *not_found),
        notes=series.notes,
        endpoints=points,
        excluded=left_out,
        index_kind=series.index_kind,
        period_s=period_s if np.isfinite(period_s) else None,
        cycles=selection.cycles,
        window=selection.window,
        automatic=None if selection.automatic is None else _automatic_score(selection.automatic, series),
        losses=losses,
        start_s=float(series.times_s[0]) if len(series) else 0.0,
        duration_s=series.duration_s,
        n_samples=len(series),
        source=series.source,
        convention=series.convention,
    )
    if reasons:
        return score
    return with_figures(score, series, selection.other, baseline, (as_published, preceding))


def _searched(
    series: OrientationSeries,
    window: tuple[float | None, float | None] | None,
    settings: CycleSettings,
    same_extreme: bool,
) -> _Selection:
    """Take the end points that the search finds, in the whole recording or in a window."""
    own = None if window is None else _own_time(series, window)
    automatic = None if own is None else find_cycles(series, settings)
    like_s = [point.time_s for point in automatic.endpoints] if same_extreme and automatic is not None else []
    cycles = find_cycles(series, settings, own, like_s)
    points = tuple(_scored(point) for point in cycles.endpoints)
    edges = own if own is not None else ((points[0].time_s, points[-1].time_s) if points else (None, None))
    reasons = cycles.reasons
    warnings = cycles.warnings
    if _named_grasp_release(series):
        if not any("no drift can be claimed" in warning for warning in warnings):
            warnings = (*warnings, _GRASP_RELEASE)
        reasons = (*reasons, f"{_GRASP_RELEASE}; choose end points with --endpoints to score it all the same")
    return _Selection(
        endpoints=points,
        other=tuple(_scored(point) for point in cycles.other_endpoints),
        window=Window(
            kind="automatic" if own is None else "from-to",
            from_s=edges[0],
            to_s=edges[1],
            left_out=tuple((item.time_s, item.reason) for item in cycles.left_out if item.primary),
        ),
        cycles=cycles,
        automatic=automatic,
        reasons=reasons,
        warnings=warnings,
    )


def _edited(series: OrientationSeries, choice: EndpointChoice, settings: CycleSettings) -> _Selection:
    """Take the end points that a person chose; the search only stands beside them."""
    cycles = find_cycles(series, settings)
    points = _chosen(series, choice)
    warnings = [f"the automatic search would not score this: {reason}" for reason in cycles.reasons]
    warnings += [warning for warning in cycles.warnings if warning not in warnings]
    if _named_grasp_release(series):
        warnings.append(_GRASP_RELEASE)
    edges = (points[0].time_s, points[-1].time_s) if points else (None, None)
    other = tuple(
        _scored(point)
        for point in cycles.other_endpoints
        if edges[0] is not None and edges[1] is not None and edges[0] <= point.time_s <= edges[1]
    )
    return _Selection(
        endpoints=points,
        other=other,
        window=Window(kind="endpoints", from_s=edges[0], to_s=edges[1], source=choice.source),
        cycles=cycles,
        automatic=cycles,
        reasons=(),
        warnings=tuple(warnings),
    )


def _exclude(
    points: tuple[ScoredEndpoint, ...], excluded: Sequence[ExcludedCycle]
) -> tuple[tuple[ScoredEndpoint, ...], tuple[ExcludedCycle, ...], list[str]]:
    """Find the steps of excluded cycles; flag the end points that close them."""
    flagged, found, warnings = list(points), {}, []
    for item in excluded:
        middle_s = 0.5 * (item.from_s + item.to_s)
        step = next((k for k, (a, b) in enumerate(pairwise(points)) if a.time_s <= middle_s < b.time_s), None)
        if step is None:
            warnings.append(f"the cycle left out at {item.to_s:.1f} s is none of those that are scored")
            continue
        found[step] = replace(item, step=step)
        flagged[step + 1] = replace(
            points[step + 1],
            flags=(*points[step + 1].flags, "left out"),
            reason=item.reason or points[step + 1].reason,
        )
    return tuple(flagged), tuple(found[step] for step in sorted(found)), warnings


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
    """Turn a time as given into the recording's own: it is since the first sample unless longer than the recording."""
    first = float(series.times_s[0])
    return value_s if value_s > series.duration_s and value_s >= first else first + value_s


def _chosen(series: OrientationSeries, choice: EndpointChoice) -> tuple[ScoredEndpoint, ...]:
    if choice.kind != "time_s":
        if choice.kind not in ("index", series.index_kind):
            raise SeriesError(f"this recording names its samples by {series.index_kind}, not by {choice.kind}")
        samples = [series.sample(int(value)) for value in choice.values]
        return tuple(
            ScoredEndpoint(sample.time_s, sample.index, np.array(sample.quat_wxyz), reason=choice.reason(k))
            for k, sample in enumerate(samples)
        )
    points = []
    usual_s = float(np.median(np.diff(choice.values))) if len(choice.values) > 1 else float("inf")
    widest_s = max(MAX_GAP * usual_s, 3.0 * series.interval_s)
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
        points.append(ScoredEndpoint(time_s, int(series.index[nearest]), quat, reason=choice.reason(k)))
    return tuple(points)


def _scored(point: Endpoint) -> ScoredEndpoint:
    return ScoredEndpoint(
        time_s=point.time_s,
        index=point.index,
        quat_wxyz=point.quat_wxyz,
        flags=point.flags,
        dwell_s=point.dwell_s,
        prominence_deg=point.prominence_deg,
    )


def _named_grasp_release(series: OrientationSeries) -> bool:
    return bool(_GRASP_RELEASE_NAME.search(Path(series.source).name))


def _automatic_score(cycles: CycleAnalysis, series: OrientationSeries) -> AutomaticScore:
    points = cycles.endpoints
    few = (f"fewer than {MIN_CYCLES} cycles: {len(points)} end points",) if len(points) <= MIN_CYCLES else ()
    named = (_GRASP_RELEASE,) if _named_grasp_release(series) else ()
    reasons = (*cycles.reasons, *(() if cycles.reasons else few), *named)
    theta = None if reasons else rotation_drift(endpoint_quats(points)).theta_bar_deg
    return AutomaticScore(not reasons, theta, len(points), tuple(point.index for point in points), reasons)
