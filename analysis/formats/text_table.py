"""Text files of numbers, read fast, and the one bad cell named when there is one.

numpy's C parser reads whole files; only when it fails, or a number is not finite, a slow second pass finds the line.
Files come from strangers: binary content, endless lines and too many columns are refused before anything is parsed, and
text that goes into a message is shortened and stripped of control characters. Blank lines, lines of separators alone
and ``#`` comments may stand anywhere; column names may stand in the last comment before the data, where numpy.savetxt
puts them.
"""

from __future__ import annotations

import codecs
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from analysis.series import FloatArray, ReaderError

MAX_LINE_BYTES = 65_536
"""A longer line is no line of numbers."""
MAX_COLUMNS = 1_024
"""More columns than any recording has."""
MAX_FILE_BYTES = 8 * 2**30
"""A text file beyond this is refused before it fills the memory."""
COMMENT = "#"
"""Begins a line, or the end of one, that holds no data."""
_SCAN_BYTES = 1 << 20
_NOTHING = ",; \t\r\n\0\x1a"  # a line of these alone is blank; a logger that lost power leaves zeros, DOS a Ctrl-Z
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


def plain(text: str, limit: int = 40) -> str:
    """Shorten text from a file and strip what could steer a terminal.

    Parameters
    ----------
    text
        Anything.
    limit
        Characters kept.

    Returns
    -------
    Printable text of at most ``limit`` + 1 characters.
    """
    kept = "".join(c if c.isprintable() else "?" for c in text[: limit + 1])
    return kept[:limit] + "…" if len(kept) > limit else kept


@dataclass(frozen=True)
class Layout:
    """How the numbers stand in a text file."""

    delimiter: str | None
    """Column separator; None for any white space."""
    header_lines: int
    """Lines before the first data row (blank lines and comments not counted)."""
    columns: tuple[int, ...]
    """0-based columns to read, in the order wanted."""
    names: tuple[str, ...]
    """What each of them is called in messages."""


def head_lines(path: Path, limit: int = 20) -> list[str]:
    """Read the first lines of a text file.

    Parameters
    ----------
    path
        The file.
    limit
        How many lines at most.

    Returns
    -------
    Non-blank lines without line ends, a byte order mark and comments removed. A comment that names the columns stays,
    as the first line.

    Raises
    ------
    ReaderError
        Not a text file, or a line longer than ``MAX_LINE_BYTES``.
    """
    with path.open("rb") as file:
        start = file.read(4 * MAX_LINE_BYTES)
    if b"\0" in start.rstrip(_NOTHING.encode()):
        raise ReaderError(f"{plain(path.name, 80)} is not text, nor a binary format known here: save it as CSV")
    lines = start.removeprefix(codecs.BOM_UTF8).split(b"\n")
    if len(start) == 4 * MAX_LINE_BYTES:
        lines.pop()  # cut off in the middle
    if start and not start.strip():
        raise ReaderError(f"{plain(path.name, 80)} has no lines of text: record again, or give another file")
    if any(len(line) > MAX_LINE_BYTES for line in lines[:limit]) or (start and not lines):
        raise ReaderError(f"{plain(path.name, 80)} has lines of over {MAX_LINE_BYTES} bytes; it is no table of numbers")
    texts = (line.decode("utf-8", "replace").strip("\r\n") for line in lines)
    return _without_comments([text for text in texts if text.strip(_NOTHING)])[:limit]


def _without_comments(lines: list[str]) -> list[str]:
    """Drop comments, but for the last one before the data if it names as many columns as there are."""
    rows = [line for line in lines if not line.startswith(COMMENT)]
    before = lines.index(rows[0]) if rows else 0
    if before:
        delimiter = delimiter_of(rows)
        cells = split_row(rows[0], delimiter)
        if is_numeric_row(cells) and len(split_header(lines[before - 1], delimiter)) == len(cells):
            return [lines[before - 1], *rows]
    return rows


def delimiter_of(lines: Sequence[str]) -> str | None:
    """Find the column separator of the first line: semicolon, tab or comma; None for white space.

    Parameters
    ----------
    lines
        The first lines of the file.
    """
    return next((mark for mark in (";", "\t", ",") if lines and mark in lines[0]), None)


def header_lines(lines: Sequence[str]) -> int:
    """Count the lines before the data where the first line names the columns: none if it is a comment.

    Parameters
    ----------
    lines
        From :func:`head_lines`.
    """
    return 0 if lines[0].startswith(COMMENT) else 1


def check_lines(path: Path) -> None:
    """Refuse files that no table of numbers looks like, in one fast pass.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ReaderError
        Too large, or a line longer than ``MAX_LINE_BYTES``.
    """
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ReaderError(
            f"{plain(path.name, 80)} is larger than {MAX_FILE_BYTES // 2**30} GiB; cut it into trials first"
        )
    line_start, offset = 0, 0
    with path.open("rb") as file:
        while block := file.read(_SCAN_BYTES):
            ends = np.flatnonzero(np.frombuffer(block, dtype=np.uint8) == ord("\n")) + offset
            edges = np.concatenate(([line_start], ends, [offset + len(block)]))
            if np.diff(edges).max() > MAX_LINE_BYTES:
                raise ReaderError(
                    f"{plain(path.name, 80)} has a line longer than {MAX_LINE_BYTES} bytes; it is no table of numbers"
                )
            line_start = int(edges[-2])
            offset += len(block)


def read_table(path: Path, layout: Layout) -> tuple[FloatArray, tuple[str, ...]]:
    """Read the wanted columns of a text file.

    A last line that has no line end and fewer columns than the first was being written when the recorder died: it is
    left out.

    Parameters
    ----------
    path
        The file.
    layout
        Where the numbers are.

    Returns
    -------
    rows
        (rows, len(layout.columns)) finite numbers; row k is the k-th non-blank line after the header.
    notes
        What was left out.

    Raises
    ------
    ReaderError
        A cell that is no finite number (names line and column), no rows, or a file that is no table.
    """
    check_lines(path)
    if _ends_within_a_row(path, layout):
        return _load_cleaned(path, layout, cut=True), ("the last line is cut off and left out",)
    try:
        table = _load(path, layout)
    except (ValueError, UnicodeDecodeError, IndexError) as error:
        fault = _first_fault(path, layout)
        if fault is not None:
            raise fault from error
        table = _load_cleaned(path, layout)
    if len(table) == 0:
        raise ReaderError(f"{plain(path.name, 80)} has no data rows: record again, or give another file")
    if not np.isfinite(table).all():
        fault = _first_fault(path, layout)
        assert fault is not None
        raise fault
    return table, ()


def _load(path: Path, layout: Layout) -> FloatArray:
    # Blank lines before the data are not counted by `data_lines`, so the header is skipped by its place in the file.
    skip = next((number for number, _ in _data_lines(path, layout)), None)
    if skip is None:
        return np.empty((0, len(layout.columns)))
    # An absolute path: numpy takes names like http://… for addresses and would fetch them.
    return np.loadtxt(
        os.fspath(path.resolve()),
        delimiter=layout.delimiter,
        skiprows=skip - 1,
        usecols=layout.columns,
        comments=COMMENT,
        quotechar='"',
        ndmin=2,
        encoding="utf-8-sig" if skip == 1 else "utf-8",
    )


def _ends_within_a_row(path: Path, layout: Layout) -> bool:
    with path.open("rb") as file:
        file.seek(-min(path.stat().st_size, MAX_LINE_BYTES), os.SEEK_END)
        last = file.read().rpartition(b"\n")[2].decode("utf-8", "replace")
    _, first = next(_data_lines(path, layout), (0, ""))
    cells = last.split(layout.delimiter)
    return bool(last.strip(_NOTHING)) and last.strip() != first and len(cells) < len(first.split(layout.delimiter))


def _load_cleaned(path: Path, layout: Layout, *, cut: bool = False) -> FloatArray:
    """Read what numpy stumbles over though every number is sound, such as lines of separators alone; slower."""
    texts = (text for _, text in _data_lines(path, layout))
    try:
        return np.loadtxt(
            (text for text, _ in pairwise(texts)) if cut else texts,
            delimiter=layout.delimiter,
            usecols=layout.columns,
            comments=COMMENT,
            quotechar='"',
            ndmin=2,
        )
    except ValueError as error:
        raise ReaderError(f"{plain(path.name, 80)} cannot be read as numbers: {plain(str(error), 200)}") from error


def _data_lines(path: Path, layout: Layout) -> Iterator[tuple[int, str]]:
    """Yield line number (from 1) and text of every data row."""
    left = layout.header_lines
    with path.open(encoding="utf-8-sig", errors="replace", newline="\n") as file:
        for number, line in enumerate(file, start=1):
            text = line.strip(" \t\r\n") if layout.delimiter is None else line.strip(" \r\n")
            if not text.strip(_NOTHING) or text.startswith(COMMENT):
                continue
            if left > 0:
                left -= 1
                continue
            yield number, text


def _first_fault(path: Path, layout: Layout) -> ReaderError | None:
    """Find the first cell that is not a finite number; None where all are."""
    for number, text in _data_lines(path, layout):
        where = f"{plain(path.name, 80)} line {number}"
        cells = text.split(COMMENT, 1)[0].split(layout.delimiter)
        for column, name in zip(layout.columns, layout.names, strict=True):
            if column >= len(cells):
                return ReaderError(
                    f"{where}: {len(cells)} columns, but {plain(name)} is column {column + 1}; mend or remove that line"
                )
            cell = _bare(cells[column])
            if not _is_number(cell):
                what = f"'{plain(cell)}' is not a number" if cell else "nothing where a number should be"
                comma = layout.delimiter != "," and _DECIMAL_COMMA.match(cell)
                mend = "save the file with decimal points" if comma else "mend or remove that line"
                return ReaderError(f"{where}: {what} in column {plain(name)}; {mend}")
    return None


def _bare(cell: str) -> str:
    return cell.strip().strip('"').strip()


def _is_number(cell: str) -> bool:
    if "_" in cell:  # float() takes 1_0, the fast parser does not
        return False
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def split_row(line: str, delimiter: str | None) -> list[str]:
    """Split a line into its cells, without spaces and quotes around them; empty cells at the end are dropped.

    Parameters
    ----------
    line
        The line.
    delimiter
        Column separator; None for white space.
    """
    cells = [_bare(cell) for cell in line.split(delimiter)]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def split_header(line: str, delimiter: str | None = ",") -> tuple[str, ...]:
    """Split a header line into column names.

    Parameters
    ----------
    line
        The line, perhaps a comment.
    delimiter
        Column separator; None for white space.

    Returns
    -------
    Names without spaces and quotes around them.

    Raises
    ------
    ReaderError
        More than ``MAX_COLUMNS`` columns.
    """
    names = tuple(_bare(name) for name in line.removeprefix(COMMENT).split(delimiter))
    if len(names) > MAX_COLUMNS:
        raise ReaderError(f"the header has {len(names)} columns; at most {MAX_COLUMNS} make sense")
    return names


def is_numeric_row(cells: Sequence[str]) -> bool:
    """Tell whether all cells are numbers.

    Parameters
    ----------
    cells
        Cells of one line, from :func:`split_row`.
    """
    return bool(cells) and all(_is_number(cell) for cell in cells)
