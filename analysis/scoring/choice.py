"""End points that a person chose: by row, by sequence number or by time, each with a reason if one is given.

A list, ``1175,1639,2099`` (rows, or sequence numbers where the recording has these) or ``12.5s,17.1s`` (seconds since
the first sample), on the command line or in a file; or a CSV with a header ``row`` (or ``sequence``, or ``time_s``)
and, if wanted, ``reason``:

    row,reason
    1175,
    1639,hand paused; the automatic one was in the pause
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from analysis.formats.rows.cells import DECIMAL_POINTS, SEPARATORS, CellKind, bare, kind_of, number
from analysis.formats.source import plain
from analysis.formats.text_table import MAX_FILE_BYTES
from analysis.series import ReaderError

MAX_ENDPOINTS = 1_000_000
_NAMES = ("row", "sequence", "time_s")  # columns of a CSV
_KINDS = (*_NAMES, "index")
_DECIMAL_COMMAS = re.compile(r"\d+,\d+s?")
_AROUND = " \t\r\n,;[]"  # a list may be copied with its brackets


@dataclass(frozen=True)
class EndpointChoice:
    """Chosen end points, in cycle order."""

    kind: str
    """What the values are: ``row``, ``sequence``, ``index`` (whichever of the two the recording has) or ``time_s``.

    Times are seconds since the first sample, or, where that is longer than the recording, its own time.
    """
    values: tuple[float, ...]
    """Strictly increasing."""
    reasons: tuple[str, ...] = ()
    """One per value (may be empty), or none at all."""
    source: str = "given"
    """Where the choice came from, for people."""

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise ReaderError(f"end points are named by {', '.join(_NAMES)}, not by '{plain(self.kind)}'")
        if len(self.values) > MAX_ENDPOINTS:
            raise ReaderError(f"{len(self.values)} end points; at most {MAX_ENDPOINTS} make sense")
        if self.reasons and len(self.reasons) != len(self.values):
            raise ReaderError(f"{len(self.reasons)} reasons do not fit {len(self.values)} end points")
        for k, value in enumerate(self.values):
            if not math.isfinite(value) or (self.kind != "time_s" and value != int(value)):
                raise ReaderError(f"end point {k + 1} is {value!r}, which is not a valid {self.kind}")
            if k and value <= self.values[k - 1]:
                raise ReaderError(
                    f"end points must increase, but number {k + 1} ({value:g}) does not; put them in order"
                )

    def reason(self, k: int) -> str:
        """Return the reason given for the k-th end point; empty where there is none."""
        return self.reasons[k] if self.reasons else ""


def parse_endpoints(text: str) -> EndpointChoice:
    """Parse end points from the command line: rows, times with an ``s``, or a file for :func:`load_endpoints`.

    Raises
    ------
    ReaderError
        Neither a file nor numbers; names the part.
    """
    if not text.strip(_AROUND):
        raise ReaderError("no end points given; e.g. --endpoints 1175,1639,2099,2562 or a CSV with a column row")
    choice = _parse_list(text)
    if choice is not None:
        return choice
    path = Path(text)
    try:
        found = path.is_file()
    except (OSError, ValueError):
        found = False
    if not found:
        raise ReaderError(
            f"'{plain(text)}' is neither a file of end points nor a list of rows (1175,1639) or times (12.5s,17.1s)"
        )
    return load_endpoints(path)


def _parse_list(text: str, source: str = "given") -> EndpointChoice | None:
    """Parse numbers between commas, semicolons or blanks; None where there is anything else."""
    parts = [part for part in re.split(r"[;\n\t ]+", text.strip(_AROUND)) if part.strip()]
    if len(parts) > 1 and all(_DECIMAL_COMMAS.fullmatch(part.strip()) for part in parts):
        flat = [float(value) for part in parts for value in part.strip().removesuffix("s").split(",")]
        if any(after <= before for before, after in pairwise(flat)):  # else they may be rows, two in a line
            raise ReaderError(f"'{plain(parts[0])}' is not a number; {DECIMAL_POINTS}")
    kinds, values = set(), []
    for part in re.split(r"[,;\s]+", text.strip(_AROUND)):
        kinds.add("time_s" if part.endswith("s") or "." in part else "index")
        try:
            values.append(float(part.removesuffix("s")))
        except ValueError:
            return None
    if len(kinds) > 1:
        raise ReaderError("end points are either rows (1175,1639) or times (12.5s,17.1s), not both")
    return EndpointChoice(kinds.pop(), tuple(values), source=source)


def load_endpoints(path: Path) -> EndpointChoice:
    """Read end points from a file: a list or a CSV, see above.

    Raises
    ------
    ReaderError
        Neither a list nor such a column, or a cell that is not a number; names the line.
    """
    if path.stat().st_size > min(MAX_FILE_BYTES, 64 * MAX_ENDPOINTS):
        raise ReaderError(f"{plain(path.name, 80)} is too large for a list of end points")
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    return _parse_list(text, str(path)) or _parse_csv(text, path)


def _parse_csv(text: str, path: Path) -> EndpointChoice:
    name = plain(path.name, 80)
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((mark for mark in SEPARATORS if mark in first), ",")
    try:
        read = csv.reader(io.StringIO(text), delimiter=delimiter)
        rows = [(read.line_num, row) for row in read if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise ReaderError(f"{name} is not a CSV: {plain(str(error), 80)}") from error
    header = [bare(cell).lower() for cell in rows[0][1]] if rows else []
    kinds = [kind for kind in _NAMES if kind in header]
    if len(kinds) != 1:
        raise ReaderError(f"{name} is not a list of numbers, so it needs a header with one of row, sequence, time_s")
    place = header.index(kinds[0])
    why = header.index("reason") if "reason" in header else None
    values, reasons = [], []
    for line, row in rows[1:]:
        cell = bare(row[place]) if place < len(row) else ""
        if any(extra.strip() for extra in row[len(header) :]):
            raise ReaderError(
                f"{name} line {line}: {len(row)} columns, but the header names {len(header)}; of decimal commas, "
                f"{DECIMAL_POINTS}; put a reason with a comma in quotes"
            )
        kind = kind_of(cell)
        if kind is not CellKind.NUMBER:
            remedy = f"; {DECIMAL_POINTS}" if kind is CellKind.DECIMAL_COMMA else ""
            raise ReaderError(f"{name} line {line}: '{plain(cell)}' is not a number in column {kinds[0]}{remedy}")
        values.append(number(cell))
        reasons.append(plain(row[why].strip(), 200) if why is not None and why < len(row) else "")
    return EndpointChoice(kinds[0], tuple(values), tuple(reasons) if any(reasons) else (), str(path))
