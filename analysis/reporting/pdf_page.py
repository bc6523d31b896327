"""Setting lines, tables and figures on the pages of a PDF with matplotlib: what the printed report is made of."""

from __future__ import annotations

import io
from collections.abc import Sequence

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D

from analysis.reporting import style as look
from analysis.reporting.figure_set import NamedFigure

PAGE_IN = (8.27, 11.69)
"""A4, inches."""
MARGIN_IN = 0.6
WIDTH_IN = PAGE_IN[0] - 2 * MARGIN_IN
"""Room for text, inches."""
WARNING, BAD, SCORE = "#8A5A00", "#B00020", "#9C4300"
_LINE = 1.32  # line height over font size
_CAPTION_IN = 0.12
_MIN_PICTURES_IN = 6.0  # room for the tallest figure and its caption below the text, else they begin a page


class PageSetter:
    """Sets lines from the top of a page; asks for a new one when it is full."""

    def __init__(self, pages: PdfPages, footer: str) -> None:
        self._pages = pages
        self._footer = footer
        self._number = 0
        self._figure: Figure | None = None
        self._y = 0.0

    def feed(self) -> None:
        """End this page and begin the next."""
        self.close()
        self._number += 1
        self._figure = look.new_figure(PAGE_IN[1], PAGE_IN[0], layout="none")
        self._y = PAGE_IN[1] - MARGIN_IN
        footer = look.drawable(f"{self._footer} · page {self._number}")
        self._figure.text(0.5, 0.3 / PAGE_IN[1], footer, fontsize=6.5, color=look.GREY, ha="center")

    def close(self) -> None:
        """Write the page."""
        if self._figure is not None:
            self._pages.savefig(self._figure)  # type: ignore[no-untyped-call]

    def room(self, height_in: float) -> None:
        """Begin a new page unless so much is left on this one."""
        if self._figure is None or self._y - height_in < MARGIN_IN:
            self.feed()

    def gap(self, height_in: float) -> None:
        """Leave some room."""
        self._y -= height_in

    def text(
        self, text: str, size: float = 8.5, *, colour: str = look.INK, indent_in: float = 0.0, weight: str = "normal"
    ) -> None:
        """Set a paragraph, wrapped."""
        for line in look.wrapped(text, WIDTH_IN - indent_in, size, bold=weight == "bold"):
            height = size * _LINE / 72
            self.room(height)
            self._y -= height
            self._set(line, MARGIN_IN + indent_in, self._y + 0.2 * height, size, colour, weight)

    def heading(self, text: str) -> None:
        """Set a heading that keeps some lines with it."""
        self.room(0.7)
        self._y -= 0.12
        self.text(text, 10, weight="bold")
        self._y -= 0.03

    def table(
        self,
        rows: Sequence[Sequence[str]],
        widths_in: Sequence[float],
        size: float = 7.5,
        *,
        head: bool = False,
        left_in: float = 0.0,
        colours: dict[str, str] | None = None,
    ) -> None:
        """Set rows of cells, each wrapped in its column; the head stands on every page.

        Parameters
        ----------
        rows
            Of cells.
        widths_in
            Of the columns, inches.
        size
            Of the letters, points.
        head
            Whether the first row is a head.
        left_in
            Where it begins, from the margin, inches.
        colours
            Colour of cells with exactly this text.
        """
        for number, row in enumerate(rows):
            bold = head and number == 0
            cells = [
                look.wrapped(cell, width - 0.06, size, bold=bold) for cell, width in zip(row, widths_in, strict=True)
            ]
            height = _height(cells, size)
            if self._figure is None or self._y - height < MARGIN_IN:
                self.feed()
                if head and number > 0:
                    self._row([look.wrapped(cell, 9, size) for cell in rows[0]], widths_in, size, "bold", left_in, {})
            self._row(cells, widths_in, size, "bold" if bold else "normal", left_in, colours or {})

    def beside(
        self,
        left: Sequence[tuple[str, Sequence[Sequence[str]]]],
        right: Sequence[tuple[str, Sequence[Sequence[str]]]],
        widths_in: Sequence[float],
        size: float = 7.0,
        colours: dict[str, str] | None = None,
    ) -> None:
        """Set titled tables in two columns where they fit on the page; else one below the other."""
        heights = [
            sum(
                0.4
                + sum(
                    _height([look.wrapped(c, w - 0.06, size) for c, w in zip(row, widths_in, strict=True)], size)
                    for row in rows
                )
                for _, rows in side
            )
            for side in (left, right)
        ]
        if max(heights) > PAGE_IN[1] - 2 * MARGIN_IN:
            for title, rows in (*left, *right):
                self.heading(title)
                self.table(rows, widths_in, size, colours=colours)
            return
        self.room(max(heights))
        top, ends = self._y, []
        for side, left_in in ((left, 0.0), (right, WIDTH_IN / 2 + 0.1)):
            self._y = top
            for title, rows in side:
                self._y -= 0.3
                self._set(title, MARGIN_IN + left_in, self._y + 0.04, 10, look.INK, "bold")
                self._y -= 0.03
                self.table(rows, widths_in, size, left_in=left_in, colours=colours)
            ends.append(self._y)
        self._y = min(ends)

    def picture(self, png: bytes, width_in: float, dpi: int = look.PNG_DPI) -> None:
        """Set one picture over the width given, as far as it fits on a page."""
        image = imread(io.BytesIO(png))
        width_in = min(width_in, image.shape[1] / dpi)
        height = width_in * image.shape[0] / image.shape[1]
        most = PAGE_IN[1] - 2 * MARGIN_IN - 0.1
        if height > most:
            width_in, height = width_in * most / height, most
        self.room(height + 0.1)
        self._image(image, MARGIN_IN, self._y, width_in, height)
        self._y -= height + 0.1

    def pictures(self, title: str, figures: Sequence[NamedFigure]) -> None:
        """Set figures in two columns under a heading, each with its caption, the next one in the shorter column."""
        self.room(_MIN_PICTURES_IN)
        self.heading(title)
        self.gap(0.1)
        tops = [self._y, self._y]
        for figure in figures:
            image = imread(io.BytesIO(figure.files["png"]))
            height = image.shape[0] / look.PNG_DPI
            caption = look.wrapped(figure.caption, look.COLUMN_IN - 0.1, 6.5)
            needed = height + _CAPTION_IN * len(caption) + 0.25
            column = 0 if tops[0] >= tops[1] else 1
            if tops[column] - needed < MARGIN_IN:
                column = 1 - column
            if tops[column] - needed < MARGIN_IN:
                self.feed()
                tops, column = [self._y, self._y], 0
            left = MARGIN_IN + column * (look.COLUMN_IN + 0.07)
            self._image(image, left, tops[column], look.COLUMN_IN, height)
            for number, line in enumerate(caption):
                self._set(line, left, tops[column] - height - _CAPTION_IN * (number + 1), 6.5, look.GREY)
            tops[column] -= needed
        self._y = min(tops)

    def _row(
        self,
        cells: Sequence[Sequence[str]],
        widths_in: Sequence[float],
        size: float,
        weight: str,
        left_in: float,
        colours: dict[str, str],
    ) -> None:
        assert self._figure is not None
        x = MARGIN_IN + left_in
        for cell, width in zip(cells, widths_in, strict=True):
            colour = colours.get(" ".join(cell), look.INK)
            for place, part in enumerate(cell):
                self._set(part, x, self._y - (place + 0.95) * size * _LINE / 72, size, colour, weight)
            x += width
        self._y -= _height(cells, size)
        ends = [(MARGIN_IN + left_in) / PAGE_IN[0], (x - 0.06) / PAGE_IN[0]]
        y = (self._y + 0.012) / PAGE_IN[1]
        strong = weight == "bold"
        line = Line2D(ends, [y, y], color=look.GREY if strong else look.LIGHT, lw=0.6 if strong else 0.3)
        self._figure.add_artist(line)

    def _set(
        self, text: str, x_in: float, y_in: float, size: float, colour: str = look.INK, weight: str = "normal"
    ) -> None:
        assert self._figure is not None
        self._figure.text(
            x_in / PAGE_IN[0], y_in / PAGE_IN[1], text, fontsize=size, color=colour, weight=weight, parse_math=False
        )

    def _image(self, image: object, left: float, top: float, width: float, height: float) -> None:
        assert self._figure is not None
        place = (left / PAGE_IN[0], (top - height) / PAGE_IN[1], width / PAGE_IN[0], height / PAGE_IN[1])
        ax = self._figure.add_axes(place)
        ax.imshow(image, aspect="auto", interpolation="none")  # type: ignore[arg-type]
        ax.set_axis_off()


def _height(cells: Sequence[Sequence[str]], size: float) -> float:
    return max(map(len, cells)) * size * _LINE / 72 + 0.05
