"""The result of a recording: the score, what the link lost, and where it all came from.

Capture, replay and ``rotdrift score`` end here, so they cannot differ.
"""

from __future__ import annotations

import contextlib
import dataclasses
from dataclasses import dataclass
from pathlib import Path

from msgspec import UNSET
from msgspec.structs import replace

from analysis.scoring.choice import EndpointChoice
from analysis.scoring.recorded_parts import CaptureAccount
from analysis.scoring.result import Result, result_text
from analysis.scoring.result_parts import ExcludedCycle
from analysis.scoring.trial import score_series
from analysis.series import FloatArray, OrientationSeries
from host.errors import FileError, already_there, reason_of
from host.losses.verdict import judge_losses
from host.recording.load import RecordedTrial
from host.results.parts import events_of, link_of, losses_of, losses_per_cycle, object_of, operator_of
from host.results.window import Window, resolve_window
from host.trial.operator import OperatorEdits, edits_of
from host.version import VERSION

IGNORED = "the operator's trial window and left-out cycles do not count here, as asked"


@dataclass(frozen=True, slots=True)
class ScoreOptions:
    """What a person chose for a score."""

    window: Window | None = None
    """None lets the search decide."""
    endpoints: EndpointChoice | None = None
    baseline: Path | None = None
    """File of the sensor's static baseline."""
    as_published: bool = False
    """Also the benchmark authors' Euler figure."""
    honour_actions: bool = True
    """Whether the operator's trial window and left-out cycles count; end points or a window chosen here go before."""
    excluded: tuple[ExcludedCycle, ...] = ()
    """Cycles left out after the fact, by their numbers; they join those that the operator left out."""
    preceding: tuple[FloatArray, ...] = ()
    """End points (m, 4) of the motions that the authors' script worked through before, for their figure."""
    clock: bool = False
    """Whether the clock's offline pass is part of the result. It may take longer than all the rest, and the score does
    not depend on it: for results that are written or printed as JSON."""


def score_trial(
    trial: RecordedTrial, options: ScoreOptions | None = None, capture: CaptureAccount | None = None
) -> Result:
    """Score a recorded trial; ``capture``, how it ended, is part of the result.

    Raises
    ------
    AnalysisError
        Chosen end points or window do not fit the recording, or the baseline file is not valid.
    UsageError
        The recording has no such marker.
    """
    options = options or ScoreOptions()
    done = edits_of(trial.actions)
    edits = done if options.honour_actions else OperatorEdits()
    honoured = options.window is None and options.endpoints is None and edits.window is not None
    if honoured:
        options = dataclasses.replace(options, window=edits.window)
    elif options.window is not None:
        options = dataclasses.replace(options, window=resolve_window(options.window, trial))
    result = score_plain(trial.series, options, edits.excluded if options.endpoints is None else (), honoured)
    per_cycle = losses_per_cycle(trial, result.endpoint_times_s)
    quality = judge_losses(trial.losses, per_cycle)
    ignored = (IGNORED,) if edits != done else ()
    window = result.window
    return replace(
        result,
        warnings=(*ignored, *quality.reasons, *_trial_warnings(trial), *result.warnings),
        window=replace(window, source="the operator, during the capture") if honoured else window,
        losses=losses_of(trial.losses),
        object=object_of(trial.info),
        link=link_of(trial),
        missing_per_cycle=tuple(cycle.missing for cycle in per_cycle),
        losses_per_cycle=per_cycle,
        quality=quality,
        events=events_of(trial),
        operator=operator_of(trial),
        capture=capture,
        clock=trial.clock if options.clock else UNSET,
    )


def score_plain(
    series: OrientationSeries,
    options: ScoreOptions | None = None,
    excluded: tuple[ExcludedCycle, ...] = (),
    same_extreme: bool = False,
) -> Result:
    """Score a series as the options require; ``excluded`` cycles are kept but not counted.

    With ``same_extreme`` a window stays at the extreme of the whole recording: the one that the live view counted at.
    Raises as :func:`score_trial`.
    """
    options = options or ScoreOptions()
    baseline = None
    if options.baseline is not None:
        from analysis.sensor.baseline_file import load_baseline

        baseline = load_baseline(options.baseline)
    result = score_series(
        series,
        window=None if options.window is None else resolve_window(options.window, None),
        endpoints=options.endpoints,
        baseline=baseline,
        as_published=options.as_published,
        preceding=options.preceding,
        excluded=(*excluded, *options.excluded),
        same_extreme=same_extreme,
    )
    return replace(result, rotdrift_version=VERSION)


def _trial_warnings(trial: RecordedTrial) -> tuple[str, ...]:
    """Return what makes a recorded trial doubtful beyond its motion and its losses."""
    warnings = [*trial.problems, *trial.damage]
    warnings += [
        f"{segment.reason} at {segment.time_s:.1f} s; the orientation before and after may not have the same origin"
        for segment in trial.segments[1:]
    ]
    if trial.info is None and len(trial.series):
        warnings.append("the object never said who it is: no identity and no card are in the result")
    return tuple(warnings)


def write_result(result: Result, path: Path) -> None:
    """Write a result file.

    Raises
    ------
    FileError
        It exists, or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(result_text(result))
    except FileExistsError as error:
        raise already_there(path, "move it away, or give another name with --out") from error
    except OSError as error:
        with contextlib.suppress(OSError):
            path.unlink()
        remedy = "the recording is kept; score it again with `rotdrift score`"
        raise FileError(f"the result {path} cannot be written ({reason_of(error)})", remedy) from error
