"""Tables and coloured text by rich: the colours are ours, the texts in them are cleaned piece by piece."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TextIO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from host.output.streams import inner_stream
from host.text import printable


class PrintableConsole(Console):
    """A console of rich that gives its own codes, for colours and progress, to the terminal, and no others.

    Rich turns whatever it draws into segments, texts with a style; only then it makes codes of the styles.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Return the segments of a drawing, their texts cleaned."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable() or segment.text == "\n":
                yield segment
            else:
                yield Segment(printable(segment.text, "\n"), segment.style)


def open_console(stream: TextIO | None = None, *, width: int | None = None) -> Console:
    """Return a console on a stream, by default standard output; NO_COLOR and TERM are honoured by rich."""
    return PrintableConsole(file=inner_stream(stream or sys.stdout), highlight=False, width=width)


def open_error_console() -> Console:
    """Return a console on standard error."""
    return open_console(sys.stderr)


def draw(drawing: RenderableType, console: Console) -> None:
    """Print a drawing; where that is a file or a pipe, without the blanks that fill up a line."""
    if console.is_terminal:
        console.print(drawing)
        return
    with console.capture() as drawn:
        console.print(drawing)
    console.file.write("".join(f"{line.rstrip()}\n" for line in drawn.get().splitlines()))
    console.file.flush()
