"""What a cell of a text table is: the one judge for headers, rows and files of end points.

A cell is a number, a hole, a moment (a date, a clock time) or a text. Quotes hold what stands between separators
together, as CSV has it. A decimal comma is recognised, so that the message about it can say what to do, but is never
read: ``1,5`` may be two numbers.
"""

from __future__ import annotations

import csv
import enum
import math
import re
from collections.abc import Sequence
from datetime import date

SEPARATORS = (";", "\t", ",")
"""In the order in which they are looked for; white space comes last."""
DECIMAL_POINTS = "save the file with decimal points"
"""What to do about decimal commas."""
_HOLES = frozenset({"", "nan", "-nan", "nan(ind)", "-nan(ind)", "null", "none", "na", "n/a", "<na>", "-"})
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
_MOMENT = re.compile(
    r"(?:(?P<y>\d{4})[-/.](?P<m>\d\d?)[-/.](?P<d>\d\d?)[T _]+|"
    r"(?P<a>\d\d?)(?P<mark>[./])(?P<b>\d\d?)[./](?P<c>\d{4})[T _]+)?"
    r"(?:(?P<hour>\d\d?):)?(?P<minute>\d\d?):(?P<second>\d\d?(?:[.,]\d+)?)"
    r" ?(?P<half>[aApP][mM])? ?(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?"
)
DAY_S = 86_400.0
_EPOCH = date(1970, 1, 1).toordinal()


class CellKind(enum.Enum):
    """What a cell is."""

    NUMBER = "number"
    HOLE = "hole"
    MOMENT = "moment"
    DECIMAL_COMMA = "number with a decimal comma"
    TEXT = "text"


def bare(cell: str) -> str:
    """Return a cell without spaces and quotes around it."""
    return cell.strip().strip('"').strip()


def split_cells(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, bare; what stands in quotes is one cell. None separates by white space."""
    if '"' in line:
        between = " " if delimiter is None else delimiter
        text = " ".join(line.split()) if delimiter is None else line.strip("\r\n")
        found = next(csv.reader([text], delimiter=between, skipinitialspace=True), [])
        return [bare(cell) for cell in found]
    return [cell.strip() for cell in line.split(delimiter)]


def number(cell: str) -> float:
    """Return the number in a cell, NaN for a hole.

    Raises
    ------
    ValueError
        Neither a finite number nor a hole.
    """
    text = bare(cell)
    if text.lower() in _HOLES:
        return math.nan
    if "_" not in text:  # float() takes 1_0, numpy's parser does not
        value = float(text)
        if math.isfinite(value):
            return value
    raise ValueError(text)


def moment_s(cell: str) -> float:
    """Return the moment in a cell, s since 1970 where it has a date, else since midnight; a number is taken as it is.

    Raises
    ------
    ValueError
        Neither a moment, a number nor a hole.
    """
    match = _MOMENT.fullmatch(bare(cell))
    if match is None:
        return number(cell)
    part = match.groupdict()
    hour, minute = int(part["hour"] or 0), int(part["minute"])
    if part["half"]:
        hour = hour % 12 + 12 * (part["half"].lower() == "pm")
    seconds = 3600.0 * hour + 60.0 * minute + float(part["second"].replace(",", "."))
    if part["zone"] and part["zone"][0] in "+-":
        away = part["zone"].replace(":", "")
        seconds -= int(f"{away[0]}1") * (3600.0 * int(away[1:3]) + 60.0 * int(away[3:5]))
    if part["y"]:
        day = date(int(part["y"]), int(part["m"]), int(part["d"]))
    elif part["c"]:  # 31.12.2024 is day first, 12/31/2024 month first unless that cannot be
        first, second = int(part["a"]), int(part["b"])
        if part["mark"] == "/" and second <= 31 and first <= 12:
            first, second = second, first
        day = date(int(part["c"]), second, first)
    else:
        return seconds
    return (day.toordinal() - _EPOCH) * DAY_S + seconds


def is_moment(cell: str) -> bool:
    """Return whether a cell holds a date or a clock time."""
    return _MOMENT.fullmatch(bare(cell)) is not None


def kind_of(cell: str) -> CellKind:
    """Return what a cell is."""
    text = bare(cell)
    try:
        return CellKind.HOLE if math.isnan(number(text)) else CellKind.NUMBER
    except ValueError:
        if _DECIMAL_COMMA.fullmatch(text):
            return CellKind.DECIMAL_COMMA
        return CellKind.MOMENT if is_moment(text) else CellKind.TEXT


def is_numeric_row(cells: Sequence[str]) -> bool:
    """Return whether all cells of a row are finite numbers."""
    return bool(cells) and all(kind_of(cell) is CellKind.NUMBER for cell in cells)


def is_data_row(cells: Sequence[str]) -> bool:
    """Return whether a row can be one of data: at least two numbers or moments, and more of them than texts.

    Text columns and holes are allowed; a line about the recording (``Sample rate:,10,Hz``) has too few numbers.
    """
    kinds = [kind_of(cell) for cell in cells]
    texts = kinds.count(CellKind.TEXT)
    numbers = len(kinds) - texts - kinds.count(CellKind.HOLE)
    return numbers > texts and (numbers >= 2 or (numbers == 1 and len(kinds) >= 4))
