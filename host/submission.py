"""A submission: every file of it, made from its sources, the same bytes for the same sources.

``build_submission`` is pure but for a temporary folder (readers want paths); ``rotdrift report`` packs what it returns,
``rotdrift verify`` compares it with what a bundle holds.
"""

from __future__ import annotations

import hashlib
import platform
import re
import tempfile
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.reporting.figure_set import draw_figures
from analysis.reporting.report import report_html
from analysis.reporting.report_pdf import report_pdf
from analysis.reporting.summary import TrialFigure, pool, summary_csv, summary_latex, summary_markdown
from analysis.reporting.trial_report import TrialReport
from analysis.writers.errors import WriterError
from analysis.writers.parquet import parquet_bytes
from analysis.writers.series_csv import csv_text, endpoints_csv_text
from host.card_files import with_object
from host.card_tables import card_tables, hand_name, motion_name, object_name
from host.cards import card_values, missing_fields
from host.result import result_text
from host.scored_recording import score_recording
from host.steps_csv import steps_csv_text
from host.submission_format import (
    CARD,
    CONVENTIONS,
    SCORE_VERSION,
    SUBMISSION_FORMAT,
    RawFile,
    Submission,
    SummaryRow,
    TrialEntry,
    submission_json,
)
from host.submission_source import TrialSource
from host.version import VERSION

DEFAULT_TITLE = "Rotation Drift Benchmark submission"

CITATION = """\
Please cite the benchmark:

  G. Gao, G. Gorjup, R. Yu, P. Jarvis, M. Liarokapis, "Rotation Drift Benchmark",
  benchmark card RAL-SI-2020-B19-0838.4-V1.0, New Dexterity research group, The University of Auckland.
  http://newdexterity.org/benchmarking/

and the program that made this submission: rotdrift {version} (see CITATION.cff in its repository).
"""


@dataclass(frozen=True, eq=False)
class BuiltTrial:
    """One trial, computed."""

    source: TrialSource
    report: TrialReport
    entry: TrialEntry
    files: dict[str, bytes]
    """Its files by name within its folder, without figures."""


@dataclass(frozen=True, eq=False)
class BuiltSubmission:
    """A submission in memory."""

    files: dict[str, bytes]
    """Every file but the manifest, by name."""
    submission: Submission
    """What ``submission.json`` says."""
    notes: tuple[str, ...]
    """What to tell the person: fields filled in, contradictions, formats left out."""


def made_with() -> dict[str, str]:
    """Name the versions that decide the bytes of a submission."""
    packages = {name: version(name) for name in ("matplotlib", "numpy", "scipy")}
    return {"rotdrift": VERSION, "python": platform.python_version(), **packages}


def build_submission(
    sources: Sequence[TrialSource],
    *,
    title: str = DEFAULT_TITLE,
    versions: dict[str, str] | None = None,
    drawings: bool = True,
) -> BuiltSubmission:
    """Score every trial and make every file of the submission.

    Parameters
    ----------
    sources : sequence of TrialSource
        In any order; the result does not depend on it.
    title : str
        Title of the report.
    versions : dict, optional
        What to write as ``made_with``; by default :func:`made_with`.
    drawings : bool
        Whether to make figures and reports; without them only data and numbers are made.

    Raises
    ------
    HostError
        A recording cannot be read or scored as chosen.
    """
    versions = versions if versions is not None else made_with()
    trials = _with_ids([_build_trial(source) for source in sources])
    summary = pool([_figure(trial.entry) for trial in trials])
    submission = Submission(
        format=SUBMISSION_FORMAT,
        card=CARD,
        score_version=SCORE_VERSION,
        title=title,
        complete=not any(trial.entry.missing for trial in trials),
        conventions=CONVENTIONS,
        made_with=versions,
        summary=[
            SummaryRow(
                hand=row.hand,
                object=row.object,
                motion=row.motion,
                n_trials=row.n_trials,
                n_valid=row.n_valid,
                theta_bar_mean_deg=row.mean_deg,
                theta_bar_min_deg=row.min_deg,
                theta_bar_max_deg=row.max_deg,
                interval_low_deg=None if row.interval_deg is None else row.interval_deg[0],
                interval_high_deg=None if row.interval_deg is None else row.interval_deg[1],
                interval_kind=row.interval_kind,
            )
            for row in summary
        ],
        trials=[trial.entry for trial in trials],
    )
    files = {
        "submission.json": submission_json(submission),
        "summary.csv": summary_csv(summary).encode(),
        "summary.md": summary_markdown(summary).encode(),
        "summary.tex": summary_latex(summary).encode(),
        "CITATION.txt": CITATION.format(version=versions.get("rotdrift", "")).encode(),
    }
    for trial in trials:
        files.update({f"trials/{trial.entry.id}/{name}": content for name, content in trial.files.items()})
    if drawings:
        files.update(_drawings(trials, title, versions))
    return BuiltSubmission(files, submission, _notes(trials))


def _drawings(trials: Sequence[BuiltTrial], title: str, versions: dict[str, str]) -> dict[str, bytes]:
    drawn = {trial.entry.id: draw_figures(trial.report) for trial in trials}
    files = {
        f"trials/{trial_id}/figures/{figure.name}.{kind}": content
        for trial_id, figures in drawn.items()
        for figure in figures
        for kind, content in figure.files.items()
    }
    reports = [trial.report for trial in trials]
    program = versions.get("rotdrift", "")
    files["report.html"] = report_html(reports, title=title, version=program, drawn=drawn).encode()
    files["report.pdf"] = report_pdf(reports, title=title, version=program, drawn=drawn)
    return files


def _build_trial(source: TrialSource) -> BuiltTrial:
    with tempfile.TemporaryDirectory(prefix="rotdrift-") as folder:
        path = Path(folder) / source.file_name
        path.write_bytes(source.data)
        baseline = None
        if source.baseline is not None:
            baseline = Path(folder) / "baseline.toml"
            baseline.write_bytes(source.baseline)
        scored = score_recording(path, source.choices.options(baseline), source.choices.reading)
    cards, notes = with_object(source.cards, scored.info)
    result = scored.result
    digest = hashlib.sha256(source.data).hexdigest()
    missing = missing_fields(cards)
    recording = result.get("recording") or {}
    report = TrialReport(
        id="",
        hand=hand_name(cards),
        object=object_name(cards),
        # Recordings of which nothing is known must not be pooled as repeats of each other.
        motion=motion_name(cards) if cards.trial.motion else f"{motion_name(cards)} ({Path(source.file_name).stem})",
        series=scored.series,
        result=result,
        cards=card_tables(cards),
        comments=cards.trial.comments or "",
        missing=missing,
        notes=(*notes, *[str(note) for note in recording.get("notes") or []]),
        provenance=_provenance(source, result, digest),
        losses=result.get("losses"),
    )
    files = source.files()
    files["result.json"] = result_text(scored.score).encode()
    files["endpoints.csv"] = endpoints_csv_text(result).encode()
    files["steps.csv"] = steps_csv_text(scored.score).encode()
    files["samples.csv"] = csv_text(scored.series).encode()
    try:
        files["samples.parquet"] = parquet_bytes(scored.series)
    except WriterError as error:
        report = replace(report, notes=(*report.notes, f"samples as parquet left out: {error}"))
    return BuiltTrial(source, report, _entry(report, card_values(cards), source, digest), files)


def _entry(report: TrialReport, cards: dict[str, Any], source: TrialSource, digest: str) -> TrialEntry:
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
        raw=RawFile(source.file_name, len(source.data), digest),
    )


def _provenance(source: TrialSource, result: dict[str, Any], digest: str) -> tuple[tuple[str, str], ...]:
    rows = [
        ("recording", f"{source.file_name}, {len(source.data)} bytes"),
        ("SHA-256 of the recording", digest),
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


def _with_ids(trials: list[BuiltTrial]) -> list[BuiltTrial]:
    """Name trials by hand, object and motion, repeats numbered in an order that does not depend on the input's."""
    trials = sorted(trials, key=lambda trial: (_stem(trial), trial.source.file_name, trial.entry.raw.sha256))
    counts: dict[str, int] = {}
    named = []
    for trial in trials:
        stem = _stem(trial)
        counts[stem] = counts.get(stem, 0) + 1
        name = f"{stem}--{counts[stem]:02d}"
        entry = _replaced(trial.entry, name)
        named.append(replace(trial, report=replace(trial.report, id=name), entry=entry))
    return named


def _replaced(entry: TrialEntry, name: str) -> TrialEntry:
    import msgspec

    return msgspec.structs.replace(entry, id=name)


def _stem(trial: BuiltTrial) -> str:
    return "--".join(_slug(text) for text in (trial.report.hand, trial.report.object, trial.report.motion))


def _slug(text: str) -> str:
    flat = unicodedata.normalize("NFKD", text.replace("⌀", " d ").replace("×", "x")).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "-", flat.lower()).strip("-")[:40].strip("-") or "x"


def _figure(entry: TrialEntry) -> TrialFigure:
    ends = (
        None
        if entry.interval_low_deg is None or entry.interval_high_deg is None
        else (entry.interval_low_deg, entry.interval_high_deg)
    )
    return TrialFigure(entry.hand, entry.object, entry.motion, entry.theta_bar_deg, ends)


def _notes(trials: Sequence[BuiltTrial]) -> tuple[str, ...]:
    return tuple(f"{trial.entry.id}: {note}" for trial in trials for note in trial.report.notes)
