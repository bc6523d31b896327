"""The report as a PDF to print, set with matplotlib: the same numbers, figures and texts, without any browser."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Sequence

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread

from analysis.reporting import figure_style as look
from analysis.reporting import wording
from analysis.reporting.figure_set import NamedFigure, draw_figures
from analysis.reporting.trial_report import TrialReport

PAGE_IN = (8.27, 11.69)
"""A4, inches."""
MARGIN_IN = 0.6
_LINE = 1.32  # line height over font size
_CHARACTER = 0.565  # mean width of a character over font size, DejaVu Sans
_MIN_PICTURES_IN = 4.8  # room for the tallest figure and its caption below the text, else they begin a page


class _Page:
    """Sets lines from the top of a page; asks for a new one when it is full."""

    def __init__(self, pages: PdfPages, footer: str) -> None:
        self._pages = pages
        self._footer = footer
        self._number = 0
        self._figure: Figure | None = None
        self._y = 0.0

    def feed(self) -> None:
        """End this page and begin the next."""
        if self._figure is not None:
            self._pages.savefig(self._figure)  # type: ignore[no-untyped-call]
        self._number += 1
        self._figure = look.new_figure(PAGE_IN[1], PAGE_IN[0], layout="none")
        self._y = PAGE_IN[1] - MARGIN_IN
        self._figure.text(
            0.5, 0.3 / PAGE_IN[1], f"{self._footer} · page {self._number}", fontsize=6.5, color=look.GREY, ha="center"
        )

    def close(self) -> None:
        """Write the last page."""
        if self._figure is not None:
            self._pages.savefig(self._figure)  # type: ignore[no-untyped-call]

    def room(self, height_in: float) -> None:
        """Begin a new page unless so much is left on this one."""
        if self._figure is None or self._y - height_in < MARGIN_IN:
            self.feed()

    def text(
        self, text: str, size: float = 8.5, *, colour: str = look.INK, indent_in: float = 0.0, weight: str = "normal"
    ) -> None:
        """Set a paragraph, wrapped."""
        width = int((PAGE_IN[0] - 2 * MARGIN_IN - indent_in) * 72 / (size * _CHARACTER))
        for line in look.drawable(text).split("\n"):
            for part in textwrap.wrap(line, width, break_long_words=True) or [""]:
                height = size * _LINE / 72
                self.room(height)
                assert self._figure is not None
                self._y -= height
                self._figure.text(
                    (MARGIN_IN + indent_in) / PAGE_IN[0],
                    self._y / PAGE_IN[1],
                    part,
                    fontsize=size,
                    color=colour,
                    parse_math=False,
                    weight=weight,
                )

    def heading(self, text: str) -> None:
        """Set a heading that keeps some lines with it."""
        self.room(0.7)
        self._y -= 0.1
        self.text(text, 10, weight="bold")
        self._y -= 0.03

    def table(
        self, rows: Sequence[Sequence[str]], widths_in: Sequence[float], size: float = 7.5, *, head: bool = False
    ) -> None:
        """Set rows of cells, each wrapped in its column."""
        for number, row in enumerate(rows):
            cells = [
                textwrap.wrap(
                    look.drawable(cell), max(int(width * 72 / (size * _CHARACTER)) - 1, 4), break_long_words=True
                )
                or [""]
                for cell, width in zip(row, widths_in, strict=True)
            ]
            height = max(map(len, cells)) * size * _LINE / 72
            self.room(height + 0.03)
            assert self._figure is not None
            x = MARGIN_IN
            for cell, width in zip(cells, widths_in, strict=True):
                for place, part in enumerate(cell):
                    self._figure.text(
                        x / PAGE_IN[0],
                        (self._y - (place + 1) * size * _LINE / 72) / PAGE_IN[1],
                        part,
                        fontsize=size,
                        weight="bold" if head and number == 0 else "normal",
                        parse_math=False,
                    )
                x += width
            self._y -= height + 0.03

    def pictures(self, figures: Sequence[NamedFigure]) -> None:
        """Set figures in two columns, each with its caption, the next one in the shorter column."""
        if self._y - MARGIN_IN < _MIN_PICTURES_IN:
            self.feed()
        else:
            self._y -= 0.2
        tops = [self._y, self._y]
        for figure in figures:
            image = imread(io.BytesIO(figure.files["png"]))
            height = image.shape[0] / look.PNG_DPI
            caption = textwrap.wrap(figure.caption, int(look.COLUMN_IN * 72 / (6.5 * _CHARACTER)))
            needed = height + 0.12 * len(caption) + 0.25
            column = 0 if tops[0] >= tops[1] else 1
            if tops[column] - needed < MARGIN_IN:
                column = 1 - column
            if tops[column] - needed < MARGIN_IN:
                self.feed()
                tops, column = [self._y, self._y], 0
            assert self._figure is not None
            left = MARGIN_IN + column * (look.COLUMN_IN + 0.12)
            place = (
                left / PAGE_IN[0],
                (tops[column] - height) / PAGE_IN[1],
                look.COLUMN_IN / PAGE_IN[0],
                height / PAGE_IN[1],
            )
            ax = self._figure.add_axes(place)
            ax.imshow(image, aspect="auto", interpolation="none")
            ax.set_axis_off()
            for number, line in enumerate(caption):
                y = tops[column] - height - 0.12 * (number + 1)
                self._figure.text(left / PAGE_IN[0], y / PAGE_IN[1], line, fontsize=6.5, color=look.GREY)
            tops[column] -= needed
        self._y = min(tops)


def report_pdf(
    trials: Sequence[TrialReport],
    *,
    title: str,
    version: str,
    drawn: dict[str, tuple[NamedFigure, ...]] | None = None,
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
    """
    buffer = io.BytesIO()
    metadata = {"CreationDate": None, "Producer": None, "Creator": f"rotdrift {version}", "Title": title}
    with look.style(), PdfPages(buffer, metadata=metadata) as pages:
        page = _Page(pages, f"rotdrift {version} · {wording.CARD_REFERENCE}")
        page.feed()
        page.text(title, 15, weight="bold")
        page.text(f"Rotation Drift Benchmark, card {wording.CARD_REFERENCE}", 8, colour=look.GREY)
        _overview(page, trials)
        for trial in trials:
            if len(trials) > 1:
                page.feed()
            _trial(page, trial)
            page.pictures((drawn or {}).get(trial.id) or draw_figures(trial, ("png",)))
        page.close()
    return buffer.getvalue()


def _overview(page: _Page, trials: Sequence[TrialReport]) -> None:
    if len(trials) > 1:
        rows = [("trial", "object", "motion", "hand", "θ̄ (°)", "95 % interval (°)", "n", "result")]
        rows += [
            (
                trial.id,
                trial.object,
                trial.motion,
                trial.hand,
                wording.degrees(trial.view.theta_bar_deg),
                wording.interval_text(trial),
                str(trial.view.n_endpoints),
                wording.verdict(trial),
            )
            for trial in trials
        ]
        page.table(rows, (1.55, 1.25, 0.8, 1.0, 0.55, 0.95, 0.3, 0.7), 6.5, head=True)
    incomplete = [f"{trial.id}: {', '.join(trial.missing)}" for trial in trials if trial.missing]
    if incomplete:
        page.heading("This submission is incomplete: the cards lack")
        for line in incomplete:
            page.text(line, 7.5, colour="#B00020")


def _trial(page: _Page, trial: TrialReport) -> None:
    view = trial.view
    page.heading(trial.title)
    if view.valid:
        page.text(f"θ̄ = {wording.degrees(view.theta_bar_deg)}° per cycle", 18, colour="#9C4300", weight="bold")
        ends = wording.interval_text(trial)
        period = "" if view.period_s is None else f", {view.period_s:.2f} s a cycle"
        interval = f"95 % interval {ends}°" if ends else "no interval from so few cycles"
        page.text(f"{interval}; {view.n_endpoints} end points{period}")
    else:
        page.text("No score is claimed.", 14, colour="#B00020", weight="bold")
        for reason in trial.result.get("reasons") or []:
            page.text(f"– {reason}", indent_in=0.15)
    for warning in trial.result.get("warnings") or []:
        page.text(f"! {warning}", 8, colour="#8A5A00", indent_in=0.15)
    trust = wording.trust_rows(trial)
    if trust:
        page.heading("How far to trust it")
        page.table(trust, (1.9, 1.9, 3.2))
    for card in trial.cards:
        page.heading(card.title)
        page.table(
            [(row.label, row.value or ("MISSING" if row.required else "not given")) for row in card.rows], (2.4, 4.6), 7
        )
    page.heading("Comments")
    page.text(trial.comments or "MISSING: comments with respect to the hand model and control", 8)
    page.heading("Methods")
    page.text(wording.methods_text(trial), 8)
    cycles = wording.cycle_rows(trial)
    if cycles:
        page.heading("Cycles")
        page.table([wording.CYCLE_COLUMNS, *cycles], (0.8, 0.9, 0.9, 0.9, 0.9, 2.6), 7, head=True)
    page.heading("Provenance")
    page.table([(name, value) for name, value in trial.provenance], (1.5, 5.5), 6.5)
    for note in trial.notes:
        page.text(f"– {note}", 7, indent_in=0.1)
