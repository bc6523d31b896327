"""The process that draws: ``python -m host.screen.process``, started by :class:`host.screen.live_screen.LiveScreen`.

A process of its own, so that drawing never holds Python's lock while the capture reads, and a terminal that accepts
nothing (a slow ssh) stops nobody but this process. When the capture ends or dies, it releases the terminal.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from dataclasses import asdict
from typing import Any, BinaryIO

from host.screen.dashboard.picture import Theme, View, picture
from host.screen.keys import KeyReader
from host.screen.painter import Painter
from host.screen.pipe import Frame, Stop, encode_action, receive
from host.screen.terminal import Terminal, TerminalLostError
from host.trial.state import CycleRow, TrialState

FRAME_S = 0.1
"""Shortest time between two pictures: 10 a second."""
CALM_S = 0.22
"""Time between two pictures when nothing happened that a person waits for."""
NICE = 5
"""By how much the capture goes before, where both want the processor."""
GONE = "\r\nThe capture was ended from outside; its recording is kept.\r\n"
_IGNORED = ("SIGINT", "SIGQUIT", "SIGTERM", "SIGHUP", "SIGTSTP", "SIGTTOU", "SIGTTIN", "SIGBREAK")
"""Signals that do not end this process: only the capture decides when it ends."""


class ScreenProcess:
    """Draws frames, reads keys.

    Three threads: one receives frames, one reads keys, and :meth:`run` draws. They share what is under ``_changed``.
    The terminal is acquired and released by the caller.
    """

    def __init__(self, terminal: Terminal, theme: Theme, frames: BinaryIO, actions: BinaryIO) -> None:
        self._terminal = terminal
        self._frames = frames
        self._actions = actions
        self._painter = Painter(terminal, theme)
        self._changed = threading.Condition()
        self._keys = KeyReader(View(theme=theme))
        self._states: tuple[TrialState, ...] = (TrialState(),)
        self._shown: tuple[TrialState, ...] = self._states  # older than the newest while the picture is paused
        self._cycles: dict[int, tuple[CycleRow, ...]] = {}
        self._stop: Stop | None = None
        self._news = True  # there is something to draw
        self._urgent = True  # and a person waits for it
        self._bell = False

    def run(self) -> None:
        """Draw until the capture ends or is gone."""
        for work in (self._receive, self._read_keys):
            threading.Thread(target=work, daemon=True).start()
        try:
            stop = self._draw_until_stop()
            if stop.in_order and self._terminal.in_foreground():
                self._draw()
            self._painter.leave("" if stop.in_order else GONE)
        except TerminalLostError:
            with self._changed:  # frames are received until the capture ends, so that it never waits for us
                while self._stop is None:
                    self._changed.wait(1.0)

    def wake(self) -> None:
        """Draw everything again: the process was stopped and goes on, or the window changed."""
        self._painter.forget()

    def _draw_until_stop(self) -> Stop:
        drawn_s = 0.0
        while True:
            with self._changed:
                due_s = drawn_s + (FRAME_S if self._urgent else CALM_S)
                wait_s = due_s - time.monotonic()
                if self._stop is not None:
                    return self._stop
                if wait_s > 0:
                    self._changed.wait(wait_s)  # something urgent may come meanwhile, and be due earlier
                    continue
                news = self._news
                self._urgent = self._news = False
            drawn_s = time.monotonic()
            if not self._terminal.in_foreground():
                self._painter.forget()  # a shell has the terminal; once it is ours again everything is drawn
            elif news or self._painter.is_stale:
                self._draw()

    def _draw(self) -> None:
        """Paint the newest states, unless the last picture has not reached the terminal yet."""
        if not self._painter.flush():
            return
        if self._keys.aside:
            self._painter.step_aside()
            return
        with self._changed:
            view = self._keys.view
            if not view.paused or any(state.score.finished for state in self._states):
                self._shown = self._states
            bell, self._bell = self._bell, False
        size = self._terminal.size()
        self._painter.paint(picture(self._shown, view, *size), size, bell)

    def _receive(self) -> None:
        while self._stop is None:
            message = receive(self._frames)
            with self._changed:
                if isinstance(message, Frame):
                    self._cycles.update(message.cycles)
                    self._states = tuple(
                        state.with_cycles(self._cycles.get(index, ())) for index, state in enumerate(message.states)
                    )
                    self._news = True
                    self._urgent = self._urgent or message.urgent
                    self._bell = self._bell or message.bell
                else:
                    self._stop = message
                if self._urgent or self._stop is not None:
                    self._changed.notify()

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


def main() -> None:
    """Run the process; see :class:`host.screen.live_screen.LiveScreen` for its arguments."""
    descriptor, theme = int(sys.argv[1]), Theme(**json.loads(sys.argv[2]))
    handle_signals(_IGNORED, signal.SIG_IGN)
    if sys.platform != "win32":
        with contextlib.suppress(OSError):
            os.nice(NICE)
    # A picture that stands still would be worse than none: the capture restores the terminal, and goes on in lines.
    threading.excepthook = lambda _: os._exit(1)
    terminal = Terminal(descriptor)
    try:
        terminal.acquire()
        process = ScreenProcess(terminal, theme, sys.stdin.buffer, sys.stdout.buffer)
        handle_signals(("SIGCONT", "SIGWINCH"), lambda *_: process.wake())
        process.run()
    finally:
        terminal.release()
    sys.stdout.flush()
    os._exit(0)  # threads that wait for keys or frames have nothing left to do


def handle_signals(names: tuple[str, ...], handler: Any) -> dict[int, Any]:  # noqa: ANN401 - as signal.signal has it
    """Set the handler of those signals that this system has; return their handlers before."""
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return {number: signal.signal(number, handler) for number in numbers}


def command_line(descriptor: int, theme: Theme) -> list[str]:
    """Return the command line of the process."""
    return [sys.executable, "-P", "-m", "host.screen.process", str(descriptor), json.dumps(asdict(theme))]


if __name__ == "__main__":
    main()
