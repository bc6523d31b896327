"""TIME_REQUEST and its answer: when the host asked, and what the device clock read."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.packets import TimeReply


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """One TIME_REQUEST and its answer, as a row of :class:`host.clock.interval.RoundTrips`; device times are u64."""

    sent_ns: int
    receive_us: int
    transmit_us: int
    received_ns: int


class ClockRequests:
    """The request in flight, one at a time (a late answer is worth nothing), and the answers not collected yet."""

    def __init__(self, period_s: float, now_ns: int) -> None:
        self._period_ns = period_s * 1e9
        self._asked_ns = now_ns
        self._sent: tuple[int, int] | None = None  # command id, and when it was written
        self._found: list[RoundTrip] = []

    def due(self, now_ns: int) -> bool:
        """Return whether it is time for another request; the one before is given up then."""
        if now_ns - self._asked_ns < self._period_ns:
            return False
        self._asked_ns, self._sent = now_ns, None
        return True

    def sent(self, command_id: int, now_ns: int) -> None:
        """Note when a request is written."""
        self._sent = command_id, now_ns

    def forget(self) -> None:
        """Give up the request in flight: the link was cut."""
        self._sent = None

    def receive(self, reply: TimeReply, host_time_ns: int) -> None:
        """Match an answer with its request."""
        if self._sent is not None and self._sent[0] == reply.command_id:
            sent_ns, self._sent = self._sent[1], None
            self._found.append(RoundTrip(sent_ns, reply.receive_uptime_us, reply.transmit_uptime_us, host_time_ns))

    def take(self) -> list[RoundTrip]:
        """Return the answers since the last call, and forget them."""
        found, self._found = self._found, []
        return found
