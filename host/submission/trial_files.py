"""One trial of a submission: its recording scored again, its files, and its entry in ``submission.json``."""

from __future__ import annotations

import csv
import io
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.formats.named_csv import csv_text, endpoints_csv_text
from analysis.formats.parquet import parquet_bytes
from analysis.geometry import rotations
from analysis.reporting.trial_report import TrialReport
from analysis.scoring.card import step_rotations
from analysis.scoring.recorded_parts import RecordedObject
from analysis.scoring.result import Result, result_text
from host.cards.definitions import Cards, card_values, missing_fields
from host.cards.files import with_object
from host.cards.tables import card_tables, hand_name, motion_name, object_name
from host.results.any_file import score_recording
from host.submission.manifest import RawFile, TrialEntry
from host.submission.source import TrialSource
from host.trial.operator import EXCLUDE, INCLUDE, MARKER, NOTE, WINDOW_START, WINDOW_STOP


@dataclass(frozen=True, eq=False)
class BuiltTrial:
    """One trial, computed."""

    source: TrialSource
    cards: Cards
    """The cards, filled from the object's own."""
    report: TrialReport
    files: dict[str, bytes]
    """Its files by name within its folder, without figures."""
    damage: tuple[str, ...] = ()
    """What is wrong with its recording; it is among the warnings of the result too."""


def build_trial(source: TrialSource, *, parquet: bool) -> BuiltTrial:
    """Return one trial, scored, with its files; the samples as ``parquet`` too where asked for.

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
    report = TrialReport(
        id="",
        hand=hand_name(cards),
        object=object_name(cards),
        motion=motion_name(cards),
        series=scored.series,
        result=result,
        cards=card_tables(cards),
        comments=cards.trial.comments or "",
        missing=missing_fields(cards),
        notes=(*notes, *result.recording.notes, *_operator_notes(result)),
        provenance=_provenance(source, result),
    )
    files = source.files()
    files["result.json"] = result_text(result).encode()
    files["endpoints.csv"] = endpoints_csv_text(result.to_json()).encode()
    files["steps.csv"] = _steps_csv(result).encode()
    files["samples.csv"] = csv_text(scored.series).encode()
    if parquet:
        files["samples.parquet"] = parquet_bytes(scored.series)
    return BuiltTrial(source, cards, report, files, scored.damage)


def trial_entry(trial: BuiltTrial) -> TrialEntry:
    """Return a trial's entry in ``submission.json``."""
    report, result, source = trial.report, trial.report.result, trial.source
    diagnostics, other, sensor = result.companions, result.other_extreme, result.sensor
    low, high = result.interval_deg or (None, None)
    return TrialEntry(
        id=report.id,
        hand=report.hand,
        object=report.object,
        motion=report.motion,
        valid=result.valid,
        theta_bar_deg=result.theta_bar_deg,
        interval_low_deg=low,
        interval_high_deg=high,
        n_endpoints=result.n_endpoints,
        period_s=result.period_s,
        mean_step_deg=None if diagnostics is None else diagnostics.mean_step_deg,
        drift_axis=None if result.axis is None else list(result.axis),
        theta_bar_other_extreme_deg=None if other is None else other.theta_bar_deg,
        translation_drift_mm=None if diagnostics is None else diagnostics.translation_drift_mm,
        sensor_per_cycle_deg=None if sensor is None else sensor.per_cycle_deg,
        sensor_floor_deg=None if sensor is None else sensor.detectable_deg,
        reasons=list(result.reasons),
        warnings=list(result.warnings),
        convention=report.series.convention,
        cards=card_values(trial.cards),
        missing=list(report.missing),
        raw=RawFile(source.file_name, source.n_bytes, source.sha256),
    )


def _steps_csv(result: Result) -> str:
    """Return one row per step: cycle, angle in deg, rotation vector in deg (world frame), flags of its end.

    Without a valid score there is only the header.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["cycle", "step_deg", "rx_deg", "ry_deg", "rz_deg", "flags"])
    if result.steps_deg:
        vectors = np.degrees(rotations.log(step_rotations(result.endpoint_quats_wxyz))).tolist()
        for number, (angle, vector) in enumerate(zip(result.steps_deg, vectors, strict=True), start=1):
            writer.writerow([number, repr(angle), *map(repr, vector), "; ".join(result.flags[number])])
    return buffer.getvalue()


def _provenance(source: TrialSource, result: Result) -> tuple[tuple[str, str], ...]:
    rows = [
        ("recording", f"{source.file_name}, {source.n_bytes} bytes"),
        ("SHA-256 of the recording", source.sha256),
        ("read as", result.recording.convention),
        ("window", result.window.kind),
        ("baseline", "given" if source.baseline is not None else "none given"),
    ]
    device = result.object
    if isinstance(device, RecordedObject):
        firmware = ".".join(map(str, device.firmware_version))
        rows.append(("object", f"{device.name} {device.device_id}, firmware {firmware}"))
        rows.append(("sensor and filter", f"{device.sensor}, {device.filter}"))
    if result.link is not None and result.link.uri:
        rows.append(("link", result.link.uri))
    return tuple(rows)


def _operator_notes(result: Result) -> tuple[str, ...]:
    """Return markers, notes and edits of the operator as sentences; other keys of the screen change nothing."""
    lines = []
    for action in result.operator or ():
        if action.kind in {MARKER, NOTE, WINDOW_START, WINDOW_STOP, EXCLUDE, INCLUDE}:
            at = "" if action.time_s is None else f" at {action.time_s:.1f} s"
            text = f": {action.text}" if action.text else ""
            lines.append(f"operator, {action.kind}{at}{text}")
    return tuple(lines)
