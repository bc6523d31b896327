"""Commands to one object: each with a number of its own, one after the other where an answer decides how it goes on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from firmware_protocol.packets import Ack, Command

CommandMaker = Callable[[int], Command]
"""Makes a command of its number."""


@dataclass(slots=True)
class _InFlight:
    """A command that waits for its acknowledgement."""

    command: Command
    sent_ns: int
    tries: int


class CommandQueue:
    """What is to be sent, and what waits for its acknowledgement."""

    def __init__(self) -> None:
        self._last_id = 0
        self._outbox: list[Command] = []
        self._steps: deque[CommandMaker] = deque()  # each is sent when the one before is acknowledged
        self._in_flight: _InFlight | None = None

    @property
    def all_done(self) -> bool:
        """Whether no step is left."""
        return not self._steps

    def post(self, make: CommandMaker) -> None:
        """Send a command whose acknowledgement nobody waits for."""
        self._outbox.append(make(self._next_id()))

    def start(self, steps: Iterable[CommandMaker]) -> None:
        """Send commands one after the other, in place of those still to be sent or acknowledged."""
        self._steps, self._in_flight = deque(steps), None

    def forget(self) -> None:
        """Drop all that was to be sent or acknowledged: the link was cut."""
        self.start(())
        self._outbox.clear()

    def acknowledged(self, ack: Ack) -> Command | None:
        """Return the command that an acknowledgement is of; None where nothing waits for it."""
        command = None if self._in_flight is None else self._in_flight.command
        if command is None or (ack.command_id, ack.command_type) != (command.command_id, command.packet_type):
            return None
        self._in_flight = None
        return command

    def advance(self, now_ns: int, answer_s: float, tries: int) -> Command | None:
        """Send the next step, or the one in flight again when its answer is overdue.

        Return the command that was sent ``tries`` times in vain, and is given up; mostly None.
        """
        waiting = self._in_flight
        if waiting is None:
            if self._steps:
                self._in_flight = _InFlight(self._steps.popleft()(self._next_id()), now_ns, 1)
                self._outbox.append(self._in_flight.command)
        elif now_ns - waiting.sent_ns >= answer_s * 1e9:
            if waiting.tries >= tries:
                self._in_flight = None
                return waiting.command
            waiting.sent_ns = now_ns
            waiting.tries += 1
            self._outbox.append(waiting.command)
        return None

    def take(self) -> list[Command]:
        """Return what is to be sent now, and forget it."""
        outbox, self._outbox = self._outbox, []
        return outbox

    def _next_id(self) -> int:
        self._last_id = (self._last_id + 1) % 256
        return self._last_id
