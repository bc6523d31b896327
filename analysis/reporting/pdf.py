"""The report as a PDF to print, set with fpdf2: the same numbers, figures and texts, without any browser."""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from itertools import zip_longest
from pathlib import Path
from typing import cast

import matplotlib as mpl
from fpdf import FPDF
from fpdf.fonts import FontFace, TTFFont

from analysis.reporting import style, wording
from analysis.reporting.figure_set import NamedFigure
from analysis.reporting.tables import COLUMNS, pool
from analysis.reporting.trial_report import CardTable, TrialReport
from analysis.scoring.summary import degrees, doubt_text, interval_text, trust_rows

MISSING, NOT_GIVEN = "MISSING", "not given"
WARNING, BAD, SCORE = "#8A5A00", "#B00020", "#9C4300"
COLOURS = {MISSING: BAD, NOT_GIVEN: style.GREY, "no score": BAD}
"""Cells of tables with these words stand in these colours."""
MARGIN_MM, GAP_MM, COLUMN_GAP_MM = 15.0, 2.0, 5.0
MAX_LINES = 20
"""Lines of a row of a table; fpdf2 refuses a row that is higher than a page, so a longer one becomes several."""
_FONT = "DejaVu Sans"
_N_PAGES = "\0{nb}\0"
"""Stands for the number of pages; no text of others can hold it (:func:`style.drawable`)."""
_LINE_MM = 1.32 * 25.4 / 72
"""Height of a line over the size of its letters, mm per point."""
_MADE = datetime(1980, 1, 1, tzinfo=UTC)
"""The file's date of creation, as of the zip's entries: the same report is the same bytes, whenever it is made."""


def report_pdf(
    trials: Sequence[TrialReport],
    *,
    title: str,
    version: str,
    drawn: Mapping[str, Sequence[NamedFigure]],
    forest: Mapping[str, bytes],
) -> bytes:
    """Return the report of one or several trials as a PDF; the same input gives the same bytes.

    Parameters as for :func:`analysis.reporting.html.report_html`, but every figure is a ``png``.
    """
    pages = Pages(title, f"rotdrift {version}")
    pages.add_page()
    pages.paragraph(title, 15, bold=True)
    pages.paragraph(f"Rotation Drift Benchmark, card {wording.CARD_REFERENCE}", 8, colour=style.GREY)
    pages.ln(GAP_MM)
    pages.paragraph(wording.ABOUT, 8)
    _overview(pages, trials, forest)
    for trial in trials:
        if len(trials) > 1:
            pages.add_page()
        _trial(pages, trial)
        pages.figures("Recorded point clouds with end points, and figures", drawn[trial.id])
    return pages.finished()


def _overview(pages: Pages, trials: Sequence[TrialReport], forest: Mapping[str, bytes]) -> None:
    if len(trials) > 1:
        pages.heading(f"{len(trials)} trials", level=0)
        head = ("trial", "object", "motion", "hand", "θ̄ (°)", "95 % interval (°)", "end points", "result")
        rows = [
            (
                trial.id,
                trial.object,
                trial.motion,
                trial.hand,
                degrees(trial.result.theta_bar_deg),
                interval_text(trial.result) or "—",
                str(trial.result.n_endpoints),
                wording.verdict(trial),
            )
            for trial in trials
        ]
        pages.rows([head, *rows], (46, 31, 14, 16, 12, 25, 11, 25), 6.5, head=True)
        pooled = pool([trial.figure for trial in trials])
        if any(row.n_trials > 1 for row in pooled):
            pages.heading("Repeats of one hand, object and motion pooled", level=0)
            table = [COLUMNS, *(row.cells for row in pooled)]
            pages.rows(table, (33, 43, 26, 15, 31, 15, 17), 6.5, head=True)
        pages.ln(4)
        pages.picture(forest["png"])
    incomplete = wording.missing_lines(trials)
    if incomplete:
        pages.heading("This submission is incomplete: the benchmark card asks for more than the cards hold", level=0)
        for line in incomplete:
            pages.paragraph(line, 7.5, colour=BAD)


def _trial(pages: Pages, trial: TrialReport) -> None:
    result = trial.result
    pages.heading(trial.title, level=0)
    if result.valid:
        pages.paragraph(f"θ̄ = {degrees(result.theta_bar_deg)}° per cycle", 18, colour=SCORE, bold=True)
        ends = interval_text(trial.result)
        period = "" if result.period_s is None else f", {result.period_s:.2f} s a cycle"
        interval = f"95 % interval {ends}°" if ends else "no interval from so few cycles"
        interval += f", {doubt_text(result)}" if doubt_text(result) else ""
        pages.paragraph(f"{interval}; {result.n_endpoints} end points{period}")
    else:
        pages.paragraph("No score is claimed.", 14, colour=BAD, bold=True)
        for reason in result.reasons or ["the result gives no reason"]:
            pages.paragraph(f"– {reason}", indent_mm=4)
    for warning in result.warnings:
        pages.paragraph(f"! {warning}", 8, colour=WARNING, indent_mm=4)
    trust = trust_rows(result)
    if trust:
        pages.heading("How far to trust it")
        pages.rows(trust, (48, 43, 89))
    _cards(pages, trial.cards)
    pages.heading("Comments")
    if trial.comments:
        pages.paragraph(trial.comments, 8)
    else:
        pages.paragraph("MISSING: comments on the result with respect to the hand model and control", 8, colour=BAD)
    pages.heading("Methods")
    pages.paragraph(wording.methods_text(trial), 8)
    cycles = wording.cycle_rows(trial)
    if cycles:
        pages.heading("Cycles" if result.valid else "End points found", room_mm=30)
        pages.rows([wording.CYCLE_COLUMNS, *cycles], (20, 23, 23, 23, 23, 68), 7, head=True)
    pages.heading("Provenance")
    pages.rows(trial.provenance, (38, 142), 6.5)
    pages.ln(GAP_MM)
    for note in trial.notes:
        pages.paragraph(f"– {note}", 7, indent_mm=3)


def _cards(pages: Pages, cards: Sequence[CardTable]) -> None:
    """Set the cards in pairs, row by row, so that a page may end between any two rows."""
    pages.heading("Cards", room_mm=30)
    for first in range(0, len(cards), 2):
        pair = cards[first : first + 2]
        sides = [[(row.label, row.value or (MISSING if row.required else NOT_GIVEN)) for row in c.rows] for c in pair]
        head = [cell for card in pair for cell in (card.title, "")]
        rows = [[cell for side in row for cell in side] for row in zip_longest(*sides, fillvalue=("", ""))]
        pages.rows([head, *rows], (38, 50, 38, 54)[: len(head)], 7, head=True)
        pages.ln(GAP_MM)


class Pages(FPDF):
    """Pages that fill from the top: paragraphs, tables and figures that break where a page ends."""

    def __init__(self, title: str, program: str) -> None:
        super().__init__(format="A4")
        self.set_margin(MARGIN_MM)
        self.c_margin = 0.0
        self._running, self._program = style.drawable(title), program
        self.set_title(self._running)
        self.set_creator(program)
        self.set_creation_date(_MADE)
        self.alias_nb_pages(_N_PAGES)
        self.set_lang("en")
        self.set_draw_color(style.LIGHT)
        self.set_line_width(0.1)
        folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
        for emphasis, file in (("", "DejaVuSans.ttf"), ("B", "DejaVuSans-Bold.ttf")):
            self.add_font(_FONT, emphasis, folder / file)
        for font in self.fonts.values():
            assert isinstance(font, TTFFont)
            _centre_macron(font)

    def finished(self) -> bytes:
        """Return the file and close the fonts, which fpdf2 leaves open."""
        try:
            return bytes(self.output())
        finally:
            for font in self.fonts.values():
                if isinstance(font, TTFFont):
                    font.ttfont.close()

    def header(self) -> None:
        """Set the title on every page but the first, which starts with it."""
        if self.page_no() > 1:
            self.set_y(8)
            self._letters(6.5, style.GREY)
            first, *more = self._lines(self._running, self.epw - 3)
            self.cell(w=self.epw, text=first + "…" * bool(more))
            self.set_y(self.t_margin)

    def footer(self) -> None:
        """Set what made this, by which card, and the number of the page."""
        self.set_y(-10)
        self._letters(6.5, style.GREY)
        text = f"{self._program} · {wording.CARD_REFERENCE} · page {self.page_no()} of {_N_PAGES}"
        self.cell(w=self.epw, text=text)

    def room(self, height_mm: float) -> None:
        """Start a new page unless so much is left on this one."""
        if self.will_page_break(height_mm):
            self.add_page()

    def paragraph(
        self, text: str, size: float = 8.5, *, colour: str = style.INK, bold: bool = False, indent_mm: float = 0.0
    ) -> None:
        """Set a paragraph, wrapped; sizes are points."""
        self._letters(size, colour, bold=bold)
        self.set_x(self.l_margin + indent_mm)
        self.multi_cell(0, size * _LINE_MM, style.drawable(text), align="L", new_x="LMARGIN", new_y="NEXT")

    def heading(self, text: str, *, level: int = 1, room_mm: float = 18.0) -> None:
        """Set a heading on the page on which so much room follows, and into the outline."""
        self.room(room_mm)
        self.ln(3)
        self.start_section(style.drawable(text), level)
        self.paragraph(text, 10, bold=True)
        self.ln(1)

    def rows(
        self, rows: Sequence[Sequence[str]], widths_mm: Sequence[float], size: float = 7.5, *, head: bool = False
    ) -> None:
        """Set rows of cells, each wrapped in its column; a head stands on every page."""
        self._letters(size, style.INK)
        with self.table(
            col_widths=list(widths_mm),
            width=sum(widths_mm),
            align="LEFT",
            text_align="LEFT",
            v_align="TOP",
            borders_layout="HORIZONTAL_LINES",
            line_height=size * _LINE_MM,
            padding=(0.5, 1.5, 0.5, 0),
            first_row_as_headings=head,
            headings_style=FontFace(emphasis="B"),
        ) as table:
            for row in rows:
                for part in self._parts(row, widths_mm):
                    cells = table.row()
                    for text in part:
                        colour = COLOURS.get(text)
                        cells.cell(style.drawable(text), style=FontFace(color=colour) if colour else None)

    def picture(self, png: bytes) -> None:
        """Set a figure of its own size, as far as that fits on a page."""
        width_px, height_px = _pixels(png)
        width = min(self.epw, width_px / style.PNG_DPI * 25.4, (self.eph - 10) * width_px / height_px)
        self.room(width * height_px / width_px)
        self.image(io.BytesIO(png), w=width)

    def figures(self, title: str, figures: Sequence[NamedFigure]) -> None:
        """Set figures under a heading, each with its caption, the next one in the column that has more room."""
        size, width = 6.5, (self.epw - COLUMN_GAP_MM) / 2
        tops = [0.0, 0.0]
        for figure in figures:
            width_px, height_px = _pixels(figure.files["png"])
            height = width * height_px / width_px
            self._letters(size, style.GREY)
            needed = height + len(self._lines(figure.caption, width)) * size * _LINE_MM + 4
            if figure is figures[0]:
                self.heading(title, room_mm=min(needed + 15, self.eph))
                tops = [self.y, self.y]
            if min(tops) + needed > self.page_break_trigger:
                self.add_page()
                tops = [self.y, self.y]
            column = tops.index(min(tops))
            left = self.l_margin + column * (width + COLUMN_GAP_MM)
            self.image(io.BytesIO(figure.files["png"]), left, tops[column], width)
            self._letters(size, style.GREY)
            self.set_xy(left, tops[column] + height)
            self.multi_cell(width, size * _LINE_MM, style.drawable(figure.caption), align="L")
            tops[column] += needed
        self.set_y(max(tops))

    def _parts(self, row: Sequence[str], widths_mm: Sequence[float]) -> list[Sequence[str]]:
        if max(map(len, row)) < 10 * MAX_LINES:
            return [row]
        cells = [self._lines(text, width - 2) for text, width in zip(row, widths_mm, strict=True)]
        starts = range(0, max(map(len, cells)), MAX_LINES)
        return [["\n".join(lines[start : start + MAX_LINES]) for lines in cells] for start in starts]

    def _lines(self, text: str, width_mm: float) -> list[str]:
        lines = self.multi_cell(width_mm, text=style.drawable(text), align="L", dry_run=True, output="LINES")
        return cast("list[str]", lines)

    def _letters(self, size: float, colour: str, *, bold: bool = False) -> None:
        self.set_font(_FONT, "B" if bold else "", size)
        self.set_text_color(colour)


def _centre_macron(font: TTFFont) -> None:
    """Move the combining macron over the θ: fpdf2 does not place marks by the font's anchors, even where it shapes."""
    glyphs, advance = font.ttfont["glyf"], font.ttfont["hmtx"]["theta"][0]
    theta, macron = glyphs["theta"], glyphs["uni0304"]
    across = (theta.xMin + theta.xMax - macron.xMin - macron.xMax) // 2 - advance
    up = theta.yMax - macron.yMin + (macron.yMax - macron.yMin)
    for part in macron.components:
        part.x, part.y = part.x + across, part.y + up


def _pixels(png: bytes) -> tuple[int, int]:
    """Return width and height of a PNG."""
    width, height = struct.unpack(">II", png[16:24])
    return width, height
