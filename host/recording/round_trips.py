"""TIME_REQUEST and its answer, found again in a recording: what bounds the offset of the two clocks offline."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable

import numpy as np

from firmware_protocol.codec import decode_packet
from firmware_protocol.errors import MalformedPacketError, ProtocolError
from firmware_protocol.packets import TimeReply, TimeRequest
from firmware_protocol.serial_framing import FrameDecoder
from firmware_protocol.stream import StreamItem
from host.clock.interval import NO_ROUND_TRIPS, RoundTrips
from host.transports.chunks import AnyChunk

MAX_ROUND_TRIPS = 200_000
"""Two days of them; more are not kept."""
SAME_ID_KEPT = 4
"""Requests remembered with one command id: it comes again after 256 commands."""


class RecordedRoundTrips:
    """Gathers the round trips of one recording."""

    def __init__(self) -> None:
        self._sent_ns: dict[int, deque[int]] = defaultdict(lambda: deque(maxlen=SAME_ID_KEPT))
        self._found: list[tuple[int, int, int, int]] = []

    def feed_sent(self, data: bytes, host_time_ns: int) -> None:
        """Take what the host sent, framed or (CAN) as the bare packet; what is no TIME_REQUEST is passed over."""
        for packet in FrameDecoder().feed(data) if data[:1] == b"\0" else [data]:
            try:
                command = decode_packet(packet)
            except ProtocolError:
                continue
            if isinstance(command, TimeRequest):
                self._sent_ns[command.command_id].append(host_time_ns)

    def feed(self, reply: TimeReply, received_ns: int) -> None:
        """Take an answer, and when the chunk was received that completed it."""
        sent_ns = self.sent_ns(reply, received_ns)
        if sent_ns is not None and len(self._found) < MAX_ROUND_TRIPS:
            self._found.append((sent_ns, reply.receive_uptime_us, reply.transmit_uptime_us, received_ns))

    def sent_ns(self, reply: TimeReply, received_ns: int) -> int | None:
        """When the request was sent that a reply answers; None where there is none."""
        return max((at_ns for at_ns in self._sent_ns[reply.command_id] if at_ns <= received_ns), default=None)

    def feed_frames(self, parts: list[AnyChunk], items: Iterable[StreamItem]) -> None:
        """Take chunks of CAN frames that were decoded together, and what they gave; each frame has its own time."""
        for item in items:
            if isinstance(item, TimeReply):
                self.feed(item, _can_arrival(parts))

    def round_trips(self) -> RoundTrips:
        """Give what was found, in order of arrival."""
        if not self._found:
            return NO_ROUND_TRIPS
        # Uptimes are u64; of a damaged one only the low bits matter, as of any.
        columns = np.array([[value & (2**62 - 1) for value in trip] for trip in self._found], dtype=np.int64)
        return RoundTrips(*columns[np.argsort(columns[:, 3], kind="stable")].T)


def _can_arrival(parts: list[AnyChunk]) -> int:
    """Give the time of the last frame that can have been part of a reply."""
    from firmware_protocol.can_frames import frame_array
    from firmware_protocol.can_mapping import FD_BIT, NODE_BITS, CanFunction

    try:
        records = frame_array(b"".join(part.data for part in parts))
    except MalformedPacketError:
        return parts[-1].host_time_ns
    function = (records["arbitration_id"] & ~np.uint32(FD_BIT)) >> NODE_BITS
    times = records["host_time_ns"][
        (function == CanFunction.TIME_REPLY_RECEIVE) | (function == CanFunction.TIME_REPLY_TRANSMIT)
    ]
    return int(times.max()) if len(times) else parts[-1].host_time_ns
