"""A submission: every file of it, made from its sources, the same bytes for the same sources.

``build_submission`` is pure but for a temporary folder (readers want paths); ``rotdrift report`` packs what it returns,
``rotdrift verify`` compares it with what a bundle holds.
"""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.reporting import style
from analysis.reporting.comparison import forest_bytes
from analysis.reporting.figure_set import draw_figures
from analysis.reporting.html import report_html
from analysis.reporting.pdf import report_pdf
from analysis.reporting.tables import pool, summary_csv, summary_latex, summary_markdown
from host.errors import UsageError
from host.submission.made_with import made_with
from host.submission.manifest import CARD, CONVENTIONS, SCORE_VERSION, SUBMISSION_FORMAT, Submission, submission_json
from host.submission.source import TrialSource
from host.submission.trial_files import BuiltTrial, build_trial, trial_entry
from host.submission.trial_labels import trial_labels

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
    """``submission.json``."""
    notes: tuple[str, ...]
    """For the person: fields filled in, contradictions, formats left out."""
    damage: tuple[str, ...] = ()
    """What is wrong with the recordings, each with its name; it is among the warnings of their results too."""


def build_submission(
    sources: Sequence[TrialSource],
    *,
    title: str = DEFAULT_TITLE,
    versions: dict[str, str] | None = None,
    drawings: bool = True,
) -> BuiltSubmission:
    """Score every trial and make every file of the submission; the order of the sources does not matter.

    ``versions`` is what to write as ``made_with``, by default those installed here. Without ``drawings`` only data and
    numbers are made, neither figures nor reports.

    Raises
    ------
    HostError
        A recording cannot be read or scored as chosen, or is there twice.
    """
    _refuse_twins(sources)
    versions = versions if versions is not None else made_with()
    parquet = "pyarrow" in versions and "pyarrow" in made_with()
    trials = _named([build_trial(source, parquet=parquet) for source in sources])
    summary = pool([trial.report.figure for trial in trials])
    submission = Submission(
        format=SUBMISSION_FORMAT,
        card=CARD,
        score_version=SCORE_VERSION,
        title=title,
        complete=not any(trial.report.missing for trial in trials),
        conventions=CONVENTIONS,
        made_with=versions,
        summary=summary,
        trials=[trial_entry(trial) for trial in trials],
    )
    files = {
        "submission.json": submission_json(submission),
        "summary.csv": summary_csv(summary).encode(),
        "summary.md": summary_markdown(summary).encode(),
        "summary.tex": summary_latex(summary).encode(),
        "CITATION.txt": CITATION.format(version=versions.get("rotdrift", "")).encode(),
    }
    for trial in trials:
        files |= {f"trials/{trial.report.id}/{name}": content for name, content in trial.files.items()}
    if drawings:
        files |= _drawings(trials, title, versions.get("rotdrift", ""))
    notes = [f"{trial.report.id}: {note}" for trial in trials for note in trial.report.notes]
    if "pyarrow" not in versions:
        notes.append("no samples as parquet: that needs pyarrow (pip install 'rotdrift[parquet]')")
    damage = [
        f"trials/{trial.report.id}/raw/{trial.source.file_name} is damaged: {sentence}"
        for trial in trials
        for sentence in trial.damage
    ]
    return BuiltSubmission(files, submission, tuple(notes), tuple(damage))


def _refuse_twins(sources: Sequence[TrialSource]) -> None:
    """Refuse the same recording twice: pooled as repeats, it would make the interval of the mean too small."""
    seen: dict[str, str] = {}
    for source in sources:
        if source.sha256 in seen:
            raise UsageError(f"{seen[source.sha256]} and {source.file_name} are the same recording", "give it once")
        seen[source.sha256] = source.file_name


def _drawings(trials: Sequence[BuiltTrial], title: str, version: str) -> dict[str, bytes]:
    reports = [trial.report for trial in trials]
    drawn = {report.id: draw_figures(report) for report in reports}
    files = {
        f"trials/{name}/figures/{figure.name}.{kind}": content
        for name, figures in drawn.items()
        for figure in figures
        for kind, content in figure.files.items()
    }
    pooled = pool([report.figure for report in reports])
    forest = {kind: forest_bytes(pooled, kind) for kind in style.FORMATS}
    files |= {f"figures/summary.{kind}": content for kind, content in forest.items()}
    files["report.html"] = report_html(reports, title=title, version=version, drawn=drawn, forest=forest).encode()
    files["report.pdf"] = report_pdf(reports, title=title, version=version, drawn=drawn, forest=forest)
    return files


def _named(trials: list[BuiltTrial]) -> list[BuiltTrial]:
    """Return trials named by hand, object and motion, repeats numbered in an order that the input's does not change."""
    labels = trial_labels([trial.cards for trial in trials], [Path(trial.source.file_name).stem for trial in trials])
    trials = [
        replace(trial, report=replace(trial.report, hand=hand, object=thing, motion=motion))
        for trial, (hand, thing, motion) in zip(trials, labels, strict=True)
    ]
    trials.sort(key=lambda trial: (_stem(trial), trial.source.file_name, trial.source.sha256))
    counts: Counter[str] = Counter()
    named = []
    for trial in trials:
        stem = _stem(trial)
        counts[stem] += 1
        name = f"{stem}--{counts[stem]:02d}"
        provenance = (("id of the trial", name), *trial.report.provenance)
        named.append(replace(trial, report=replace(trial.report, id=name, provenance=provenance)))
    return named


def _stem(trial: BuiltTrial) -> str:
    return "--".join(_slug(text) for text in (trial.report.hand, trial.report.object, trial.report.motion))


def _slug(text: str) -> str:
    flat = unicodedata.normalize("NFKD", text.replace("⌀", " d ").replace("×", "x")).encode("ascii", "ignore").decode()
    return re.sub(r"[^a-z0-9]+", "-", flat.lower()).strip("-")[:40].strip("-") or "x"
