"""Text files of numbers, read fast, and the one bad cell named when there is one.

numpy's C parser reads whole files; only when it fails, or a number is not finite, a slow second pass finds the line.
Files come from strangers: binary content, endless lines and too many columns are refused before they are parsed, and
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
from functools import cached_property
from itertools import chain, islice
from typing import TextIO

import numpy as np

from analysis.formats.source import HEAD_BYTES, SourceFile, plain
from analysis.series import FloatArray, ReaderError

MAX_LINE_BYTES = 65_536
"""A longer line is not a line of numbers."""
MAX_COLUMNS = 1_024
"""More columns than any recording has."""
MAX_FILE_BYTES = 8 * 2**30
"""A text file beyond this is refused before it fills the memory."""
COMMENT = "#"
"""Starts a line, or the end of one, that holds no data."""
_HEAD_LINES = 20
_BLOCK_CHARACTERS = MAX_LINE_BYTES
_NOTHING = ",; \t\r\n\0\x1a"  # a line of these alone is blank; a logger that lost power leaves zeros, DOS a Ctrl-Z
_SEPARATORS_ALONE = re.compile(r"\n[,; \t\0\x1a]+(?=\n|\Z)")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


class TextTable:
    """A text file of numbers, known by its first lines.

    Raises
    ------
    ReaderError
        Empty, not a text file, or a line longer than ``MAX_LINE_BYTES``.
    """

    def __init__(self, source: SourceFile) -> None:
        self.source = source
        self.lines = _first_lines(source)
        """Non-blank lines, at least one, without line ends, a byte order mark and comments removed. A comment that
        names the columns stays, as the first line."""
        if not self.lines:
            raise ReaderError(f"{source.name} is empty: record again, or give another file")
        self.delimiter = _delimiter_of(self.lines[0])
        """Column separator of the first line."""

    @cached_property
    def rows(self) -> list[list[str]]:
        """Cells of the first lines."""
        return [split_row(line, self.delimiter) for line in self.lines]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Cells of the first line, as column names; see :func:`split_header`."""
        return split_header(self.lines[0], self.delimiter)

    @property
    def header_lines(self) -> int:
        """Lines before the data where the first line names the columns: none if it is a comment."""
        return 0 if self.lines[0].startswith(COMMENT) else 1


def _first_lines(source: SourceFile) -> list[str]:
    start = source.head
    if b"\0" in start.rstrip(_NOTHING.encode()):
        raise ReaderError(f"{source.name} is not text, nor a binary format known here: save it as CSV")
    lines = start.removeprefix(codecs.BOM_UTF8).splitlines()
    if len(start) == HEAD_BYTES:
        lines.pop()  # cut off in the middle
    if start and not start.strip():
        raise ReaderError(f"{source.name} has no lines of text: record again, or give another file")
    if any(len(line) > MAX_LINE_BYTES for line in lines[:_HEAD_LINES]) or (start and not lines):
        raise ReaderError(f"{source.name} has lines of over {MAX_LINE_BYTES} bytes; it is not a table of numbers")
    texts = (line.decode("utf-8", "replace") for line in lines)
    return _without_comments([text for text in texts if text.strip(_NOTHING)])[:_HEAD_LINES]


def _without_comments(lines: list[str]) -> list[str]:
    """Drop comments, but for the last one before the data if it names as many columns as there are."""
    rows = [line for line in lines if not line.startswith(COMMENT)]
    before = lines.index(rows[0]) if rows else 0
    if before:
        delimiter = _delimiter_of(rows[0])
        cells = split_row(rows[0], delimiter)
        if is_numeric_row(cells) and len(split_header(lines[before - 1], delimiter)) == len(cells):
            return [lines[before - 1], *rows]
    return rows


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


def read_table(source: SourceFile, layout: Layout) -> tuple[FloatArray, tuple[str, ...]]:
    """Read the wanted columns of a text file.

    A last line that has no line end and fewer columns than the first was being written when the recorder died: it is
    left out.

    Returns
    -------
    rows
        (rows, len(layout.columns)) finite numbers; row k is the k-th non-blank line after the header.
    notes
        What was left out.

    Raises
    ------
    ReaderError
        Too large, a line too long, a cell that is not a finite number (names line and column), or no rows.
    """
    if os.fstat(source.file.fileno()).st_size > MAX_FILE_BYTES:
        raise ReaderError(f"{source.name} is larger than {MAX_FILE_BYTES // 2**30} GiB; cut it into trials first")
    rows = _DataRows(source, layout)
    try:
        table = rows.load()
    except (ValueError, IndexError) as error:
        raise _first_fault(source, layout, str(error)) from error
    if len(table) == 0:
        raise ReaderError(f"{source.name} has no data rows: record again, or give another file")
    if not np.isfinite(table).all():
        raise _first_fault(source, layout, "a number is not finite")
    return table, ("the last line is cut off and left out",) if rows.cut else ()


class _DataRows:
    """The lines of a file from the first data row on, in one pass."""

    def __init__(self, source: SourceFile, layout: Layout) -> None:
        self.cut = False
        """Whether the last line was left out; known after :meth:`load`."""
        self._source = source
        self._layout = layout
        self._width = 0  # columns of the first row; 0 before it

    def load(self) -> FloatArray:
        layout = self._layout
        with self._source.text() as file:
            lines = chain.from_iterable(self._blocks(file))
            first = next(islice(filter(_is_data, lines), layout.header_lines, None), None)
            if first is None:
                return np.empty((0, len(layout.columns)))
            self._width = len(first.split(layout.delimiter))
            return np.loadtxt(
                chain((first,), lines),
                delimiter=layout.delimiter,
                usecols=layout.columns,
                comments=COMMENT,
                quotechar='"',
                ndmin=2,
            )

    def _blocks(self, file: TextIO) -> Iterator[list[str]]:
        """Yield the lines, many at a time: numpy takes whole blocks of them as fast as a file of its own."""
        rest = ""
        while block := file.read(_BLOCK_CHARACTERS):
            # Each line stands behind its line end here, so that one search finds blank ones, the first as well.
            whole, _, rest = f"\n{rest}{block}".rpartition("\n")
            lines = _SEPARATORS_ALONE.sub("", whole).split("\n")
            if max(len(rest), *map(len, lines[:2])) > MAX_LINE_BYTES:  # the others start and end within the block
                raise ReaderError(
                    f"{self._source.name} has a line longer than {MAX_LINE_BYTES} bytes; it is not a table of numbers"
                )
            yield lines
        if _is_data(rest):
            self.cut = len(rest.split(self._layout.delimiter)) < self._width
            yield [] if self.cut else [rest]


def _is_data(line: str) -> bool:
    return bool(line.strip(_NOTHING)) and not line.lstrip().startswith(COMMENT)


def _first_fault(source: SourceFile, layout: Layout, seen: str) -> ReaderError:
    """Return an error that names the first cell that is not a finite number, or else what was ``seen``."""
    with source.text() as file:
        data = ((number, line) for number, line in enumerate(file, start=1) if _is_data(line))
        for number, line in islice(data, layout.header_lines, None):
            where = f"{source.name} line {number}"
            cells = line.strip(" \n").split(COMMENT, 1)[0].split(layout.delimiter)
            for column, name in zip(layout.columns, layout.names, strict=True):
                if column >= len(cells):
                    return ReaderError(
                        f"{where}: {len(cells)} columns, but {plain(name)} is column {column + 1}; "
                        "correct or remove that line"
                    )
                cell = _bare(cells[column])
                if not _is_number(cell):
                    what = f"'{plain(cell)}' is not a number" if cell else "nothing where a number should be"
                    comma = layout.delimiter != "," and _DECIMAL_COMMA.match(cell)
                    # A warning of a result may quote this sentence (T42), so its words are values.
                    remedy = "save the file with decimal points" if comma else "correct or remove that line"
                    return ReaderError(f"{where}: {what} in column {plain(name)}; {remedy}")
    return ReaderError(f"{source.name} cannot be read as numbers: {plain(seen, 200)}")


def _bare(cell: str) -> str:
    return cell.strip().strip('"').strip()


def _is_number(cell: str) -> bool:
    if "_" in cell:  # float() takes 1_0, the fast parser does not
        return False
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


def _delimiter_of(line: str) -> str | None:
    """Return the column separator of a line: semicolon, tab or comma; None for white space."""
    return next((mark for mark in (";", "\t", ",") if mark in line), None)


def split_row(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, without spaces and quotes around them; empty cells at the end are dropped."""
    cells = [_bare(cell) for cell in line.split(delimiter)]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def split_header(line: str, delimiter: str | None = ",") -> tuple[str, ...]:
    """Return the column names in a header line, perhaps a comment, without spaces and quotes around them.

    Raises ReaderError for more than ``MAX_COLUMNS`` columns.
    """
    names = tuple(_bare(name) for name in line.removeprefix(COMMENT).split(delimiter))
    if len(names) > MAX_COLUMNS:
        raise ReaderError(f"the header has {len(names)} columns; at most {MAX_COLUMNS} make sense")
    return names


def is_numeric_row(cells: Sequence[str]) -> bool:
    """Return whether all cells of a line, from :func:`split_row`, are numbers."""
    return bool(cells) and all(_is_number(cell) for cell in cells)
