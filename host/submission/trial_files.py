"""One trial of a submission: its recording scored again, its files, and its entry in ``submission.json``."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.formats.named_csv import csv_text, endpoints_csv_text
from analysis.formats.parquet import parquet_bytes
from analysis.reporting.result_view import number
from analysis.reporting.trial_report import TrialReport
from host.cards.definitions import Cards, card_values, missing_fields
from host.cards.files import with_object
from host.cards.tables import card_tables, hand_name, motion_name, object_name
from host.results.any_file import score_recording
from host.results.result import result_text
from host.submission.manifest import RawFile, TrialEntry
from host.submission.source import TrialSource
from host.submission.steps_csv import steps_csv_text
from host.trial.operator import EXCLUDE, INCLUDE, MARKER, NOTE, WINDOW_START, WINDOW_STOP


@dataclass(frozen=True, eq=False)
class BuiltTrial:
    """One trial, computed."""

    source: TrialSource
    cards: Cards
    """The cards, filled with what the object says."""
    report: TrialReport
    entry: TrialEntry
    files: dict[str, bytes]
    """Its files by name within its folder, without figures."""


def build_trial(source: TrialSource, *, parquet: bool = True) -> BuiltTrial:
    """Score one trial and make its files.

    Parameters
    ----------
    source : TrialSource
        Its recording, cards and choices.
    parquet : bool
        Whether the samples are written as parquet too.

    Raises
    ------
    HostError
        The recording cannot be read or scored as chosen.
    """
    with tempfile.TemporaryDirectory(prefix="rotdrift-") as folder:
        path = source.written_to(Path(folder))
        baseline = None
        if source.baseline is not None:
            baseline = Path(folder) / "baseline.toml"
            baseline.write_bytes(source.baseline)
        scored = score_recording(path, source.choices.options(baseline), source.choices.reading)
    cards, notes = with_object(source.cards, scored.info)
    result = scored.result
    missing = missing_fields(cards)
    recording = result.get("recording") or {}
    report = TrialReport(
        id="",
        hand=hand_name(cards),
        object=object_name(cards),
        motion=motion_name(cards),
        series=scored.series,
        result=result,
        cards=card_tables(cards),
        comments=cards.trial.comments or "",
        missing=missing,
        notes=(*notes, *[str(note) for note in recording.get("notes") or []], *_said_by_operator(result)),
        provenance=_provenance(source, result),
        losses=result.get("losses"),
    )
    files = source.files()
    files["result.json"] = result_text(scored.score).encode()
    files["endpoints.csv"] = endpoints_csv_text(result).encode()
    files["steps.csv"] = steps_csv_text(scored.score).encode()
    files["samples.csv"] = csv_text(scored.series).encode()
    if parquet:
        files["samples.parquet"] = parquet_bytes(scored.series)
    return BuiltTrial(source, cards, report, _entry(report, card_values(cards), source), files)


def _entry(report: TrialReport, cards: dict[str, Any], source: TrialSource) -> TrialEntry:
    result, view = report.result, report.view
    companions, sensor = view.companions, result.get("sensor") or {}
    low, high = view.interval_deg or (None, None)
    return TrialEntry(
        id="",
        hand=report.hand,
        object=report.object,
        motion=report.motion,
        valid=view.valid,
        theta_bar_deg=view.theta_bar_deg,
        interval_low_deg=low,
        interval_high_deg=high,
        n_endpoints=view.n_endpoints,
        period_s=view.period_s,
        mean_step_deg=companions.get("mean_step_deg"),
        drift_axis=result.get("axis"),
        theta_bar_other_extreme_deg=(result.get("other_extreme") or {}).get("theta_bar_deg"),
        translation_drift_mm=companions.get("translation_drift_mm"),
        sensor_per_cycle_deg=sensor.get("per_cycle_deg"),
        sensor_floor_deg=sensor.get("detectable_deg"),
        reasons=list(result.get("reasons") or []),
        warnings=list(result.get("warnings") or []),
        convention=report.series.convention,
        cards=cards,
        missing=list(report.missing),
        raw=RawFile(source.file_name, source.n_bytes, source.sha256),
    )


def _provenance(source: TrialSource, result: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    rows = [
        ("recording", f"{source.file_name}, {source.n_bytes} bytes"),
        ("SHA-256 of the recording", source.sha256),
        ("read as", str((result.get("recording") or {}).get("convention", ""))),
        ("window", str((result.get("window") or {}).get("kind", ""))),
        ("baseline", "given" if source.baseline is not None else "none given"),
    ]
    device = result.get("object") or {}
    if device:
        firmware = ".".join(str(part) for part in device.get("firmware_version") or ())
        rows.append(("object", f"{device.get('name', '')} {device.get('device_id', '')}, firmware {firmware}"))
        rows.append(("sensor and filter", f"{device.get('sensor', '')}, {device.get('filter', '')}"))
    uri = (result.get("link") or {}).get("uri")
    if uri:
        rows.append(("link", str(uri)))
    return tuple(rows)


def _said_by_operator(result: dict[str, Any]) -> tuple[str, ...]:
    """Give markers, notes and edits of the operator as sentences; other keys of the screen change nothing."""
    lines = []
    for action in result.get("operator") or []:
        if action.get("kind") in {MARKER, NOTE, WINDOW_START, WINDOW_STOP, EXCLUDE, INCLUDE}:
            time_s = number(action.get("time_s"))
            at = "" if time_s is None else f" at {time_s:.1f} s"
            said = f": {action['text']}" if action.get("text") else ""
            lines.append(f"operator, {action['kind']}{at}{said}")
    return tuple(lines)
