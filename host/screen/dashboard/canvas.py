"""Dots in braille characters, 2 x 4 a cell, in ASCII one a cell; and figures three lines high."""

from __future__ import annotations

from collections.abc import Sequence

from rich.style import Style
from rich.text import Text

from host.screen.dashboard.theme import Theme

_BRAILLE = 0x2800
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))


class Canvas:
    """Dots, lines and letters on a grid of so many cells; (0, 0) is the lower left dot."""

    def __init__(self, width: int, height: int, theme: Theme) -> None:
        self.cells_wide, self._cells_high = max(0, width), max(0, height)
        self._theme = theme
        self._per_x, self._per_y = (1, 1) if theme.ascii_only else (2, 4)
        self.width, self.height = self.cells_wide * self._per_x, self._cells_high * self._per_y
        """In dots."""
        self._bits: dict[tuple[int, int], int] = {}
        self._letters: dict[tuple[int, int], str] = {}
        self._styles: dict[tuple[int, int], Style] = {}

    def dot(self, x: float, y: float, meaning: str, mark: str) -> None:
        """Set a dot; outside the picture nothing happens. ``mark`` stands for it in ASCII."""
        place = self._cell(x, y)
        if place is None:
            return
        if self._theme.ascii_only:
            self._letters.setdefault(place, mark)
        else:
            down = self.height - 1 - round(y)
            self._bits[place] = self._bits.get(place, 0) | _DOTS[round(x) % 2][down % 4]
        self._styles[place] = self._theme.styles[meaning]

    def line(self, start: Sequence[float], end: Sequence[float], meaning: str, mark: str) -> None:
        """Draw a straight line between two points (x, y)."""
        (x0, y0), (x1, y1) = start, end
        steps = max(1, round(max(abs(x1 - x0), abs(y1 - y0))))
        for k in range(min(steps, 1000) + 1):
            self.dot(x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps, meaning, mark)

    def letter(self, x: float, y: float, letter: str, meaning: str) -> None:
        """Write one character over whatever dots are in its cell."""
        place = self._cell(x, y)
        if place is not None:
            self._letters[place] = letter
            self._styles[place] = self._theme.styles[meaning]

    def lines(self) -> list[Text]:
        """Return the picture, a text per row of cells."""
        return [self._row(row) for row in range(self._cells_high)]

    def _cell(self, x: float, y: float) -> tuple[int, int] | None:
        column, up = round(x), round(y)
        if not (0 <= column < self.width and 0 <= up < self.height):
            return None
        return column // self._per_x, (self.height - 1 - up) // self._per_y

    def _row(self, row: int) -> Text:
        line = Text(no_wrap=True, end="")
        run, style = "", None
        for column in range(self.cells_wide):
            place = (column, row)
            bits = self._bits.get(place, 0)
            character = self._letters.get(place) or (chr(_BRAILLE + bits) if bits else " ")
            its_style = self._styles.get(place)
            if its_style is not style and run:  # neighbours of one style go as one piece: it is drawn faster
                line.append(run, style)
                run = ""
            run, style = run + character, its_style
        return line.append(run, style)


_CHARACTERS = "0123456789.-° "
_BLOCKS = (
    "█▀█: ▀█:▀▀█:▀▀█:█ █:█▀▀:█▀▀:▀▀█:█▀█:█▀█: :   :▄▄: ",
    "█ █:  █:█▀▀: ▀█:▀▀█:▀▀█:█▀█:  █:█▀█:▀▀█: :▀▀▀:▀▀: ",
    "█▄█: ▄█:█▄▄:▄▄█:  █:▄▄█:█▄█:  █:█▄█:▄▄█:▄:   :  : ",
)
_STROKES = (
    " _ :   : _ : _ :   : _ : _ : _ : _ : _ : :   :deg: ",
    "| |:  |: _|: _|:|_|:|_ :|_ :  |:|_|:|_|: : _ :   : ",
    "|_|:  |:|_ : _|:  |: _|:|_|:  |:|_|: _|:.:   :   : ",
)


def big_text(text: str, ascii_only: bool = False) -> tuple[str, str, str]:
    """Write figures in three lines of equal length, of block characters or of ASCII.

    Raises
    ------
    ValueError
        A character is not a digit, point, minus, degree sign or space.
    """
    unknown = sorted(set(text) - set(_CHARACTERS))
    if unknown:
        raise ValueError(f"no large figure for {''.join(unknown)!r}")
    rows = [row.split(":") for row in (_STROKES if ascii_only else _BLOCKS)]
    places = [_CHARACTERS.index(character) for character in text]
    top, middle, bottom = (" ".join(row[place] for place in places) for row in rows)
    return top, middle, bottom
