"""Pictures as what a terminal is sent: the lines that changed, in its colours, and never more than it accepts."""

from __future__ import annotations

import time

from rich.color import ColorSystem
from rich.style import Style
from rich.text import Text

from host.output.drawings import open_error_console
from host.screen.dashboard.boxes import Lines
from host.screen.dashboard.theme import Theme
from host.screen.terminal import CLEAR, ENTER, LEAVE, Terminal
from host.text import printable

LEAVE_S = 1.0
"""How long to wait at the end for a terminal that accepts nothing."""
ASIDE = "\r\nThe capture goes on. Press any key to come back to its screen; q there ends it.\r\n"
_COLORS = {"standard": ColorSystem.STANDARD, "256": ColorSystem.EIGHT_BIT, "truecolor": ColorSystem.TRUECOLOR}


class Painter:
    """Paints on a terminal that may accept nothing, be resized, or be given to a shell between two pictures."""

    def __init__(self, terminal: Terminal, theme: Theme) -> None:
        self._terminal = terminal
        self._color = _COLORS.get(theme.color or "")
        self._encoding = "ascii" if theme.ascii_only else "utf-8"
        self._console = open_error_console()  # rich wants one even to split a text into styles
        self._lines: list[str] = []  # as they stand on the terminal
        self._size = (0, 0)
        self._unsent = b""
        self._afresh = True  # what stands on the terminal is not ours
        self._aside = False

    @property
    def is_stale(self) -> bool:
        """Whether the terminal does not show the last picture, or not at its size."""
        return self._afresh or bool(self._unsent) or self._terminal.size() != self._size

    def forget(self) -> None:
        """Paint everything again next time: somebody else has used the terminal."""
        self._afresh = True

    def flush(self) -> bool:
        """Write what the terminal accepts now of what is unsent; return whether it was all."""
        while self._unsent:
            written = self._terminal.write(self._unsent)
            if not written:
                return False
            self._unsent = self._unsent[written:]
        return True

    def paint(self, lines: Lines, size: tuple[int, int], bell: bool) -> None:
        """Send the lines of a picture that changed; ``size`` is the width and height it was drawn for, cells."""
        afresh, resized = self._aside or self._afresh, size != self._size
        self._aside = self._afresh = False
        coded = [self._codes(line) for line in lines]
        before = [""] * len(coded) if afresh or resized else self._lines
        pairs = enumerate(zip(coded, before, strict=True), start=1)
        changed = "".join(f"\x1b[{row};1H{line}" for row, (line, old) in pairs if line != old)
        if not self._terminal.in_foreground():  # the process was stopped while it drew
            self._afresh = True
            return
        if afresh:
            self._terminal.acquire()
        start = ENTER if afresh else CLEAR if resized else ""
        self._lines, self._size = coded, size
        self._unsent = (start + changed + "\a" * bell).encode(self._encoding, "replace")
        self.flush()

    def step_aside(self) -> None:
        """Show the terminal's old screen until the next picture."""
        if not self._aside:
            self._aside = True
            self._unsent = (LEAVE + ASIDE).encode()
            self.flush()

    def leave(self, last_words: str) -> None:
        """Leave the screen; a terminal that accepts nothing gets a second."""
        self._unsent += ("" if self._aside else LEAVE).encode() + last_words.encode()
        end_s = time.monotonic() + LEAVE_S
        while not self.flush() and time.monotonic() < end_s:
            time.sleep(0.02)

    def _codes(self, line: Text) -> str:
        """Return a line as text with colour codes."""
        out = []
        for shown, style, _ in line.render(self._console):
            text = printable(shown)  # here at the latest: names and notes are foreign
            if style is None:
                out.append(text)
            elif self._color is None:
                # Not ``style.without_color``: it keeps the codes it has once made, colours included.
                out.append(Style(bold=style.bold, dim=style.dim).render(text, color_system=ColorSystem.STANDARD))
            else:
                out.append(style.render(text, color_system=self._color))
        return "".join(out)
