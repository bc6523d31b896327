"""A recording as a trial: its samples, its losses, who the object was, and what happened."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from analysis.scoring.recorded_parts import OfflineClock
from analysis.series import OrientationSeries
from firmware_protocol.items import StreamCounters
from firmware_protocol.packets import Info, Status
from host.errors import UsageError
from host.links.transport import AnyChunk
from host.links.uri import parse_link_uri
from host.losses.ledger import LossReport
from host.losses.runs import MissingRun
from host.recording import format as fmt
from host.recording.arrivals import RecordedRoundTrips, offline_clock
from host.recording.assembly import MAX_EVENTS, TimedEvent, TrialAssembly
from host.recording.bulk.raw_span import RawSpan
from host.recording.reader import RecordedMessage, RecordingHeader, RecordingReader
from host.stream.blocks import SegmentStart
from host.trial.operator import OperatorAction, action_of

MAX_NOTES = 20
"""Of one kind: a clock that jumps all the time is not listed jump by jump."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTrial:
    """Everything in a recording that a score needs."""

    series: OrientationSeries
    """The samples; ``index`` is the unwrapped sequence number, time the device's own clock."""
    losses: LossReport
    missing: tuple[MissingRun, ...]
    """Where samples are missing, numbered as the series' ``index``, and why."""
    counters: StreamCounters
    """What the decoder met."""
    info: Info | None
    """The object as it last introduced itself; None for one that never answers."""
    status: Status | None
    """Its last STATUS."""
    temperatures_c: tuple[float, ...]
    """Sensor temperatures of its STATUS packets, in order, at most :data:`MAX_EVENTS`; NaN where it did not know."""
    events: tuple[TimedEvent, ...]
    reconnects: int
    """How often the link was lost and opened again."""
    late_clock: Callable[[], OfflineClock | None]
    """Makes :attr:`clock`."""
    segments: tuple[SegmentStart, ...]
    """Where the device was reset or its clock stepped, after the first."""
    problems: tuple[str, ...]
    """What was wrong with those who sent, a sentence each: two objects at once, counters that cannot be."""
    damage: tuple[str, ...]
    """What was wrong with the file."""
    header: RecordingHeader | None
    """How the file describes itself; None where the chunks came from elsewhere."""
    actions: tuple[OperatorAction, ...] = ()
    """What the operator did, in order, at most :data:`MAX_EVENTS`."""

    @property
    def why_unscored(self) -> str:
        """What may be why it cannot be scored, to be put behind the reason; empty where the file is sound."""
        return f"; the file is damaged: {'; '.join(self.damage[:3])}" if self.damage else ""

    @property
    def clock(self) -> OfflineClock | None:
        """What the offline pass finds of the object's clock and of the link's jitter; None where it finds nothing.

        It runs at the first call.
        """
        return self.late_clock()


def assemble(
    delivered: Iterable[RawSpan | AnyChunk],
    source: str,
    node: int | None = None,
    trips: RecordedRoundTrips | None = None,
    share: Callable[[], float] = lambda: 0.0,
) -> RecordedTrial:
    """Turn raw chunks into a trial.

    Parameters
    ----------
    delivered : iterable of RawSpan or AnyChunk
        What the link delivered, in order.
    source : str
        Where they come from, for people.
    node : int, optional
        Node id of the object on a bus; by default the first that is heard.
    trips : RecordedRoundTrips, optional
        Learns what was sent while the chunks are processed: it bounds the clock's offset.
    share : callable, optional
        Returns which share of ``delivered`` has come, at least; 0 where that is not known.
    """
    trips = trips or RecordedRoundTrips()
    assembly = TrialAssembly(node, trips, share)
    assembly.feed(delivered)
    assembly.finish()
    assembler, arrivals, round_trips = assembly.assembler, assembly.arrivals, trips.round_trips()
    notes = [
        f"{segment.reason} at {segment.time_s:.1f} s: later samples are placed by the host's clock"
        for segment in assembler.segments[1 : MAX_NOTES + 1]
    ]
    if len(assembler.segments) > MAX_NOTES + 1:
        notes.append(f"{len(assembler.segments) - MAX_NOTES - 1} more such places")
    return RecordedTrial(
        series=assembly.samples.series(source, notes),
        losses=assembler.losses(),
        missing=tuple(assembler.missing_runs()),
        counters=assembly.link.counters,
        info=assembler.info,
        status=assembler.status,
        temperatures_c=tuple(assembly.temperatures_c),
        events=tuple(assembly.events),
        reconnects=assembly.reopened,
        late_clock=cache(lambda: offline_clock(arrivals.remapped(round_trips), arrivals.n_unplaced)),
        segments=tuple(assembler.segments),
        problems=(*assembly.link.problems, *assembler.problems, *assembler.refused),
        damage=(),
        header=None,
    )


def load_trial(path: Path, continuation: bytes = b"") -> RecordedTrial:
    """Read a recording, a cut one up to the cut; ``continuation`` are the records that its capture could not write.

    Raises
    ------
    FileError
        Not a recording of ours.
    SeriesError
        Its samples cannot be a series.
    """
    reader = RecordingReader(path, continuation)
    actions: list[OperatorAction] = []
    trips = RecordedRoundTrips()
    trial = assemble(_delivered(reader, actions, trips), path.name, node_of(reader.header), trips, reader.share_read)
    return replace(trial, actions=tuple(actions), damage=tuple(reader.damage), header=reader.header)


def _delivered(
    reader: RecordingReader, actions: list[OperatorAction], trips: RecordedRoundTrips
) -> Iterator[RawSpan | AnyChunk]:
    """Yield what the link delivered; collect what the operator did and what was sent on the way."""
    for item in reader.spans({fmt.SENT, fmt.ACTION}):
        if not isinstance(item, RecordedMessage):
            yield item
            continue
        try:
            if item.topic == fmt.SENT:
                sent = fmt.decode_raw(item.data, fmt.SENT)
                trips.feed_sent(sent.data, sent.host_time_ns)
            elif len(actions) < MAX_EVENTS:
                actions.append(action_of(item.values()))
        except (ValueError, KeyError) as error:
            reader.note_damaged(item.topic, error)


def node_of(header: RecordingHeader) -> int | None:
    """Return the node id in the link's URI: the same object is scored and replayed that was captured."""
    try:
        text = parse_link_uri(header.link).options.get("node", "")
    except UsageError:
        return None
    return int(text, 0) if re.fullmatch(r"\d{1,3}|0[xX][0-9a-fA-F]{1,2}", text) else None
