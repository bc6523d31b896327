"""What goes between a capture and the process that draws it: states one way, actions the other.

Both ends are this program, so the states travel as pickles; actions are lines of JSON.
"""

from __future__ import annotations

import json
import pickle
import struct
from dataclasses import asdict, dataclass, replace
from typing import IO

from host.screen.keys import ScreenAction
from host.trial.state import CycleRow, TrialState

_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class ScreenSettings:
    """How the screen process draws."""

    ascii_only: bool = False
    light: bool = False
    color: str | None = "standard"
    """Colours of the terminal as rich names them: ``standard``, ``256``, ``truecolor``; None without any."""
    bell: bool = False


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
    """The end: give the terminal back."""

    in_order: bool = True
    """False where the capture is gone without a word."""


Message = Frame | Stop


def send(file: IO[bytes], message: Message) -> None:
    """Write a message; waits while the pipe is full."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    file.write(_LENGTH.pack(len(data)) + data)
    file.flush()


def receive(file: IO[bytes]) -> Message:
    """Read a message; a :class:`Stop` out of order when the other side is gone."""
    head = file.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return Stop(in_order=False)
    (length,) = _LENGTH.unpack(head)
    data = file.read(length)
    if len(data) < length:
        return Stop(in_order=False)
    message: Message = pickle.loads(data)  # noqa: S301 - from our own other half, through an anonymous pipe
    return message


def encode_action(action: ScreenAction) -> bytes:
    """Write an action as a line."""
    return json.dumps(asdict(action)).encode() + b"\n"


def decode_action(line: bytes) -> ScreenAction | None:
    """Read an action; None where the line is none."""
    try:
        return ScreenAction(**json.loads(line))
    except (ValueError, TypeError):
        return None


def without_cycles(state: TrialState) -> TrialState:
    """Leave the cycles out of a state."""
    return replace(state, cycles=())
