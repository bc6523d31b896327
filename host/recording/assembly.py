"""Chunks of a recording put together into samples, as a live capture puts them together, but many chunks at a time.

Nothing depends on how many: every packet is placed by the reception of its own chunk, so a recording gives the very
samples, segments and losses that the capture had.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import cast

import numpy as np
import numpy.typing as npt

from firmware_protocol.items import LocatedPackets, StreamItem
from firmware_protocol.packets import Event, OrientationBatch, Status, TimeReply
from host.links.transport import AnyChunk, FrameChunk, GapChunk
from host.recording.arrivals import RecordedRoundTrips, SampleArrivals
from host.recording.bulk.raw_span import RawSpan
from host.stream.decoding import Link, grouped
from host.stream.samples import SampleAssembler, TimedStatus
from host.stream.series import SampleGatherer

IntArray = npt.NDArray[np.int64]

MAX_EVENTS = 10_000
"""More events than a hand can make are damage or a flood: the rest is not kept."""
MAX_RUNS = 1_000_000
"""Runs of missing samples kept, to be counted cycle by cycle: a day at 200 Hz with one sample in twenty missing."""
PART_SAMPLES = 1 << 14
"""Samples taken together: what is worked out of them stays in the cache. Measured."""
SPAN_BYTES = 2**20
"""Single chunks are put end to end up to about so many bytes."""


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event of the object (button, marker) on the time axis of the samples."""

    time_s: float
    kind: str
    """``BUTTON`` or ``MARKER``."""
    value: int


@dataclass(frozen=True, slots=True, eq=False)
class _PlacedSamples:
    """n samples, and which chunk of a span completed each."""

    batch: OrientationBatch
    places: IntArray  # (n,) of the chunks
    times_ns: IntArray  # (n,) their reception
    arrivals_ns: IntArray  # (n,) reception of the samples, where they have times of their own: of CAN frames

    def part(self, piece: slice) -> _PlacedSamples:
        batch, places = self.batch.part(piece), self.places[piece]
        return _PlacedSamples(batch, places, self.times_ns[piece], self.arrivals_ns[piece])


class TrialAssembly:
    """Processes what a link delivered, in order, and gathers what a score needs."""

    def __init__(self, node: int | None, trips: RecordedRoundTrips, share: Callable[[], float]) -> None:
        self.link = Link(node=node)
        self.assembler = SampleAssembler(MAX_RUNS)
        self.arrivals = SampleArrivals(self.assembler)
        self.trips = trips
        self.samples = SampleGatherer(share)
        self.events: list[TimedEvent] = []
        self.temperatures_c: list[float] = []
        self.reopened = 0
        self._waiting: list[tuple[Event, int]] = []  # events in front of the first sample of their chunk
        self._heard_ns = 0

    def feed(self, delivered: Iterable[RawSpan | AnyChunk]) -> None:
        """Process all that was delivered."""
        for item in _joined(delivered):
            if not isinstance(item, RawSpan):
                self._feed_chunks(item)
            elif self.link.is_of_bytes:
                self._feed_span(item)
            else:  # bytes on what began as a CAN link, which no recording of ours has
                self._feed_chunks([*item.chunks()])

    def finish(self) -> None:
        """Process what the link still holds: nothing follows."""
        held = self.link.flush()
        self.assembler.damaged(self.link.take_damage())
        self.arrivals.came_unknown(held)
        self.samples.add(self.assembler.feed(held, self._heard_ns))
        self.samples.add(self.assembler.release())

    def _feed_span(self, span: RawSpan) -> None:
        self._feed_located(span, self.link.feed_span(span.data))

    def _feed_located(
        self,
        span: RawSpan,
        packets: LocatedPackets,
        arrivals_ns: IntArray | None = None,
        frames_ns: IntArray | None = None,
    ) -> None:
        """Feed the packets of a span, each by its own chunk's reception.

        CAN frames (n,) have times of their own, and so the samples (k,) among them: these are when they arrived.
        """
        self.assembler.damaged(self.link.take_damage())
        assert packets.ends is not None
        places, times_ns = _arrivals(span, packets.ends)
        samples = _PlacedSamples(packets.samples, places, times_ns, times_ns if arrivals_ns is None else arrivals_ns)
        ends = np.array([end for _, _, end in packets.others], dtype=np.int64)
        _, others_ns = _arrivals(span, ends)
        replies_ns = others_ns if frames_ns is None else frames_ns[ends]
        start, statuses = 0, list[TimedStatus]()
        for (position, packet, _), time_ns, reply_ns in zip(
            packets.others, others_ns.tolist(), replies_ns.tolist(), strict=True
        ):
            if isinstance(packet, TimeReply):
                self.trips.feed(packet, reply_ns)
            elif isinstance(packet, Status):
                statuses.append(TimedStatus(position, packet, time_ns))
                self._note_temperature(packet)
            else:
                self._feed_parts(samples, start, position, statuses)
                start, statuses = position, []
                self._feed_other(packet, time_ns)
        self._feed_parts(samples, start, len(packets.samples), statuses)
        self._waiting.clear()
        self._heard_ns = int(span.host_time_ns[-1])

    def _feed_parts(self, samples: _PlacedSamples, start: int, stop: int, statuses: list[TimedStatus]) -> None:
        """Feed samples and the STATUS packets among them, so many at a time."""
        for first in range(start, max(stop, start + 1), PART_SAMPLES):
            last = min(first + PART_SAMPLES, stop)
            among = [item for item in statuses if first < item.position <= last or item.position == first == start]
            part = samples.part(slice(first, last))
            if last > first:
                self.arrivals.came(part.arrivals_ns)
            self._feed_samples(part, [replace(item, position=item.position - first) for item in among])

    def _feed_samples(self, samples: _PlacedSamples, statuses: list[TimedStatus]) -> None:
        """Feed samples and the STATUS packets among them: together, or where that cannot be done in halves."""
        batch, places, times_ns = samples.batch, samples.places, samples.times_ns
        block = self.assembler.feed_run(batch, times_ns, statuses) if len(batch) else None
        if block is not None:
            if len(block):
                self.samples.add([block])
        elif statuses:
            middle = len(statuses) // 2
            status, at = statuses[middle], statuses[middle].position
            self._feed_samples(samples.part(slice(0, at)), statuses[:middle])
            self.samples.add(self.assembler.feed([status.status], status.host_time_ns))
            after = [replace(item, position=item.position - at) for item in statuses[middle + 1 :]]
            self._feed_samples(samples.part(slice(at, None)), after)
        elif len(batch) and places[0] == places[-1]:
            self.samples.add(self.assembler.feed([batch], int(times_ns[0])))
            self._locate_waiting()
        elif len(batch):
            half = int(np.searchsorted(places, (places[0] + places[-1]) // 2, side="right"))
            for part in (slice(0, half), slice(half, None)):
                self._feed_samples(samples.part(part), [])

    def _feed_other(self, item: StreamItem, host_time_ns: int) -> None:
        self.samples.add(self.assembler.feed([item], host_time_ns))
        if isinstance(item, Event):
            self._waiting.append((item, host_time_ns))
            self._locate_waiting()
        elif isinstance(item, Status):
            self._note_temperature(item)

    def _note_temperature(self, status: Status) -> None:
        if len(self.temperatures_c) < MAX_EVENTS:
            self.temperatures_c.append(status.temperature_c)

    def _locate_waiting(self) -> None:
        """Place events on the time axis; those before the first sample of a segment wait for it."""
        waiting, self._waiting = self._waiting, []
        for event, host_time_ns in waiting:
            time_s = self.assembler.locate_s(event, host_time_ns)
            if time_s is None:
                self._waiting.append((event, host_time_ns))
            elif len(self.events) < MAX_EVENTS:
                self.events.append(TimedEvent(time_s, event.kind.name, event.value))

    def _feed_chunks(self, parts: list[AnyChunk]) -> None:
        """Feed neighbouring chunks of CAN frames, or an empty one: a link opened again, or records the file lacks."""
        if isinstance(parts[0], GapChunk):
            self.link.skip_gap()
            self.assembler.add_gap()
            return
        packets = self.link.feed_frames(parts) if parts[0].data else None
        if packets is not None:
            self._feed_frames(parts, packets)
            return
        items: list[StreamItem] = []
        for chunk in parts:  # one by one, as they came: what they complete may depend on that
            items += self._feed_chunk(chunk)
        if parts[0].data:
            self.arrivals.came_in_frames(parts, items)
            self.trips.feed_frames(parts, items)
        else:
            self.arrivals.reopened()
            self.arrivals.came_unknown(items)
        self._waiting.clear()
        if not parts[0].data:  # what was still held came before the cut
            self.assembler.reopened()
            self.reopened += 1

    def _feed_chunk(self, chunk: AnyChunk) -> list[StreamItem]:
        items = self.link.feed(chunk)
        self.assembler.damaged(self.link.take_damage())
        if chunk.data:
            self._heard_ns = chunk.host_time_ns
        for item in items:
            if isinstance(item, OrientationBatch):
                self.samples.add(self.assembler.feed([item], self._heard_ns))
                self._locate_waiting()
            elif not isinstance(item, TimeReply):
                self._feed_other(item, self._heard_ns)
        return items

    def _feed_frames(self, parts: list[AnyChunk], packets: LocatedPackets) -> None:
        """Feed what CAN frames completed that were decoded together; each is placed by its own chunk all the same."""
        from firmware_protocol.can.frames import frame_array

        # No frame of a chunk is received behind it, whatever a recording claims.
        frames = [frame_array(part.data)["host_time_ns"].clip(0, part.host_time_ns) for part in parts]
        frames_ns = np.concatenate(frames)
        stops = np.cumsum([len(times_ns) for times_ns in frames])
        span = RawSpan(b"", stops, np.array([part.host_time_ns for part in parts], dtype=np.int64))
        assert packets.ends is not None
        self._feed_located(span, packets, frames_ns[packets.ends], frames_ns)


def _arrivals(span: RawSpan, ends: IntArray) -> tuple[IntArray, IntArray]:
    """Return in which chunk each packet ends (the first whose stop is behind it), and when it came. Ends ascend."""
    if not len(ends):
        return ends, ends
    stops = span.stops
    first, last = np.searchsorted(stops, ends[[0, -1]], side="right").tolist()
    if last - first >= len(ends):
        places: IntArray = np.searchsorted(stops, ends, side="right")
    else:  # fewer chunks than packets: look up the chunks
        bounds = np.searchsorted(ends, stops[first:last])
        places = np.repeat(np.arange(first, last + 1), np.diff(bounds, prepend=0, append=len(ends)))
    return places, span.host_time_ns[places]


def _joined(delivered: Iterable[RawSpan | AnyChunk]) -> Iterator[RawSpan | list[AnyChunk]]:
    """Put single chunks together: those of bytes end to end, those of CAN frames as :func:`grouped` does."""
    for kind, items in groupby(delivered, _kind):
        if kind is RawSpan:
            yield from cast(Iterator[RawSpan], items)
            continue
        chunks = cast(Iterator[AnyChunk], items)
        if kind is None:  # empty: the link was opened again
            yield from ([chunk] for chunk in chunks)
        elif kind is FrameChunk:
            yield from grouped(chunks)
        else:
            yield from map(RawSpan.of, grouped(chunks, SPAN_BYTES, sys.maxsize))


def _kind(item: RawSpan | AnyChunk) -> type | None:
    return type(item) if isinstance(item, RawSpan) or item.data else None
