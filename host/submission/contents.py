"""A submission: every file of it, made from its sources, the same bytes for the same sources.

``build_submission`` is pure but for a temporary folder (readers want paths); ``rotdrift report`` packs what it returns,
``rotdrift verify`` compares it with what a bundle holds.
"""

from __future__ import annotations

import platform
import re
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from analysis.reporting import overview
from analysis.reporting import style as look
from analysis.reporting.figure_set import NamedFigure, draw_figures
from analysis.reporting.html import report_html
from analysis.reporting.pdf import report_pdf
from analysis.reporting.tables import TrialFigure, pool, summary_csv, summary_latex, summary_markdown
from host.errors import UsageError
from host.submission.manifest import (
    CARD,
    CONVENTIONS,
    SCORE_VERSION,
    SUBMISSION_FORMAT,
    Submission,
    SummaryRow,
    TrialEntry,
    submission_json,
)
from host.submission.source import TrialSource
from host.submission.trial_files import BuiltTrial, build_trial
from host.submission.trial_labels import trial_labels
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
class BuiltSubmission:
    """A submission in memory."""

    files: dict[str, bytes]
    """Every file but the manifest, by name."""
    submission: Submission
    """What ``submission.json`` says."""
    notes: tuple[str, ...]
    """What to tell the person: fields filled in, contradictions, formats left out."""


def made_with() -> dict[str, str]:
    """Name the versions that decide the bytes of a submission; without pyarrow it holds no parquet."""
    packages = {}
    for name in ("matplotlib", "numpy", "scipy", "pyarrow"):
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            continue
    return {"rotdrift": VERSION, "python": platform.python_version(), **packages}


def build_submission(
    sources: Sequence[TrialSource],
    *,
    title: str = DEFAULT_TITLE,
    versions: dict[str, str] | None = None,
    drawings: bool = True,
    accept: Callable[[str, bytes], bytes] | None = None,
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
    accept : callable, optional
        Takes name and content of a figure, and returns what the reports shall show in its place: verifying puts the
        figures of the bundle there once they are found to show the same, so that reports can be compared byte by byte.

    Raises
    ------
    HostError
        A recording cannot be read or scored as chosen, or is there twice.
    """
    _refuse_twins(sources)
    versions = versions if versions is not None else made_with()
    parquet = "pyarrow" in versions and "pyarrow" in made_with()
    trials = _named([build_trial(source, parquet=parquet) for source in sources])
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
        files.update(_drawings(trials, title, versions, accept or (lambda _, content: content)))
    notes = _notes(trials)
    if "pyarrow" not in versions:
        notes += ("no samples as parquet: that needs pyarrow (pip install 'rotdrift[parquet]')",)
    return BuiltSubmission(files, submission, notes)


def _refuse_twins(sources: Sequence[TrialSource]) -> None:
    """Refuse the same recording twice: pooled as repeats, it would make the interval of the mean too small."""
    seen: dict[str, str] = {}
    for source in sources:
        if source.sha256 in seen:
            raise UsageError(f"{seen[source.sha256]} and {source.file_name} are the same recording", "give it once")
        seen[source.sha256] = source.file_name


def _drawings(
    trials: Sequence[BuiltTrial], title: str, versions: dict[str, str], accept: Callable[[str, bytes], bytes]
) -> dict[str, bytes]:
    files: dict[str, bytes] = {}
    shown: dict[str, tuple[NamedFigure, ...]] = {}
    for trial in trials:
        folder = f"trials/{trial.entry.id}/figures"
        figures = []
        for figure in draw_figures(trial.report):
            own = {f"{folder}/{figure.name}.{kind}": content for kind, content in figure.files.items()}
            files.update(own)
            figures.append(replace(figure, files={Path(name).suffix[1:]: accept(name, own[name]) for name in own}))
        shown[trial.entry.id] = tuple(figures)
    reports = [trial.report for trial in trials]
    pooled = overview.pooled(reports)
    own = {f"figures/summary.{kind}": overview.forest(pooled, kind) for kind in look.FORMATS}
    files.update(own)
    forest = {Path(name).suffix[1:]: accept(name, content) for name, content in own.items()}
    program = versions.get("rotdrift", "")
    files["report.html"] = report_html(reports, title=title, version=program, drawn=shown, forest=forest).encode()
    files["report.pdf"] = report_pdf(reports, title=title, version=program, drawn=shown, forest=forest)
    return files


def _named(trials: list[BuiltTrial]) -> list[BuiltTrial]:
    """Name trials by hand, object and motion, repeats numbered in an order that does not depend on the input's."""
    labels = trial_labels([trial.cards for trial in trials], [Path(trial.source.file_name).stem for trial in trials])
    trials = [
        replace(
            trial,
            report=replace(trial.report, hand=hand, object=thing, motion=motion),
            entry=msgspec.structs.replace(trial.entry, hand=hand, object=thing, motion=motion),
        )
        for trial, (hand, thing, motion) in zip(trials, labels, strict=True)
    ]
    trials.sort(key=lambda trial: (_stem(trial), trial.source.file_name, trial.entry.raw.sha256))
    counts: dict[str, int] = {}
    named = []
    for trial in trials:
        stem = _stem(trial)
        counts[stem] = counts.get(stem, 0) + 1
        name = f"{stem}--{counts[stem]:02d}"
        entry = msgspec.structs.replace(trial.entry, id=name)
        provenance = (("id of the trial", name), *trial.report.provenance)
        named.append(replace(trial, report=replace(trial.report, id=name, provenance=provenance), entry=entry))
    return named


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
