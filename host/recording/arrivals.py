"""When each sample of a recording arrived, and which answer belongs to which TIME_REQUEST, for the offline clock.

A recording is decoded many chunks at a time, because a chunk of one sample costs as much as one of a hundred. The
decoder reports where each frame ends, and so which of the chunks brought it. Requests and their answers bound the
offset of the two clocks.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from analysis.scoring.recorded_parts import ClockSegment, ClockStep, OfflineClock
from analysis.scoring.result_parts import known
from firmware_protocol.codec import decode_packet
from firmware_protocol.errors import MalformedPacketError, ProtocolError
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import OrientationBatch, TimeReply, TimeRequest
from firmware_protocol.serial.framing import FrameDecoder
from host.clock.interval import NO_ROUND_TRIPS, RoundTrips
from host.clock.remap import RemappedClock, remap
from host.links.transport import AnyChunk
from host.stream.blocks import RESET, UnwrappedSamples
from host.stream.round_trips import RoundTrip, round_trip
from host.stream.samples import SampleAssembler

IntArray = npt.NDArray[np.int64]

UNKNOWN = -1
"""Arrival of a sample whose chunk is not known."""
MAX_CHUNKS = 200_000
"""Longer recordings are thinned to about so many arrivals: still hundreds in every second that matters."""


class SampleArrivals:
    """Gathers device time and arrival of the samples of one recording.

    Arrivals are known as the samples come, device times as the recording's assembler, which also decides where segments
    start, places them: maybe later, maybe never. Both are counted from the first sample that came.
    """

    def __init__(self, assembler: SampleAssembler) -> None:
        self._arrivals: list[IntArray] = []  # of all that came; UNKNOWN where the chunk is not known
        self._n_came = 0
        self._firsts: list[int] = []  # of each piece placed
        self._times_us: list[IntArray] = []
        self._reason = ""  # why a segment starts with the next piece
        self._starts: list[int] = []
        self._jumps: list[int] = []
        self.n_unplaced = 0
        """Samples whose chunk is not known; they are left out here."""
        assembler.on_segment.append(self._segment_starts)
        assembler.on_samples.append(self._place)

    def reopened(self) -> None:
        """Note that the link was opened again: the device may have been reset."""
        self._starts.append(self._n_came)

    def came(self, arrival_ns: IntArray) -> None:
        """Note n samples that came: when (n,) the chunk was received that completed each."""
        self._arrivals.append(arrival_ns)
        self._n_came += len(arrival_ns)

    def came_in_frames(self, parts: list[AnyChunk], items: Iterable[StreamItem]) -> None:
        """Note the samples of chunks of CAN frames that were decoded together; each frame has its own time."""
        arrivals = _frame_times(parts, "ORIENTATION")
        if len(arrivals) == _n_samples(items):
            self.came(arrivals)
        else:
            self.came_unknown(items)

    def came_unknown(self, items: Iterable[StreamItem]) -> None:
        """Note samples that the decoder held to the end: by then their chunk is not known any more."""
        n = _n_samples(items)
        self.n_unplaced += n
        self.came(np.full(n, UNKNOWN))

    def _segment_starts(self, reason: str) -> None:
        self._reason = reason

    def _place(self, samples: UnwrappedSamples) -> None:
        if self._reason and self._firsts:
            (self._starts if self._reason == RESET else self._jumps).append(samples.first)
        self._reason = ""
        self._firsts.append(samples.first)
        self._times_us.append(samples.device_time_us)

    def samples(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return the n samples that were placed and whose chunk is known, in order.

        Returns
        -------
        numbers : (n,) int64
            How many samples came before each.
        device_time_us : (n,) int64
            Unwrapped.
        arrival_ns : (n,) int64
            When the chunk was received that completed each.
        """
        if not self._firsts:
            return (np.empty(0, np.int64),) * 3
        pieces = zip(self._firsts, self._times_us, strict=True)
        numbers = np.concatenate([np.arange(first, first + len(times_us)) for first, times_us in pieces])
        times_us, arrivals = np.concatenate(self._times_us), np.concatenate(self._arrivals)[numbers]
        known = arrivals != UNKNOWN
        return (numbers, times_us, arrivals) if known.all() else (numbers[known], times_us[known], arrivals[known])

    def remapped(self, round_trips: RoundTrips = NO_ROUND_TRIPS) -> RemappedClock | None:
        """Run the clock's offline pass; None where no sample's arrival is known."""
        numbers, times_us, arrivals = self.samples()
        if not len(numbers):
            return None
        arrivals = np.maximum.accumulate(arrivals)
        step = 1 + (1 + int(np.count_nonzero(np.diff(arrivals)))) // MAX_CHUNKS
        if step > 1:
            chunk = np.cumsum(np.diff(arrivals, prepend=arrivals[0]) > 0)
            keep = np.flatnonzero(chunk % step == 0)
            numbers, times_us, arrivals = numbers[keep], times_us[keep], arrivals[keep]
        starts, jumps = (np.searchsorted(numbers, places).tolist() for places in (self._starts, self._jumps))
        return remap(times_us, arrivals, starts, jumps, round_trips=round_trips)


def _n_samples(items: Iterable[StreamItem]) -> int:
    return sum(len(item) for item in items if isinstance(item, OrientationBatch))


def _frame_times(parts: list[AnyChunk], *functions: str) -> IntArray:
    """Return the times of the CAN frames that have some functions (by name), ns; none where the data are damaged."""
    from firmware_protocol.can.frames import FrameFlag, frame_array
    from firmware_protocol.can.mapping import FD_BIT, NODE_BITS, CanFunction

    try:
        records = frame_array(b"".join(part.data for part in parts))
    except MalformedPacketError:
        return np.empty(0, np.int64)
    no_data = FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.SENT
    found = (records["arbitration_id"] & ~np.uint32(FD_BIT)) >> NODE_BITS
    wanted = np.isin(found, [CanFunction[name] for name in functions]) & (records["flags"] & int(no_data) == 0)
    times: IntArray = records["host_time_ns"][wanted].clip(0, parts[-1].host_time_ns).astype(np.int64)
    return times


def offline_clock(clock: RemappedClock | None, n_unplaced: int) -> OfflineClock | None:
    """Return what the offline pass found, for a result; None where it found nothing."""
    if clock is None:
        return None
    longest = max(clock.segments, key=lambda segment: segment.n_chunks)
    bounds_ns, offset_ns = longest.interval.bounds_ns, longest.offset_ns
    return OfflineClock(
        offset_ms=offset_ns / 1e6,
        offset_interval_ms=None
        if bounds_ns is None
        else ((offset_ns + bounds_ns[0]) / 1e6, (offset_ns + bounds_ns[1]) / 1e6),
        mapped_time_error_ms=None if bounds_ns is None else (bounds_ns[0] / 1e6, bounds_ns[1] / 1e6),
        round_trips=longest.interval.n_round_trips,
        consistent=all(segment.interval.consistent for segment in clock.segments),
        skew_ppm=known(longest.skew_ppm),
        jitter_p50_ms=known(longest.jitter_p50_ns / 1e6),
        jitter_p99_ms=known(longest.jitter_p99_ns / 1e6),
        window_s=known(longest.window_s),
        bursty=longest.bursty,
        arrivals=sum(segment.n_chunks for segment in clock.segments),
        samples_unplaced=n_unplaced,
        segments=tuple(ClockSegment(part.stop - part.start, known(part.skew_ppm)) for part in clock.segments),
        steps=tuple(ClockStep(step.disagreement_us / 1e6, step.gap_ns / 1e9) for step in clock.steps),
    )


MAX_ROUND_TRIPS = 200_000
"""Two days of them; more are not kept."""
SAME_ID_KEPT = 4
"""Requests remembered with one command id: it comes again after 256 commands."""


class RecordedRoundTrips:
    """Gathers the round trips of one recording."""

    def __init__(self) -> None:
        self._sent_ns: dict[int, deque[int]] = defaultdict(lambda: deque(maxlen=SAME_ID_KEPT))
        self._found: list[RoundTrip] = []

    def feed_sent(self, data: bytes, host_time_ns: int) -> None:
        """Process what the host sent, framed or (CAN) as the bare packet; only TIME_REQUEST counts."""
        for packet in FrameDecoder().feed(data) if data[:1] == b"\0" else [data]:
            try:
                command = decode_packet(packet)
            except ProtocolError:
                continue
            if isinstance(command, TimeRequest):
                self._sent_ns[command.command_id].append(host_time_ns)

    def feed(self, reply: TimeReply, received_ns: int) -> None:
        """Process an answer, and when the chunk was received that completed it."""
        sent_ns = self.sent_ns(reply, received_ns)
        found = None if sent_ns is None else round_trip(sent_ns, reply, received_ns)
        if found is not None and len(self._found) < MAX_ROUND_TRIPS:
            self._found.append(found)

    def sent_ns(self, reply: TimeReply, received_ns: int) -> int | None:
        """Return when the request was sent that a reply answers; None where there is none."""
        return max((at_ns for at_ns in self._sent_ns[reply.command_id] if at_ns <= received_ns), default=None)

    def feed_frames(self, parts: list[AnyChunk], items: Iterable[StreamItem]) -> None:
        """Process chunks of CAN frames that were decoded together, and their packets; each frame has its own time."""
        for item in items:
            if isinstance(item, TimeReply):
                times = _frame_times(parts, "TIME_REPLY_RECEIVE", "TIME_REPLY_TRANSMIT")  # the last completes a reply
                self.feed(item, int(times.max()) if len(times) else parts[-1].host_time_ns)

    def round_trips(self) -> RoundTrips:
        """Return what was found, in order of arrival."""
        if not self._found:
            return NO_ROUND_TRIPS
        rows = [(trip.sent_ns, trip.receive_us, trip.transmit_us, trip.received_ns) for trip in self._found]
        columns = np.array(rows, dtype=np.int64)
        return RoundTrips(*columns[np.argsort(columns[:, 3], kind="stable")].T)
