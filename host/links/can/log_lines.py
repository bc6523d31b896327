"""Text logs of CAN tools, line by line: what is a frame is decided here, python-can only parses it.

python-can's readers stop at the first line that they cannot read, pass over others without a word (negative times in an
ASC, damaged lines of a TRC), lose the line behind a header that is shorter than they expect, and take differences
between times for times. So lines are checked, counted and given their times here, and reach a reader some at a time,
behind a header that it likes.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TextIO

import can

from firmware_protocol.can.frames import FD_BYTES
from host.errors import FileError
from host.links.can.log_kind import CANDUMP_LINE, CSV_HEAD, SCREEN_LINE

LINES_AT_A_TIME = 1000
MAX_LINE_CHARACTERS = 4096
"""A longer line is damage: a CAN FD frame takes 200."""
MAX_ID = 0x1FFFFFFF
MAX_TIME_S = 9e9
"""Times are whole nanoseconds in 64 bits: until the year 2255."""
_ASC_FRAME = re.compile(
    r"\s*(-?\d+\.\d+)\s+((?:\d+\s+(?:ErrorFrame|[0-9A-Fa-f]{1,8}x?\s+(?:Rx|Tx|TxRq)\s+[dDrR](?:\s+[0-9A-Fa-f]+)*))"
    r"|(?:CANFD\s+\d+\s+(?:Rx|Tx|TxRq)\s+(?:ErrorFrame|[0-9A-Fa-f]{1,8}x?\s)))"
)
_ASC_TIME = re.compile(r"\s*(-?\d+\.\d+)\s")
_ASC_EVENT = re.compile(
    r"\s*(?:$|//|date\s|base\s|(?:no\s+)?internal\s+events|begin\s|end\s|version|previous log file|"
    r"-?\d+\.\d+\s+(?:\w+\s+)?(?:start of measurement|log\s|statistic|j1939tp|can\s+\d+\s+status|canfd\s*$|sv:|"
    r"\d+\s+(?:statistic|status|errorframe)))",
    re.IGNORECASE,
)
_TRC_EVENT = re.compile(
    r"\s*\d+\)?\s+-?\d+(?:\.\d+)?\s+(?:\d+\s+)?(?:Warng|Error|ST|ER|EC|EV|\d+\s+FFFFFFFF|FFFFFFFF)\b"
)
_TRC_VERSIONS = ("1.0", "1.1", "1.3", "2.0", "2.1")
_CSV_LINE = re.compile(r"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?,0x[0-9A-Fa-f]{1,8},[01],[01],[01],\d{1,2},[A-Za-z0-9+/=]*\s*")


@dataclass
class LinesLeftOut:
    """How many lines of a log hold something that is not read."""

    kind: str
    lines: int = 0
    of: int = 0
    remarks: list[str] = field(default_factory=list)

    def sentences(self) -> list[str]:
        """Return what a person should know, a sentence each."""
        counted = f"{self.lines} of {self.of} lines are no {self.kind} lines and are left out"
        return [*([counted] if self.lines else []), *self.remarks]


def text_messages(kind: str, file: TextIO, left_out: LinesLeftOut) -> Iterator[can.Message]:
    """Yield the frames of a text log with their times, s; count in ``left_out`` what is not read.

    Raises
    ------
    FileError
        A kind whose times cannot be known.
    """
    readers = {"candump": _candump, "ASC": _asc, "CSV": _csv, "TRC": _trc, "candump on screen": _screen}
    yield from readers[kind](_lines(file), left_out)


def _lines(file: TextIO) -> Iterator[str]:
    """Yield lines of a bounded length; what goes on behind it is another line, and damage."""
    while line := file.readline(MAX_LINE_CHARACTERS):
        yield line.rstrip("\r\n")


def _parsed(
    timed: Iterable[tuple[float, str]],
    reader: Callable[[io.StringIO], Iterable[can.Message]],
    head: str,
    left_out: LinesLeftOut,
) -> Iterator[can.Message]:
    """Yield the frames of good lines, each with the time that stands beside it."""
    lines = iter(timed)
    while asked := list(itertools.islice(lines, LINES_AT_A_TIME)):
        batch = [item for item in asked if abs(item[0]) <= MAX_TIME_S]
        left_out.lines += len(asked) - len(batch)
        found = _read_all(batch, reader, head)
        if found is None:  # one of them is damaged in a way that shows only in the reader: the others one by one
            singles = [_read_all([item], reader, head) for item in batch]
            found = [message for single in singles if single is not None for message in single]
        left_out.lines += len(batch) - len(found)
        yield from found


def _read_all(
    batch: list[tuple[float, str]], reader: Callable[[io.StringIO], Iterable[can.Message]], head: str
) -> list[can.Message] | None:
    """Return a frame for each line; None where the reader returns another number of them, or one that cannot be."""
    try:
        found = list(reader(io.StringIO("\n".join([head, *(line for _, line in batch)]) if head else _joined(batch))))
    except Exception:  # noqa: BLE001 - the readers raise whatever a bad line happens to hit
        return None
    if len(found) != len(batch) or any(
        not 0 <= item.arbitration_id <= MAX_ID or not 0 <= item.dlc <= FD_BYTES for item in found
    ):
        return None
    for message, (time_s, _) in zip(found, batch, strict=True):
        message.timestamp = time_s
    return found


def _joined(batch: list[tuple[float, str]]) -> str:
    return "\n".join(line for _, line in batch)


def _candump(lines: Iterator[str], left_out: LinesLeftOut) -> Iterator[can.Message]:
    def good() -> Iterator[tuple[float, str]]:
        for line in lines:
            left_out.of += bool(line.strip())
            if CANDUMP_LINE.match(line):
                yield float(line[1 : line.index(")")]), line
            else:
                left_out.lines += bool(line.strip())

    yield from _parsed(good(), can.CanutilsLogReader, "", left_out)


def _screen(lines: Iterator[str], left_out: LinesLeftOut) -> Iterator[can.Message]:
    """Read what candump prints, where it prints absolute times, or times since its start."""
    latest = float("-inf")

    def good() -> Iterator[tuple[float, str]]:
        nonlocal latest
        for line in lines:
            left_out.of += bool(line.strip())
            match = SCREEN_LINE.match(line)
            if match is None:
                left_out.lines += bool(line.strip())
                continue
            if match["time"] is None:
                raise FileError(
                    "what candump prints has no times of reception", "log with `candump -l`, or print them with -ta"
                )
            time_s = float(match["time"])
            if time_s < latest - 1.0:
                raise FileError(
                    "the times that candump printed go backwards: differences (-td)?", "log with `candump -l`"
                )
            latest = time_s
            data = match["data"].replace(" ", "")
            is_fd = len(match["length"]) == 2
            yield time_s, f"({time_s:.6f}) {match['channel']} {match['id']}#{'#0' if is_fd else ''}{data}"

    yield from _parsed(good(), can.CanutilsLogReader, "", left_out)


def _asc(lines: Iterator[str], left_out: LinesLeftOut) -> Iterator[can.Message]:
    base, relative = "hex", False

    def good() -> Iterator[tuple[float, str]]:
        nonlocal base, relative
        now_s = 0.0
        for line in lines:
            if match := re.match(r"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", line, re.IGNORECASE):
                base, relative = match[1].lower(), (match[2] or "").lower() == "relative"
            stamp = _ASC_TIME.match(line)
            if stamp is not None:  # relative ones count from the event before, whatever it was
                now_s = now_s + float(stamp[1]) if relative else float(stamp[1])
            if match := _ASC_FRAME.match(line):
                left_out.of += 1
                yield now_s, f"0.0 {line[match.start(2) :]}"
            elif not _ASC_EVENT.match(line):
                left_out.of += 1
                left_out.lines += 1

    # The base is known before the first frame, and the header that is given then states it.
    timed = good()
    first = next(timed, None)
    if first is not None:
        head = f"base {base} timestamps absolute\ninternal events logged"
        yield from _parsed(itertools.chain((first,), timed), can.ASCReader, head, left_out)


def _csv(lines: Iterator[str], left_out: LinesLeftOut) -> Iterator[can.Message]:
    def good() -> Iterator[tuple[float, str]]:
        for line in lines:
            if not line.strip() or line.strip() == CSV_HEAD:
                continue
            left_out.of += 1
            if _CSV_LINE.fullmatch(line):
                yield float(line.partition(",")[0]), line
            else:
                left_out.lines += 1

    yield from _parsed(good(), can.CSVReader, CSV_HEAD, left_out)


def _trc(lines: Iterator[str], left_out: LinesLeftOut) -> Iterator[can.Message]:
    """Read PCAN-View's TRC; its times count from the start of the log, ms."""
    head: list[str] = []
    first = ""
    for line in lines:
        if not line.startswith(";"):
            first = line
            break
        head.append(line)
    version = next((line.partition("=")[2].strip() for line in head if line.startswith(";$FILEVERSION=")), "1.0")
    if version not in _TRC_VERSIONS:
        raise FileError(f"TRC version {version[:8]} is not read", f"save it as one of {', '.join(_TRC_VERSIONS)}")
    # Columns: number, time, ...; from 2.0 on a line of the header names them, and O is the time.
    named = next((line.partition("=")[2].strip().split(",") for line in head if line.startswith(";$COLUMNS=")), [])
    time_column = named.index("O") if "O" in named else 1

    def good() -> Iterator[tuple[float, str]]:
        for line in itertools.chain((first,), lines):
            if not line.strip() or line.startswith(";") or _TRC_EVENT.match(line):
                continue
            left_out.of += 1
            cells = line.split()
            try:
                time_s = float(cells[time_column]) / 1000.0
            except (IndexError, ValueError):
                left_out.lines += 1
                continue
            yield time_s, line

    yield from _parsed(good(), can.TRCReader, "\n".join(head), left_out)
