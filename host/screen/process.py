"""The process that draws: ``python -m host.screen.process``, started by :class:`host.screen.live_screen.LiveScreen`.

A process of its own, so that drawing never holds Python's lock while the capture reads, and a terminal that takes
nothing (a slow ssh) stops nobody but this process. When the capture ends or dies, it gives the terminal back.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from dataclasses import asdict, replace
from typing import BinaryIO

from rich.color import ColorSystem
from rich.console import Console
from rich.style import Style
from rich.text import Text

from host.screen.dashboard.picture import Look, View, picture
from host.screen.keys import KeyReader
from host.screen.pipe import Frame, ScreenSettings, Stop, encode_action, receive
from host.screen.terminal import CLEAR, ENTER, LEAVE, Terminal, TerminalLostError
from host.trial.state import CycleRow, TrialState

FRAME_S = 0.1
"""Shortest time between two pictures: 10 a second."""
CALM_S = 0.22
"""Time between two pictures when nothing happened that a person waits for."""
NICE = 5
"""By how much the capture goes before, where both want the processor."""
LEAVE_S = 1.0
"""How long to wait at the end for a terminal that takes nothing."""
GONE = "\r\nThe capture was ended from outside; its recording is kept.\r\n"
ASIDE = "\r\nThe capture goes on. Press any key to come back to its screen; q there ends it.\r\n"
_COLORS = {"standard": ColorSystem.STANDARD, "256": ColorSystem.EIGHT_BIT, "truecolor": ColorSystem.TRUECOLOR}


class ScreenProcess:
    """Draws frames, reads keys.

    Parameters
    ----------
    terminal : Terminal
        Taken here, given back at the end.
    settings : ScreenSettings
        How to draw.
    frames, actions : binary file
        From and to the capture.
    """

    def __init__(self, terminal: Terminal, settings: ScreenSettings, frames: BinaryIO, actions: BinaryIO) -> None:
        self._terminal = terminal
        self._settings = settings
        self._frames = frames
        self._actions = actions
        self._changed = threading.Condition()
        self._states: tuple[TrialState, ...] = (TrialState(),)
        self._shown: tuple[TrialState, ...] = self._states
        self._cycles: dict[int, tuple[CycleRow, ...]] = {}
        self._keys = KeyReader(View(look=Look(settings.ascii_only, settings.light)))
        self._stop: Stop | None = None
        self._urgent = self._news = True
        self._bell = False
        self._anew = True
        self._lines: list[str] = []
        self._size = (0, 0)
        self._unsent = b""
        self._was_aside = False
        self._console = Console(color_system=None, file=sys.stderr)  # rich wants one even to split a text into styles

    def run(self) -> None:
        """Draw until the capture says stop or is gone."""
        for work in (self._receive, self._read_keys):
            threading.Thread(target=work, daemon=True).start()
        drawn_s = 0.0
        try:
            while True:
                with self._changed:
                    now_s = time.monotonic()
                    due_s = drawn_s + (FRAME_S if self._urgent else CALM_S)
                    stop = self._stop
                    if stop is None and now_s < due_s:
                        self._changed.wait(due_s - now_s)
                        continue
                    news = self._news or self._anew or self._unsent or self._terminal.size() != self._size
                    self._urgent = self._news = False
                drawn_s = time.monotonic()
                if stop is not None:
                    break
                if not self._terminal.in_foreground():
                    self._anew = True  # a shell has the terminal; once it is ours again everything is drawn
                elif news:
                    self._draw()
            if stop.in_order and self._terminal.in_foreground():
                self._draw()
            self._leave("" if stop.in_order else GONE)
        except TerminalLostError:
            self._drain()

    def wake(self) -> None:
        """Draw everything again: the process was stopped and goes on, or the window changed."""
        self._anew = True

    def _receive(self) -> None:
        while True:
            message = receive(self._frames)
            with self._changed:
                if isinstance(message, Frame):
                    self._cycles.update(message.cycles)
                    self._states = tuple(
                        replace(state, cycles=self._cycles.get(index, ())) for index, state in enumerate(message.states)
                    )
                    self._news = True
                    self._urgent = self._urgent or message.urgent
                    self._bell = self._bell or message.bell
                else:
                    self._stop = message
                if self._urgent or self._stop is not None:
                    self._changed.notify()
            if isinstance(message, Stop):
                return

    def _read_keys(self) -> None:
        with contextlib.suppress(TerminalLostError, OSError, ValueError):
            while True:
                typed = self._terminal.read(1.0)
                if not typed:
                    continue
                with self._changed:
                    actions = self._keys.press(typed, self._shown)
                    self._urgent = self._news = True
                    self._changed.notify()
                for action in actions:
                    self._actions.write(encode_action(action))
                    self._actions.flush()

    def _draw(self) -> None:
        """Write the lines that changed; nothing while the terminal has not taken the last picture."""
        self._flush()
        if self._unsent:
            return
        if self._keys.aside:
            if not self._was_aside:
                self._unsent = (LEAVE + ASIDE).encode()
                self._was_aside = True
            self._flush()
            return
        anew = self._was_aside or self._anew
        self._was_aside = self._anew = False
        with self._changed:
            view = self._keys.view
            if not view.paused or any(state.finished for state in self._states):
                self._shown = self._states
        size = self._terminal.size()
        lines = [self._codes(line) for line in picture(self._shown, view, *size)]
        before = self._lines if size == self._size and not anew else [""] * len(lines)
        pairs = enumerate(zip(lines, before, strict=True), start=1)
        changed = [f"\x1b[{row};1H{line}" for row, (line, old) in pairs if line != old]
        if self._bell:
            self._bell = False
            changed.append("\a")
        if not self._terminal.in_foreground():  # the process was stopped while it drew
            self._anew = True
            return
        if anew:
            self._terminal.take()
        start = ENTER if anew else "" if size == self._size else CLEAR
        self._lines, self._size = lines, size
        encoding = "ascii" if self._settings.ascii_only else "utf-8"
        self._unsent = (start + "".join(changed)).encode(encoding, "replace")
        self._flush()

    def _codes(self, line: Text) -> str:
        """Turn a line into text with colour codes."""
        out = []
        system = _COLORS.get(self._settings.color or "")
        for text, style, _ in line.render(self._console):
            if style is None:
                out.append(text)
            elif system is None:
                # Not ``style.without_color``: it keeps the codes it has once made, colours included.
                bare = Style(bold=style.bold, dim=style.dim)
                out.append(bare.render(text, color_system=ColorSystem.STANDARD))
            else:
                out.append(style.render(text, color_system=system))
        return "".join(out)

    def _flush(self) -> None:
        while self._unsent:
            written = self._terminal.write(self._unsent)
            if not written:
                return
            self._unsent = self._unsent[written:]

    def _leave(self, last_words: str) -> None:
        """Leave the screen; a terminal that takes nothing gets a second to change its mind."""
        self._unsent += ("" if self._was_aside else LEAVE).encode() + last_words.encode()
        end_s = time.monotonic() + LEAVE_S
        while self._unsent and time.monotonic() < end_s:
            self._flush()
            if self._unsent:
                time.sleep(0.02)

    def _drain(self) -> None:
        """Without a terminal: take frames until the capture ends, so that it never waits for us."""
        with self._changed:
            while self._stop is None:
                self._changed.wait(1.0)


def main() -> None:
    """Run the process; see :class:`host.screen.live_screen.LiveScreen` for its arguments."""
    descriptor, settings = int(sys.argv[1]), ScreenSettings(**json.loads(sys.argv[2]))
    for name in ("SIGINT", "SIGQUIT", "SIGTERM", "SIGHUP", "SIGTSTP", "SIGTTOU", "SIGTTIN", "SIGBREAK"):
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)  # only the capture decides when this ends
    if sys.platform != "win32":
        with contextlib.suppress(OSError):
            os.nice(NICE)
    terminal = Terminal(descriptor)
    try:
        terminal.take()
        process = ScreenProcess(terminal, settings, sys.stdin.buffer, sys.stdout.buffer)
        for name in ("SIGCONT", "SIGWINCH"):
            number = getattr(signal, name, None)
            if number is not None:
                signal.signal(number, lambda *_: process.wake())
        process.run()
    finally:
        terminal.give_back()
    sys.stdout.flush()
    os._exit(0)  # threads that wait for keys or frames have nothing left to do


def arguments(descriptor: int, settings: ScreenSettings) -> list[str]:
    """Give the command line of the process."""
    return [sys.executable, "-P", "-m", "host.screen.process", str(descriptor), json.dumps(asdict(settings))]


if __name__ == "__main__":
    main()
