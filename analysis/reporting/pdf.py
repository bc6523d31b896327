"""The report as a PDF to print, set with matplotlib: the same numbers, figures and texts, without any browser."""

from __future__ import annotations

import io
from collections.abc import Sequence

from matplotlib.backends.backend_pdf import PdfPages

from analysis.reporting import overview, wording
from analysis.reporting import style as look
from analysis.reporting.figure_set import NamedFigure, draw_figures
from analysis.reporting.pdf_page import BAD, SCORE, WARNING, WIDTH_IN, PageSetter
from analysis.reporting.trial_report import CardTable, TrialReport

MISSING, NOT_GIVEN = "MISSING", "not given"


def report_pdf(
    trials: Sequence[TrialReport],
    *,
    title: str,
    version: str,
    drawn: dict[str, tuple[NamedFigure, ...]] | None = None,
    forest: dict[str, bytes] | None = None,
) -> bytes:
    """Write the report of one or several trials as a PDF; the same input gives the same bytes.

    Parameters
    ----------
    trials
        In the order of the report.
    title
        Title on the first page.
    version
        Version of rotdrift.
    drawn
        Figures by trial id with a ``png`` of each, where they were drawn already.
    forest
        The figure of the whole as ``png``, where it was drawn already.
    """
    buffer = io.BytesIO()
    metadata = {"CreationDate": None, "Producer": None, "Creator": f"rotdrift {version}", "Title": title}
    with look.style(), PdfPages(buffer, metadata=metadata) as pages:
        page = PageSetter(pages, f"rotdrift {version} · {wording.CARD_REFERENCE}")
        page.feed()
        page.text(title, 15, weight="bold")
        page.text(f"Rotation Drift Benchmark, card {wording.CARD_REFERENCE}", 8, colour=look.GREY)
        page.gap(0.08)
        page.text(wording.ABOUT, 8)
        _overview(page, trials, forest or {})
        for trial in trials:
            if len(trials) > 1:
                page.feed()
            _trial(page, trial)
            page.pictures(
                "Recorded point clouds with end points, and figures",
                (drawn or {}).get(trial.id) or draw_figures(trial, ("png",)),
            )
        page.close()
    return buffer.getvalue()


def _overview(page: PageSetter, trials: Sequence[TrialReport], forest: dict[str, bytes]) -> None:
    if len(trials) > 1:
        page.heading(f"{len(trials)} trials")
        head = ("trial", "object", "motion", "hand", "θ̄ (°)", "95 % interval (°)", "end points", "result")
        rows = [
            (
                trial.id,
                trial.object,
                trial.motion,
                trial.hand,
                wording.degrees(trial.view.theta_bar_deg),
                wording.interval_text(trial) or "—",
                str(trial.view.n_endpoints),
                wording.verdict(trial),
            )
            for trial in trials
        ]
        widths = (1.95, 1.25, 0.6, 0.6, 0.5, 1.0, 0.45, 0.7)
        page.table([head, *rows], widths, 6.5, head=True, colours={"no score": BAD})
        pooled = overview.pooled(trials)
        if any(row.n_trials > 1 for row in pooled):
            page.heading("Repeats of one hand, object and motion pooled")
            table = [overview.COLUMNS, *(overview.cells(row) for row in pooled)]
            page.table(table, (1.3, 1.7, 1.0, 0.6, 1.2, 0.6, 0.67), 6.5, head=True)
        page.gap(0.15)
        page.picture(forest.get("png") or overview.forest(pooled, "png"), WIDTH_IN)
    incomplete = wording.missing_lines(trials)
    if incomplete:
        page.heading("This submission is incomplete: the benchmark card asks for more than the cards hold")
        for line in incomplete:
            page.text(line, 7.5, colour=BAD)


def _trial(page: PageSetter, trial: TrialReport) -> None:
    view = trial.view
    page.heading(trial.title)
    if view.valid:
        page.gap(0.04)
        page.text(f"θ̄ = {wording.degrees(view.theta_bar_deg)}° per cycle", 18, colour=SCORE, weight="bold")
        ends = wording.interval_text(trial)
        period = "" if view.period_s is None else f", {view.period_s:.2f} s a cycle"
        interval = f"95 % interval {ends}°" if ends else "no interval from so few cycles"
        page.text(f"{interval}; {view.n_endpoints} end points{period}")
    else:
        page.text("No score is claimed.", 14, colour=BAD, weight="bold")
        for reason in trial.result.get("reasons") or ["the result gives no reason"]:
            page.text(f"– {reason}", indent_in=0.15)
    for warning in trial.result.get("warnings") or []:
        page.text(f"! {warning}", 8, colour=WARNING, indent_in=0.15)
    trust = wording.trust_rows(trial)
    if trust:
        page.heading("How far to trust it")
        page.table(trust, (1.9, 1.7, 3.45))
    tables = [(card.title, _card_rows(card)) for card in trial.cards]
    colours = {MISSING: BAD, NOT_GIVEN: look.GREY}
    page.beside(tables[:1] + tables[2:], tables[1:2], (1.5, 1.9), 7, colours)
    page.heading("Comments")
    if trial.comments:
        page.text(trial.comments, 8)
    else:
        page.text("MISSING: comments on the result with respect to the hand model and control", 8, colour=BAD)
    page.heading("Methods")
    page.text(wording.methods_text(trial), 8)
    cycles = wording.cycle_rows(trial)
    if cycles:
        page.room(1.2)
        page.heading("Cycles" if view.valid else "End points found")
        page.table([wording.CYCLE_COLUMNS, *cycles], (0.8, 0.9, 0.9, 0.9, 0.9, 2.65), 7, head=True)
    page.heading("Provenance")
    page.table([(name, value) for name, value in trial.provenance], (1.5, 5.55), 6.5)
    for note in trial.notes:
        page.text(f"– {note}", 7, indent_in=0.1)


def _card_rows(card: CardTable) -> list[tuple[str, str]]:
    return [(row.label, row.value or (MISSING if row.required else NOT_GIVEN)) for row in card.rows]
