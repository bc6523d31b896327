"""TIME_REQUEST and its answer: when the host asked, and what the device clock read."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.packets import TimeReply

UPTIME_MODULUS_US = 2**56
"""Of the u64 of a clock reading, as much as CAN carries: more cannot be, and would not fit what is worked out."""
MAX_TURN_US = 60_000_000
"""Longest time that an object may take to answer."""


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """One TIME_REQUEST and its answer, as a row of :class:`host.clock.interval.RoundTrips`.

    The device clock is that of the wire, without its high bits; its reading at the answer counts on from that at the
    request.
    """

    sent_ns: int
    receive_us: int
    transmit_us: int
    received_ns: int


def round_trip(sent_ns: int, reply: TimeReply, received_ns: int) -> RoundTrip | None:
    """Return the round trip that an answer ends; None where its two readings cannot be.

    Of the u64 only the low bits and the time between the two count. Between them the request was at the
    object, which cannot take longer than the whole way; 500 ppm of it are forgiven.
    """
    turn_us = reply.transmit_uptime_us - reply.receive_uptime_us
    if not 0 <= turn_us < MAX_TURN_US or 1000 * turn_us > received_ns - sent_ns + turn_us // 2:
        return None
    receive_us = reply.receive_uptime_us % UPTIME_MODULUS_US
    return RoundTrip(sent_ns, receive_us, receive_us + turn_us, received_ns)


class ClockRequests:
    """The request in flight, one at a time (a late answer is worth nothing), and the answers not collected yet."""

    def __init__(self, period_s: float, now_ns: int) -> None:
        self._period_ns = period_s * 1e9
        self._asked_ns = now_ns
        self._sent: tuple[int, int] | None = None  # command id, and when it was written
        self._found: list[RoundTrip] = []
        self.refused = 0
        """Answers whose readings of the device clock could not be."""

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
            found = round_trip(sent_ns, reply, host_time_ns)
            if found is None:
                self.refused += 1
            else:
                self._found.append(found)

    def take(self) -> list[RoundTrip]:
        """Return the answers since the last call, and forget them."""
        found, self._found = self._found, []
        return found
