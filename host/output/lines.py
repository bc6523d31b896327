"""Lines and texts for standard output and standard error, each cleaned by itself before it is printed."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterable
from getpass import getpass
from typing import TextIO

from host.output.streams import KEPT
from host.text import one_line, printable, printable_json

_OURS = ("Traceback ", "  File ", "\n")
"""How pieces of a traceback begin that hold no message."""


def write_line(text: object = "", stream: TextIO | None = None) -> None:
    """Print one line, by default to standard output; line ends inside the text become blanks."""
    write_lines((str(text),), stream)


def write_lines(lines: Iterable[str], stream: TextIO | None = None) -> None:
    """Print lines, by default to standard output."""
    _write("".join(f"{one_line(line)}\n" for line in lines), stream or sys.stdout)


def write_text(text: str) -> None:
    """Print a text of our own that has several lines: a template, a table made for another program."""
    _write(printable(text, KEPT), sys.stdout)


def write_json(text: str) -> None:
    """Print a JSON text to standard output, with the same values: what a terminal would act on is escaped."""
    _write(printable_json(text), sys.stdout)


def write_note(sentence: object) -> None:
    """Print a sentence for a person to standard error, beside the output: ``rotdrift: ...``."""
    write_line(f"rotdrift: {sentence}", sys.stderr)


def write_traceback(error: BaseException) -> None:
    """Print where an error came from, to standard error; further lines of a message are marked as such."""
    pieces = traceback.format_exception(error)
    marked = (
        piece if piece.startswith(_OURS) else "\n  | ".join(piece.rstrip("\n").split("\n")) + "\n" for piece in pieces
    )
    _write(printable("".join(marked), KEPT), sys.stderr)


def error_stream() -> TextIO:
    """Return standard error, for a screen of lines."""
    return sys.stderr


def output_stream() -> TextIO:
    """Return standard output, for a screen."""
    return sys.stdout


def ask(prompt: str) -> str:
    """Return the line that a person types after a prompt; Python's ``input`` prints past ``sys.stdout``."""
    return input(one_line(prompt))


def ask_secret(prompt: str) -> str:
    """Return the line that a person types unseen; where standard input is not a terminal, its next line."""
    return getpass(one_line(prompt)) if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")


def _write(text: str, stream: TextIO) -> None:
    stream.write(text)
    stream.flush()
