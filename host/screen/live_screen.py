"""The dashboard as a capture sees it: states go in, actions come out, nothing ever waits for the terminal."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from typing import IO, Any, TextIO

from host.output.lines import write_lines
from host.screen.dashboard.theme import Theme
from host.screen.keys import ScreenAction
from host.screen.pipe import FrameSender, decode_action
from host.screen.process import command_line, handle_signals
from host.screen.screens import Screen
from host.screen.terminal import Terminal
from host.text import plain
from host.trial.state import CycleRow, TrialState

STOP_S = 3.0
"""How long the screen process may take to release the terminal."""
_JOB_SIGNALS = ("SIGTSTP", "SIGTTOU", "SIGTTIN")


class LiveScreen(Screen):
    """Hands states to the process that draws them.

    While it is up, signals that would stop this program in the shell's way (Control-Z) are ignored: a stopped capture
    loses data. The keys of the screen offer to step aside instead. When the process fails, the ``fallback`` goes on.
    What fails in a thread of this screen is raised by the next call: see :mod:`host.screen.guarded_screen`.
    """

    def __init__(self, stream: TextIO, fallback: Screen, theme: Theme, bell: bool = False) -> None:
        self._stream = stream
        self._fallback = fallback
        self._theme = theme
        self._bell = bell
        self.process: subprocess.Popen[bytes] | None = None
        """Draws; None before and after."""
        self._frames: FrameSender | None = None
        self._terminal: Terminal | None = None
        self._rescued = False
        self._handlers: dict[int, Any] = {}
        self._actions: deque[ScreenAction] = deque()
        self._closed = threading.Event()
        self._reported: list[str] = []
        self._deaf: Exception | None = None  # why keys are no longer received

    @property
    def problems(self) -> tuple[str, ...]:
        """Whether the process that draws has failed."""
        failed = self._rescued and self.process is not None
        return ("the screen failed; the capture goes on with a line per cycle",) if failed else ()

    def start(self) -> None:
        """Start the process that draws; the terminal is its own from here on."""
        self._terminal = Terminal(self._stream.fileno())
        if threading.current_thread() is threading.main_thread():
            self._handlers = handle_signals(_JOB_SIGNALS, signal.SIG_IGN)
        descriptor = os.dup(self._stream.fileno())  # a number that no pipe has over there
        extra: dict[str, Any] = {} if sys.platform == "win32" else {"pass_fds": (descriptor,)}
        try:
            process = subprocess.Popen(  # noqa: S603 - our own program
                command_line(descriptor, self._theme),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                **extra,
            )
        finally:
            os.close(descriptor)
        assert process.stdin is not None
        assert process.stdout is not None
        self.process = process
        self._frames = FrameSender(process.stdin, self._bell)
        threading.Thread(target=self._receive, args=(process.stdout,), name="rotdrift-keys", daemon=True).start()

    def update(self, state: TrialState, index: int = 0) -> None:
        """Keep the state for the next picture; report alarms in lines when the screen has failed."""
        if self._failed():
            self._fallback.update(state, index)
        elif self._frames is not None:
            self._frames.update(state, index)

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Ignore the cycle, for it is in the state; report it in a line when the screen has failed."""
        if self._failed():
            self._fallback.cycle(row, index)

    def report(self, sentence: str) -> None:
        """Keep the sentence for when the terminal is free again; the state's warnings show it meanwhile."""
        if self._failed():
            self._fallback.report(sentence)
        else:
            self._reported.append(plain(sentence, 1000))

    def actions(self) -> list[ScreenAction]:
        """Return what was asked for since the last call."""
        self._failed()
        return [self._actions.popleft() for _ in range(len(self._actions))]

    def hold(self, timeout_s: float) -> bool:
        """Wait for a key, at most so long; True when one was pressed, or nobody can any more."""
        process = self.process
        return self._closed.wait(timeout_s) or process is None or process.poll() is not None

    def stop(self) -> None:
        """Release the terminal, then print what was reported; each step is taken, whatever became of the others."""
        process, self.process = self.process, None
        with contextlib.ExitStack() as steps:  # the last first
            steps.callback(self._print_reported)
            steps.callback(self._restore_signals)
            if process is not None:
                steps.callback(self._release, process)
                steps.callback(self._end, process)

    def _end(self, process: subprocess.Popen[bytes]) -> None:
        """Have the process end, or end it; it has released the terminal by then."""
        try:
            if self._frames is None:  # it was sent nothing yet
                assert process.stdin is not None
                process.stdin.close()
            else:
                self._frames.stop()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(STOP_S)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            if self._frames is not None:
                self._frames.join(1.0)

    def _release(self, process: subprocess.Popen[bytes]) -> None:
        if process.returncode != 0:
            self._rescue()
        if self._terminal is not None:
            self._terminal.release()
        for pipe in (process.stdin, process.stdout):
            with contextlib.suppress(OSError):
                pipe.close()  # type: ignore[union-attr]

    def _restore_signals(self) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()

    def _print_reported(self) -> None:
        reported, self._reported = self._reported, []
        with contextlib.suppress(OSError, ValueError):
            write_lines(reported, self._stream)

    def _failed(self) -> bool:
        """Return whether the screen process has ended by itself; then the terminal is restored, and lines go on.

        What ended a thread of this side is raised; without frames the process ends as well, so this comes first.
        """
        failure = self._deaf or (None if self._frames is None else self._frames.failure)
        if failure is not None:
            raise failure
        process = self.process
        if process is None or process.poll() is None:
            return False
        self._rescue()
        return True

    def _rescue(self) -> None:
        """Restore the terminal that the process has left acquired."""
        if not self._rescued and self._terminal is not None:
            self._terminal.rescue()
        self._rescued = True

    def _receive(self, pipe: IO[bytes]) -> None:
        try:
            for line in pipe:
                action = decode_action(line)
                if action is not None and action.kind == "close":
                    self._closed.set()
                elif action is not None:
                    self._actions.append(action)
        except (OSError, ValueError):  # the process has gone, and its pipe with it
            pass
        except Exception as error:  # noqa: BLE001 - a thread must not die in silence
            self._deaf = error
