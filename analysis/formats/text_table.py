"""Text files of numbers, read fast, and the one bad cell named when there is one.

numpy's C parser reads whole files; where it fails, because there are holes or dates, the cells are read one by one,
and where that fails, another pass finds the line. Files come from strangers: binary content, endless lines and too many
columns are refused before they are parsed, and text that goes into a message is shortened and stripped of control
characters. Blank lines, lines of separators alone and ``#`` comments may stand anywhere; column names may stand in the
last comment before the data, where numpy.savetxt puts them.
"""

from __future__ import annotations

import codecs
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from operator import methodcaller
from typing import TextIO

import numpy as np

from analysis.bounds import MAX_SAMPLES, too_many
from analysis.formats.rows.cells import (
    DECIMAL_POINTS,
    CellKind,
    is_data_row,
    kind_of,
    moment_s,
    number,
    split_cells,
)
from analysis.formats.rows.heading import Heading, find_heading
from analysis.formats.source import HEAD_BYTES, SourceFile, plain
from analysis.series import FloatArray, IntArray, ReaderError

MAX_LINE_BYTES = 65_536
"""A longer line is not a line of numbers."""
MAX_COLUMNS = 1_024
"""More columns than any recording has."""
MAX_FILE_BYTES = 8 * 2**30
"""A text file beyond this is refused before it fills the memory."""
COMMENT = "#"
"""Starts a line, or the end of one, that holds no data."""
_HEAD_LINES = 200
_LINES_MEASURED = 20
_BLOCK_CHARACTERS = MAX_LINE_BYTES
_NOTHING = ",; \t\r\n\0\x1a"  # a line of these alone is blank; a logger that lost power leaves zeros, DOS a Ctrl-Z
_SEPARATORS_ALONE = re.compile(r"\n[,; \t\0\x1a]+(?=\n|\Z)")
_OF_QUATERNIONS = re.compile(r"^DataType=Quaternion\s*$", re.IGNORECASE)  # OpenSim: four numbers in each cell


class TextTable:
    """A text file of numbers, known by its first lines.

    Raises
    ------
    ReaderError
        Empty, not a text file, or a line longer than ``MAX_LINE_BYTES``.
    """

    def __init__(self, source: SourceFile) -> None:
        self.source = source
        lines = _first_lines(source)
        rows = [line for line in lines if not line.startswith(COMMENT)]
        if not rows:
            raise ReaderError(f"{source.name} is empty: record again, or give another file")
        self.cells_of_four = any(_OF_QUATERNIONS.match(line) for line in rows[:20])
        """Whether a cell holds a whole quaternion, as in OpenSim's ``.sto``; the cells are those of its parts then."""
        if self.cells_of_four:
            rows = _with_names_of_parts(rows)
        heading = find_heading(rows)
        names = heading.names or _names_in_comment(lines, heading)
        if len(names) > MAX_COLUMNS:
            raise ReaderError(f"the header has {len(names)} columns; at most {MAX_COLUMNS} make sense")
        self.names = names
        """Names of the columns; empty where nothing names them."""
        self.delimiter = heading.delimiter
        """Column separator; None for white space."""
        self.rate_hz = heading.rate_hz
        """Sampling rate that the lines before the header state."""
        self.header_lines = heading.lines
        """Lines before the data, blank ones and comments not counted."""
        self.lines = rows[heading.before :]
        """Non-blank lines from the header on, at least one, without line ends, a byte order mark and comments."""
        self._units = heading.units
        self._header = self.lines[0] if heading.names else ""

    @cached_property
    def rows(self) -> list[list[str]]:
        """Cells of the first lines of data, without empty cells at the end; at least one line, be it the header."""
        data = self.lines[1 + self._units :] if self._header else self.lines
        return [split_row(line, self.delimiter) for line in data or self.lines]

    def layout(self, columns: tuple[int, ...], names: tuple[str, ...], time: int | None = None) -> Layout:
        """Return the layout that reads these 0-based columns; ``time`` is which of them may hold dates."""
        return Layout(
            self.delimiter,
            self.header_lines,
            columns,
            names,
            time=time,
            width=len(self.names),
            header=self._header,
            tabs_as_commas=self.cells_of_four,
        )


def _with_names_of_parts(rows: list[str]) -> list[str]:
    """Return the lines of an OpenSim file with commas only: the header names the four parts of each cell."""
    header = next((k + 1 for k, line in enumerate(rows[:-1]) if line.strip().lower() == "endheader"), 0)
    time, *names = rows[header].split("\t")
    named = ",".join((time, *(f"{name.strip()}.{part}" for name in names for part in "wxyz")))
    return [named if k == header else line.replace("\t", ",") for k, line in enumerate(rows)]


def _names_in_comment(lines: list[str], heading: Heading) -> tuple[str, ...]:
    """Return the names in the last comment before the data, if it has as many as there are columns; else none."""
    places = [k for k, line in enumerate(lines) if not line.startswith(COMMENT)]
    first = places[heading.before]
    if first == 0 or not lines[first - 1].startswith(COMMENT):
        return ()
    names = split_header(lines[first - 1], heading.delimiter)
    return names if len(names) == len(split_row(lines[first], heading.delimiter)) else ()


def _first_lines(source: SourceFile) -> list[str]:
    start = source.head
    if b"\0" in start.rstrip(_NOTHING.encode()):
        raise ReaderError(f"{source.name} is not text, nor a binary format known here: save it as CSV")
    lines = start.removeprefix(codecs.BOM_UTF8).splitlines()
    if len(start) == HEAD_BYTES:
        lines.pop()  # cut off in the middle
    if start and not start.strip():
        raise ReaderError(f"{source.name} has no lines of text: record again, or give another file")
    if any(len(line) > MAX_LINE_BYTES for line in lines[:_LINES_MEASURED]) or (start and not lines):
        raise ReaderError(f"{source.name} has lines of over {MAX_LINE_BYTES} bytes; it is not a table of numbers")
    texts = (line.decode("utf-8", "replace") for line in lines)
    return [text for text in texts if text.strip(_NOTHING)][:_HEAD_LINES]


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
    time: int | None = None
    """Which of ``columns`` may hold dates and clock times."""
    width: int = 0
    """Columns that the header names; 0 where rows need not be compared with it."""
    header: str = ""
    """The header's line: where it stands again, another session starts."""
    tabs_as_commas: bool = False
    """Whether tabs separate what commas separate too."""


@dataclass(frozen=True, eq=False)
class TableRows:
    """Wanted columns of a text file."""

    values: FloatArray
    """(rows, columns) numbers, NaN for holes; row k is the k-th non-blank line after the header."""
    notes: tuple[str, ...]
    """What was left out."""
    starts: IntArray
    """Rows with which another session starts: the header stands again before them."""


def read_table(source: SourceFile, layout: Layout, holes: bool = True) -> TableRows:
    """Read the wanted columns of a text file.

    A last line that has no line end and fewer columns than the first was being written when the recorder died: it is
    left out.

    Raises
    ------
    ReaderError
        Too large, too many lines, a line too long, a cell that is not a finite number, or a hole where ``holes`` is not
        set, or a row wider or narrower than the header (each names the line); or no rows.
    """
    if os.fstat(source.file.fileno()).st_size > MAX_FILE_BYTES:
        raise ReaderError(f"{source.name} is larger than {MAX_FILE_BYTES // 2**30} GiB; cut it into trials first")
    rows = _DataRows(source, layout)
    try:
        values = rows.load(None)
        if np.isinf(values).any():
            raise _first_fault(source, layout, "a number is not finite", holes)
    except (ValueError, IndexError):
        rows = _DataRows(source, layout)
        time = None if layout.time is None else layout.columns[layout.time]
        try:
            values = rows.load({column: moment_s if column == time else number for column in layout.columns})
        except (ValueError, IndexError, OverflowError) as error:
            raise _first_fault(source, layout, str(error), holes) from error
    if len(values) == 0:
        raise ReaderError(f"{source.name} has no data rows: record again, or give another file")
    if not holes and np.isnan(values).any():
        raise _first_fault(source, layout, "a number is not finite", holes)
    notes = ("the last line is cut off and left out",) if rows.cut else ()
    return TableRows(values, notes, np.array(rows.starts, dtype=np.int64))


def read_texts(source: SourceFile, layout: Layout) -> list[str]:
    """Return the cells of the first of the wanted columns, as text: one per row of :func:`read_table`."""
    return list(_DataRows(source, layout).texts())


class _DataRows:
    """The lines of a file from the first data row on, in one pass."""

    def __init__(self, source: SourceFile, layout: Layout) -> None:
        self.cut = False
        """Whether the last line was left out; known after :meth:`load`."""
        self.starts: list[int] = []
        """Rows before which the header stands again."""
        self._source = source
        self._layout = layout
        self._skip = layout.header_lines  # lines before the data that are still to come
        self._width = 0  # columns of the first row; 0 before it
        self._n = 0  # rows before the block under way

    def load(self, converters: dict[int | str, Callable[[str], float]] | None) -> FloatArray:
        layout = self._layout
        with self._source.text() as file:
            lines = chain.from_iterable(self._blocks(file))
            first = next(filter(_is_data, lines), None)
            if first is None:
                return np.empty((0, len(layout.columns)))
            values: FloatArray = np.loadtxt(
                chain((first,), lines),
                dtype=np.float64,
                delimiter=layout.delimiter,
                usecols=layout.columns,
                converters=converters,
                comments=COMMENT,
                quotechar='"',
                ndmin=2,
            )
            return values

    def texts(self) -> Iterator[str]:
        column = self._layout.columns[0]
        with self._source.text() as file:
            for line in filter(_is_data, chain.from_iterable(self._blocks(file))):
                cells = split_cells(line.split(COMMENT, 1)[0], self._layout.delimiter)
                yield cells[column] if column < len(cells) else ""

    def _blocks(self, file: TextIO) -> Iterator[list[str]]:
        """Yield the lines, many at a time: numpy takes whole blocks of them as fast as a file of its own."""
        rest, read = "", 0
        while block := file.read(_BLOCK_CHARACTERS):
            # Each line stands behind its line end here, so that one search finds blank ones, the first as well.
            whole, _, rest = f"\n{rest}{block}".rpartition("\n")
            lines = _SEPARATORS_ALONE.sub("", whole).split("\n")
            if max(len(rest), *map(len, lines[:2])) > MAX_LINE_BYTES:  # the others start and end within the block
                raise ReaderError(
                    f"{self._source.name} has a line longer than {MAX_LINE_BYTES} bytes; it is not a table of numbers"
                )
            read += len(lines)
            if read > MAX_SAMPLES + _HEAD_LINES:
                raise ReaderError(too_many(self._source.name, "lines"))
            yield self._rows_of(lines)
        if _is_data(rest):
            self.cut = not self._skip and len(rest.split(self._layout.delimiter)) < self._width
            yield [] if self.cut else self._rows_of([rest])

    def _rows_of(self, lines: list[str]) -> list[str]:
        """Return those of the lines that are rows of data, blank ones and comments among them.

        Raises ValueError for a row wider or narrower than the header.
        """
        layout = self._layout
        if self._skip:
            places = [k for k, line in enumerate(lines) if _is_data(line)][: self._skip]
            self._skip -= len(places)
            lines = lines[places[-1] + 1 if not self._skip and places else len(lines) :]
        if layout.tabs_as_commas:
            lines = [line.replace("\t", ",") for line in lines]
        if layout.header and layout.header in lines:
            lines = self._without_headers(lines)
        if not self._width:
            first = next(filter(_is_data, lines), None)
            self._width = 0 if first is None else len(first.split(layout.delimiter))
        if layout.width:
            _check_widths(lines, layout)
        if layout.header:
            self._n += _count(lines)
        return lines

    def _without_headers(self, lines: list[str]) -> list[str]:
        """Return the lines without headers that stand again, and note the rows that follow them."""
        kept: list[str] = []
        for line in lines:
            if line != self._layout.header:
                kept.append(line)
                continue
            # A program that appends may write its lines about the recording again, too.
            while kept and not is_data_row(split_cells(kept[-1], self._layout.delimiter)):
                kept.pop()
            self.starts.append(self._n + _count(kept))
        return kept


def _check_widths(lines: list[str], layout: Layout) -> None:
    """Raise ValueError where a row has more cells than the header names, or fewer."""
    mark, separators = layout.delimiter, layout.width - 1
    if mark is None:
        doubtful = [line for line in lines if len(line.split()) != layout.width]
    else:
        # One pass in C; lines without any separator are blank, or lack columns that are read.
        if set(map(methodcaller("count", mark), lines)) <= {separators, 0}:
            return
        doubtful = [line for line in lines if line.count(mark) != separators]
    for line in doubtful:
        if _is_data(line) and not _fits(line, layout):
            raise ValueError(line)


def _count(lines: list[str]) -> int:
    """Return how many of the lines are rows; fast where none is a comment."""
    if any(map(methodcaller("startswith", (COMMENT, " ", "\t", ",", ";")), lines)):
        return sum(map(_is_data, lines))
    return len(lines) - lines.count("")


def _fits(line: str, layout: Layout) -> bool:
    """Return whether a row has as many columns as the header; empty cells at the end count for nothing."""
    cells = split_cells(line.split(COMMENT, 1)[0], layout.delimiter)
    if len(cells) < layout.width:
        return False
    return not any(cells[layout.width :])


def _is_data(line: str) -> bool:
    return bool(line.strip(_NOTHING)) and not line.lstrip().startswith(COMMENT)


def _first_fault(source: SourceFile, layout: Layout, seen: str, holes: bool) -> ReaderError:
    """Return an error that names the first cell that is not a finite number, or else what was ``seen``."""
    with source.text() as file:
        data = ((n, line) for n, line in enumerate(file, start=1) if _is_data(line))
        for n, line in islice(data, layout.header_lines, None):
            if layout.header and line.strip() == layout.header.strip():
                continue
            text = line.replace("\t", ",") if layout.tabs_as_commas else line
            fault = _fault_of(text.strip(" \n").split(COMMENT, 1)[0], layout, holes)
            if fault is not None:
                return ReaderError(f"{source.name} line {n}: {fault}")
    return ReaderError(f"{source.name} cannot be read as numbers: {plain(seen, 200)}")


def _fault_of(line: str, layout: Layout, holes: bool) -> str | None:
    """Return what is wrong with a row and the remedy; None where nothing is."""
    cells = split_cells(line, layout.delimiter)
    for column, name in zip(layout.columns, layout.names, strict=True):
        if column >= len(cells):
            return f"{len(cells)} columns, but {plain(name)} is column {column + 1}; correct or remove that line"
    if layout.width and not _fits(line, layout):
        many = "decimal commas, or a name missing?" if len(cells) > layout.width else "a cell or a separator missing?"
        return f"{len(cells)} columns, but the header names {layout.width}: {many} Correct that line or the header"
    for place, (column, name) in enumerate(zip(layout.columns, layout.names, strict=True)):
        cell, kind = cells[column], kind_of(cells[column])
        if kind is CellKind.NUMBER or (kind is CellKind.MOMENT and place == layout.time):
            continue
        if kind is CellKind.HOLE and holes:
            continue
        what = f"'{plain(cell)}' is not a number" if cell else "nothing where a number should be"
        # A warning of a result may quote this sentence (T42), so its words are values.
        remedy = DECIMAL_POINTS if kind is CellKind.DECIMAL_COMMA else "correct or remove that line"
        return f"{what} in column {plain(name)}; {remedy}"
    return None


def split_row(line: str, delimiter: str | None) -> list[str]:
    """Return the cells of a line, without spaces and quotes around them; empty cells at the end are dropped."""
    cells = split_cells(line, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    return cells


def split_header(line: str, delimiter: str | None = ",") -> tuple[str, ...]:
    """Return the column names in a header line, perhaps a comment, without spaces and quotes around them.

    Raises ReaderError for more than ``MAX_COLUMNS`` columns.
    """
    names = tuple(split_cells(line.removeprefix(COMMENT), delimiter))
    if len(names) > MAX_COLUMNS:
        raise ReaderError(f"the header has {len(names)} columns; at most {MAX_COLUMNS} make sense")
    return names
