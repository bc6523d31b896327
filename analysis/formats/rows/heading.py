"""Where the table starts in a text file, and what names its columns.

Programs write lines about the recording before the header (Xsens DOT, MT Manager, Motive, APDM, OpenSim), rows of
units below it, and a first line ``sep=;`` for Excel. The data are what repeats: rows of numbers, all of one width.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.formats.rows.cells import SEPARATORS, CellKind, is_data_row, kind_of, split_cells

_UNITS = re.compile(
    r"[\[(]?(?:s|sec|secs|seconds?|ms|us|µs|ns|hz|deg|degrees?|°|rad|radians?|m|mm|cm|inch|g|m/s\^?2|m/s²|deg/s|°/s|dps|"
    r"rad/s|rpm|v|mv|%|c|°c|degc|ut|µt|ut|gauss|count|counts|-|–|none|unitless|n/?a|1|int|float|double|string|)[\])]?",
    re.IGNORECASE,
)
_RATE = re.compile(
    r"(?:update|output|sample|sampling|capture frame|data)[ _]*(?:rate|frequency)\W+(\d+(?:\.\d+)?)", re.IGNORECASE
)
_LINES_LOOKED_AT = 200


@dataclass(frozen=True)
class Heading:
    """What stands before the data."""

    delimiter: str | None
    """Column separator; None for white space."""
    before: int
    """Lines before the header, or before the data where there is none."""
    names: tuple[str, ...]
    """Of the columns; empty where no line names them."""
    units: int
    """Rows of units between header and data."""
    rate_hz: float | None = None
    """Sampling rate stated before the header."""

    @property
    def lines(self) -> int:
        """Lines before the first row of data."""
        return self.before + bool(self.names) + self.units


def find_heading(lines: Sequence[str]) -> Heading:
    """Find the table in the first lines of a file: neither blank nor comments."""
    lines = lines[:_LINES_LOOKED_AT]
    delimiter, width, start = _data_of(lines)
    if start is None:
        delimiter = _first_of(lines[0])
        return Heading(delimiter, 0, tuple(split_cells(lines[0], delimiter)), 0)
    units = 0
    header = start - 1
    if header > 0 and _is_unit_row(split_cells(lines[header], delimiter)):
        header, units = header - 1, 1
    names = split_cells(lines[header], delimiter) if header >= 0 else []
    if not names or not _names_columns(names, width):
        return _unnamed(lines, delimiter, width, start)
    rate = _RATE.search("\n".join(lines[:header]))
    above = [split_cells(line, delimiter) for line in reversed(lines[:header])]
    return Heading(
        delimiter, header, _distinct(names, above), units, float(rate[1]) if rate and float(rate[1]) > 0.0 else None
    )


def _unnamed(lines: Sequence[str], delimiter: str | None, width: int, start: int) -> Heading:
    """Return the heading where the line before the data names no columns: damage, found when the rows are read."""
    first = split_cells(lines[0], delimiter)
    if _names_columns(first, width):
        return Heading(delimiter, 0, tuple(first), 0)
    return Heading(delimiter, 0 if is_data_row(first) else start, (), 0)


def _data_of(lines: Sequence[str]) -> tuple[str | None, int, int | None]:
    """Return separator and width of the rows of data, and where they start; None where there are none."""
    best: tuple[int, str | None, list[list[str]], list[bool]] | None = None
    for delimiter in (*SEPARATORS, None):
        rows = [split_cells(line, delimiter) for line in lines]
        of_data = [len(row) > 1 and is_data_row(row) for row in rows]
        if any(of_data) and (best is None or sum(of_data) > best[0]):
            best = sum(of_data), delimiter, rows, of_data
    if best is None:
        return None, 0, None
    _, delimiter, rows, of_data = best
    widths = [len(row) for row in rows]
    filled = [max((k + 1 for k, cell in enumerate(row) if cell), default=0) for row in rows]
    width = Counter(itertools.compress(widths, of_data)).most_common(1)[0][0]
    usual = Counter(itertools.compress(filled, of_data)).most_common(1)[0][0]
    fits = [
        is_data and (n == width or n_filled == usual)
        for is_data, n, n_filled in zip(of_data, widths, filled, strict=True)
    ]
    for k, fit in enumerate(fits):
        following = fits[k + 1 : k + 7]
        # The ids of rigid bodies are a row of numbers too, but what follows them is not.
        if fit and (not following or (any(following[:2]) and 2 * sum(following) >= len(following))):
            return delimiter, width, k
    return None, 0, None


def _first_of(line: str) -> str | None:
    return next((mark for mark in SEPARATORS if mark in line), None)


def _is_unit_row(cells: Sequence[str]) -> bool:
    named = [cell for cell in cells if cell]
    return bool(named) and all(_UNITS.fullmatch(cell) for cell in named)


def _names_columns(cells: Sequence[str], width: int) -> bool:
    """Return whether a row names columns: texts, no number, and not far fewer than there are columns."""
    kinds = [kind_of(cell) for cell in cells]
    return (
        CellKind.NUMBER not in kinds and CellKind.MOMENT not in kinds and 2 * kinds.count(CellKind.TEXT) > min(width, 8)
    )


def _distinct(names: Sequence[str], above: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return names; where some stand more than once, with what stands in the rows above in front."""
    found = list(names)
    for row in above:
        if len(set(filter(None, found))) == len(list(filter(None, found))) or len(row) != len(found):
            break
        found = [f"{up}.{name}" if up else name for name, up in zip(found, row, strict=True)]
    return tuple(found)
