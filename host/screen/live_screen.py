"""The dashboard as a capture sees it: states go in, actions come out, nothing ever waits for the terminal."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from typing import Any, Protocol, TextIO, cast

from host.screen.keys import ScreenAction
from host.screen.pipe import Frame, ScreenSettings, Stop, decode_action, send, without_cycles
from host.screen.process import arguments
from host.screen.terminal import in_foreground, restore, save_modes
from host.text import plain
from host.trial.state import CycleRow, TrialState

STOP_S = 3.0
"""How long the screen process may take to give the terminal back."""
_JOB_SIGNALS = ("SIGTSTP", "SIGTTOU", "SIGTTIN")


class Lines(Protocol):
    """Tells of cycles and alarms in lines."""

    def update(self, state: TrialState, index: int = 0) -> None:
        """Tell of new alarms."""

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Tell of a cycle."""

    def say(self, sentence: str) -> None:
        """Tell a person something once."""


class LiveScreen:
    """Hands states to the process that draws them.

    While it is up, signals that would stop this program in the shell's way (Control-Z) are ignored: a stopped capture
    loses data. The keys of the screen offer to step aside instead.

    Parameters
    ----------
    stream : text file
        Of the terminal.
    without : Lines
        Who goes on when the screen process fails.
    settings : ScreenSettings
        How to draw.
    """

    def __init__(self, stream: TextIO, without: Lines, settings: ScreenSettings | None = None) -> None:
        self._stream = stream
        self._descriptor = stream.fileno()
        self._settings = settings or ScreenSettings()
        self._process: subprocess.Popen[bytes] | None = None
        self._modes: list[Any] | None = None
        self._changed = threading.Condition()
        self._states: dict[int, TrialState] = {0: TrialState()}
        self._dirty = self._stopping = False
        self._actions: deque[ScreenAction] = deque()
        self._closed = threading.Event()
        self._said: list[str] = []
        self._handlers: dict[int, Any] = {}
        self._sender: threading.Thread | None = None
        self._without = without
        self._given_back = False

    @property
    def process_id(self) -> int | None:
        """Number of the process that draws; None before and after."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Take the terminal."""
        self._modes = save_modes(self._descriptor)
        if threading.current_thread() is threading.main_thread():
            for name in _JOB_SIGNALS:
                number = getattr(signal, name, None)
                if number is not None:
                    self._handlers[number] = signal.signal(number, signal.SIG_IGN)
        terminal = os.dup(self._descriptor)  # a number that is not taken by a pipe over there
        extra: dict[str, Any] = {} if sys.platform == "win32" else {"pass_fds": (terminal,)}
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            arguments(terminal, self._settings),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            **extra,
        )
        os.close(terminal)
        self._sender = threading.Thread(target=self._send, name="rotdrift-screen", daemon=True)
        self._sender.start()
        threading.Thread(target=self._receive, name="rotdrift-keys", daemon=True).start()

    def update(self, state: TrialState, index: int = 0) -> None:
        """Keep the state for the next picture; tell of alarms in lines when the screen has failed."""
        if self._failed():
            self._without.update(state, index)
            return
        with self._changed:
            self._states[index] = state
            self._dirty = True
            self._changed.notify()

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Ignore the cycle, for it is in the state; tell of it in a line when the screen has failed."""
        if self._failed():
            self._without.cycle(row, index)

    def say(self, sentence: str) -> None:
        """Keep the sentence for when the terminal is free again; the state's warnings show it meanwhile."""
        if self._failed():
            self._without.say(sentence)
        else:
            self._said.append(plain(sentence, 1000))

    def actions(self) -> list[ScreenAction]:
        """Give what was pressed since the last call."""
        taken = []
        while self._actions:
            taken.append(self._actions.popleft())
        return taken

    def hold(self, timeout_s: float) -> bool:
        """Wait for a key, at most so long; True when one was pressed, or nobody can any more."""
        process = self._process
        return self._closed.wait(timeout_s) or process is None or process.poll() is not None

    def stop(self) -> None:
        """Give the terminal back, then print what was said. May be called twice."""
        process, self._process = self._process, None
        if process is not None:
            with self._changed:
                self._stopping = True
                self._changed.notify()
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if self._sender is not None:
                self._sender.join(1.0)
            if process.returncode != 0 and not self._given_back and in_foreground(self._descriptor):
                restore(self._descriptor, self._modes)
            for pipe in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):
                    cast(Any, pipe).close()
            for number, handler in self._handlers.items():
                signal.signal(number, handler)
            self._handlers.clear()
        said, self._said = self._said, []
        with contextlib.suppress(OSError, ValueError):
            for sentence in said:
                print(sentence, file=self._stream)
            self._stream.flush()

    def _failed(self) -> bool:
        """Whether the screen process has ended by itself; then the terminal is taken back once, and lines go on."""
        process = self._process
        if process is None or process.poll() is None:
            return False
        if not self._given_back:
            self._given_back = True
            restore(self._descriptor, self._modes)
            self._without.say("the screen failed; the capture goes on with a line per cycle")
        return True

    def _send(self) -> None:
        """Send the newest states; those that come faster than the screen process takes them are left out."""
        process = self._process
        assert process is not None
        assert process.stdin is not None
        sent: dict[int, TrialState] = {}
        with contextlib.suppress(OSError, ValueError):
            while True:
                with self._changed:
                    while not self._dirty and not self._stopping:
                        self._changed.wait()
                    states = dict(sorted(self._states.items()))
                    dirty, self._dirty = self._dirty, False
                    stopping = self._stopping
                if dirty:
                    send(process.stdin, self._frame(states, sent))
                    sent = states
                if stopping:
                    send(process.stdin, Stop())
                    process.stdin.close()
                    return

    def _frame(self, states: dict[int, TrialState], sent: dict[int, TrialState]) -> Frame:
        cycles, urgent, ring = {}, False, False
        for index, state in states.items():
            before = sent.get(index)
            if before is None or state.cycles != before.cycles:
                cycles[index] = state.cycles
            known = () if before is None else before.alarms
            new_alarm = any(alarm.kind not in {other.kind for other in known} for alarm in state.alarms)
            done = state.finished and (before is None or not before.finished)
            urgent = urgent or index in cycles or state.alarms != known or done
            ring = ring or new_alarm or done
        return Frame(
            tuple(without_cycles(state) for state in states.values()), cycles, urgent, ring and self._settings.bell
        )

    def _receive(self) -> None:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        with contextlib.suppress(OSError, ValueError):
            for line in process.stdout:
                action = decode_action(line)
                if action is None:
                    continue
                if action.kind == "close":
                    self._closed.set()
                else:
                    self._actions.append(action)
