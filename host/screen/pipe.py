"""What goes between a capture and the process that draws it: states one way, actions the other.

Both ends are this program, so the states travel as pickles; actions are lines of JSON.
"""

from __future__ import annotations

import contextlib
import json
import pickle
import threading
from dataclasses import asdict, dataclass
from typing import IO

from host.screen.keys import ScreenAction
from host.trial.state import CycleRow, TrialState


@dataclass(frozen=True, slots=True)
class Frame:
    """States to draw. Cycles travel only when they changed: there may be hundreds."""

    states: tuple[TrialState, ...]
    """Without their cycles."""
    cycles: dict[int, tuple[CycleRow, ...]]
    """Object -> its cycles, where they changed."""
    urgent: bool = False
    """Whether something happened that a person waits for."""
    bell: bool = False


@dataclass(frozen=True, slots=True)
class Stop:
    """The end: release the terminal."""

    in_order: bool = True
    """False where the capture is gone without a word."""


Message = Frame | Stop


def send(file: IO[bytes], message: Message) -> None:
    """Write a message; waits while the pipe is full."""
    file.write(pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL))  # whole, or nothing of it
    file.flush()


def receive(file: IO[bytes]) -> Message:
    """Return the next message; a :class:`Stop` out of order when the other side is gone."""
    try:
        message: Message = pickle.load(file)  # noqa: S301 - from our own other half, through an anonymous pipe
    except (EOFError, pickle.UnpicklingError):
        return Stop(in_order=False)
    return message


def encode_action(action: ScreenAction) -> bytes:
    """Return an action as a line."""
    return json.dumps(asdict(action)).encode() + b"\n"


def decode_action(line: bytes) -> ScreenAction | None:
    """Return the action in a line; None where there is none."""
    try:
        return ScreenAction(**json.loads(line))
    except (ValueError, TypeError):
        return None


class FrameSender:
    """Sends the newest states in a thread of its own; those that come faster than they are received are left out.

    The pipe is closed at the end. With ``bell``, the terminal is to ring at new alarms and at the end.
    """

    def __init__(self, file: IO[bytes], bell: bool) -> None:
        self._file = file
        self._bell = bell
        self._changed = threading.Condition()
        self._states: dict[int, TrialState] = {0: TrialState()}
        self._sent: dict[int, TrialState] = {}
        self._news = self._stopping = False
        self.failure: Exception | None = None
        """What ended the thread, unless the process has gone; its pipe is closed then."""
        self._thread = threading.Thread(target=self._run, name="rotdrift-screen", daemon=True)
        self._thread.start()

    def update(self, state: TrialState, index: int) -> None:
        """Keep the state of an object for the next frame."""
        with self._changed:
            self._states[index] = state
            self._news = True
            self._changed.notify()

    def stop(self) -> None:
        """Have the last states and the end sent."""
        with self._changed:
            self._stopping = True
            self._changed.notify()

    def join(self, timeout_s: float) -> None:
        """Wait for the thread."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        try:
            self._send_until_stop()
        except (OSError, ValueError):  # the process has gone: whoever started it sees that
            pass
        except Exception as error:  # noqa: BLE001 - a thread must not die in silence
            self.failure = error
        with contextlib.suppress(OSError, ValueError):
            send(self._file, Stop())
            self._file.close()

    def _send_until_stop(self) -> None:
        stopping = False
        while not stopping:
            with self._changed:
                while not self._news and not self._stopping:
                    self._changed.wait()
                states = dict(sorted(self._states.items()))
                news, self._news = self._news, False
                stopping = self._stopping
            if news:
                send(self._file, self._frame(states))

    def _frame(self, states: dict[int, TrialState]) -> Frame:
        """Return what to send of the states, given what was sent before."""
        cycles, urgent, ring = {}, False, False
        for index, state in states.items():
            before = self._sent.get(index, TrialState())
            if index not in self._sent or state.score.cycles != before.score.cycles:
                cycles[index] = state.score.cycles
            known = {alarm.kind for alarm in before.alarms}
            done = state.score.finished and not before.score.finished
            urgent = urgent or index in cycles or state.alarms != before.alarms or done
            ring = ring or done or any(alarm.kind not in known for alarm in state.alarms)
        self._sent = states
        return Frame(tuple(state.with_cycles(()) for state in states.values()), cycles, urgent, ring and self._bell)
