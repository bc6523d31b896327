"""The result of a recording: the score, what the link lost, and where it all came from.

Capture, replay and ``rotdrift score`` end here, so they cannot differ.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import json
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from analysis.scoring.choice import EndpointChoice
from analysis.scoring.plain_json import finite
from analysis.scoring.score_parts import ExcludedCycle
from analysis.scoring.trial import score_series
from analysis.scoring.trial_score import TrialScore
from analysis.series import FloatArray, OrientationSeries
from firmware_protocol.packets import Info
from host.errors import FileError
from host.losses.runs import missing_between
from host.losses.verdict import CycleLosses, judge_losses
from host.recording.load import RecordedTrial
from host.results.late_values import LateValues
from host.text import plain
from host.trial.operator import OperatorEdits, edits_of
from host.version import VERSION

IGNORED = "the operator's trial window and left-out cycles do not count here, as asked"


@dataclass(frozen=True, slots=True)
class ScoreOptions:
    """What a person chose for a score."""

    window: tuple[float | None, float | None] | None = None
    """(from, to), s; None lets the search decide."""
    endpoints: EndpointChoice | None = None
    """End points chosen by hand."""
    baseline: Path | None = None
    """File of the sensor's static baseline."""
    as_published: bool = False
    """Also the benchmark authors' Euler figure."""
    honour_actions: bool = True
    """Whether the operator's trial window and left-out cycles count; end points or a window chosen here go before."""
    preceding: tuple[FloatArray, ...] = ()
    """End points (m, 4) of the motions that the authors' script worked through before, for their figure."""


def score_trial(
    trial: RecordedTrial, options: ScoreOptions | None = None, capture: dict[str, Any] | None = None
) -> TrialScore:
    """Score a recorded trial.

    Parameters
    ----------
    trial : RecordedTrial
        From :func:`host.recording.load.load_trial`.
    options : ScoreOptions, optional
        What a person chose.
    capture : dict, optional
        How the capture ended; part of the result.

    Raises
    ------
    AnalysisError
        Chosen end points or window do not fit the recording, or the baseline file is none.
    """
    options = options or ScoreOptions()
    done = edits_of(trial.actions)
    edits = done if options.honour_actions else OperatorEdits()
    honoured = options.window is None and options.endpoints is None and edits.window is not None
    if honoured:
        options = replace(options, window=edits.window)
    score = score_plain(
        trial.series, options, trial.losses.to_json(), edits.excluded if options.endpoints is None else (), honoured
    )
    if honoured:
        score = replace(score, window=replace(score.window, source="the operator, during the capture"))
    per_cycle = losses_per_cycle(trial, [point.time_s for point in score.endpoints])
    missing = [cycle.missing for cycle in per_cycle]
    verdict = judge_losses(trial.losses, missing, [cycle.produced for cycle in per_cycle])
    extra: dict[str, Any] = {
        **score.extra,
        "object": describe_object(trial.info),
        "link": {
            "uri": None if trial.header is None else trial.header.link,
            "crc_errors": trial.counters.crc_errors,
            "malformed": trial.counters.malformed,
            "unknown_types": trial.counters.unknown_types,
            "skipped_bytes": trial.counters.skipped_bytes,
            "resets": max(0, len(trial.segments) - 1),
            "reconnects": trial.reconnects,
        },
        "missing_per_cycle": missing,
        "losses_per_cycle": [cycle.to_json() for cycle in per_cycle],
        "quality": verdict.to_json(),
        "events": [dataclasses.asdict(event) for event in trial.events],
        "operator": [dataclasses.asdict(action) for action in trial.actions],
        "rotdrift_version": VERSION,
    }
    if capture is not None:
        extra["capture"] = capture
    ignored = (IGNORED,) if edits != done else ()
    warnings = (*ignored, *verdict.reasons, *trial_warnings(trial), *score.warnings)
    # The clock's offline pass may take longer than all the rest, and the score does not depend on it.
    late = LateValues(finite_mapping(extra), "clock", lambda: finite(trial.clock))
    return replace(score, warnings=warnings, extra=late)


def score_plain(
    series: OrientationSeries,
    options: ScoreOptions | None = None,
    losses: dict[str, Any] | None = None,
    excluded: tuple[ExcludedCycle, ...] = (),
    same_extreme: bool = False,
) -> TrialScore:
    """Score a series as the options say; ``excluded`` cycles are kept but not counted.

    With ``same_extreme`` a window stays at the extreme of the whole recording: the one that the live view counted at.

    Raises
    ------
    AnalysisError
        As :func:`score_trial`.
    """
    options = options or ScoreOptions()
    baseline = None
    if options.baseline is not None:
        from analysis.sensor.baseline_file import load_baseline

        baseline = load_baseline(options.baseline)
    score = score_series(
        series,
        window=options.window,
        endpoints=options.endpoints,
        baseline=baseline,
        losses=losses,
        as_published=options.as_published,
        preceding=options.preceding,
        excluded=excluded,
        same_extreme=same_extreme,
    )
    return replace(score, extra={**score.extra, "rotdrift_version": VERSION})


def trial_warnings(trial: RecordedTrial) -> tuple[str, ...]:
    """Say what makes a recorded trial doubtful beyond its motion and its losses."""
    warnings = [*trial.problems, *trial.damage]
    warnings += [
        f"{segment.reason} at {segment.time_s:.1f} s; the orientation before and after may not have the same origin"
        for segment in trial.segments[1:]
    ]
    if trial.info is None and len(trial.series):
        warnings.append("the object never said who it is: no identity and no card are in the result")
    return tuple(warnings)


def losses_per_cycle(trial: RecordedTrial, endpoint_times_s: list[float]) -> list[CycleLosses]:
    """Give the account of the samples between neighbouring end points; each cycle begins with its end point's sample.

    Parameters
    ----------
    trial : RecordedTrial
        Whose samples have numbers.
    endpoint_times_s : list of float
        n end points, s.

    Returns
    -------
    list of CycleLosses
        n − 1 of them.
    """
    series = trial.series
    if len(endpoint_times_s) < 2 or series.index_kind != "sequence":
        return []
    at = np.searchsorted(series.times_s, endpoint_times_s).clip(0, len(series) - 1)
    bounds = series.index[at].tolist()
    return [
        CycleLosses(after - before, gone.missing, gone.rejected, gone.dropped)
        for (before, after), gone in zip(pairwise(bounds), missing_between(trial.missing, bounds), strict=True)
    ]


def describe_object(info: Info | None) -> dict[str, Any] | None:
    """Turn INFO into plain values: hexadecimal id, names of enums, safe texts."""
    if info is None:
        return None
    values = _plain_values(dataclasses.asdict(info))
    assert isinstance(values, dict)
    return {**values, "device_id": f"{info.device_id:016x}"}


def _plain_values(value: object) -> object:
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if isinstance(value, dict):
        return {key: _plain_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain_values(item) for item in value]
    return plain(value) if isinstance(value, str) else value


def finite_mapping(values: dict[str, Any]) -> dict[str, Any]:
    """Make values plain JSON."""
    plain_values = finite(values)
    assert isinstance(plain_values, dict)
    return dict(plain_values)


def result_text(score: TrialScore) -> str:
    """Write a result as JSON, readable and strict."""
    return json.dumps(score.to_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def write_result(score: TrialScore, path: Path) -> None:
    """Write a result file.

    Raises
    ------
    FileError
        It exists, or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(result_text(score))
    except FileExistsError as error:
        raise FileError(f"{path} exists already", "move it away, or give another name with --out") from error
    except OSError as error:
        with contextlib.suppress(OSError):
            path.unlink()
        raise FileError(
            f"the result {path} cannot be written ({(error.strerror or str(error)).lower()})",
            "the recording is kept; score it again with `rotdrift score`",
        ) from error
