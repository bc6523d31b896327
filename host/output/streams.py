"""Standard output and standard error as long as a command runs: nothing that passes can drive the terminal.

Two layers. Our own code prints through :mod:`host.output.lines`, :mod:`host.output.drawings` and the dashboard's
painter, which clean each text by itself, so that a line end in a file name cannot make a line of its own. Whatever
else prints (argparse, warnings, logging, tracebacks, libraries) meets the :class:`PrintableStream` that stands in the
place of ``sys.stdout`` and ``sys.stderr``.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator
from typing import Any, TextIO, cast

from host.text import printable

KEPT = "\n\t"
"""Control characters that texts of several lines need."""


class PrintableStream:
    """A text stream that removes what a terminal would act on; everything else is as in the stream behind it."""

    def __init__(self, inner: TextIO) -> None:
        self.inner = inner
        """The stream behind; only for what has been cleaned piece by piece and has colours of our own."""

    def write(self, text: str) -> int:
        """Write a text without control characters; return the length of the text, as if all had been written."""
        self.inner.write(printable(text, KEPT))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts one after the other."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the stream behind has
        return getattr(self.inner, name)


def inner_stream(stream: TextIO) -> TextIO:
    """Return the stream behind a printable one, or the stream itself."""
    return stream.inner if isinstance(stream, PrintableStream) else stream


def install() -> None:
    """Put printable streams in the place of standard output and standard error, for the rest of the process.

    An output that cannot show θ gets a question mark instead of failing.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or isinstance(stream, PrintableStream):  # None: a program without a console, on Windows
            continue
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
        setattr(sys, name, cast(TextIO, PrintableStream(stream)))


@contextlib.contextmanager
def installed() -> Iterator[None]:
    """Put printable streams in place, and the former ones back at the end: for a caller in the same process."""
    before = sys.stdout, sys.stderr
    install()
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def flush_output() -> None:
    """Hand what was printed to the system; raises BrokenPipeError where its reader has gone."""
    sys.stdout.flush()


def output_at_terminal() -> bool:
    """Return whether the output goes to an open terminal: not to one closed meanwhile (window, ssh)."""
    try:
        return os.isatty(sys.stdout.fileno())
    except (OSError, ValueError):
        return False


def discard_output(*, errors: bool = False) -> None:
    """Have nothing more printed; Python would otherwise report at its end that what is left has no reader."""
    for stream in (sys.stdout, sys.stderr) if errors else (sys.stdout,):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
