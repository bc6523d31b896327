"""A recording as a trial: its samples, its losses, who the object was, and what happened."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from analysis.series import OrientationSeries
from firmware_protocol.packets import Event, Info, Status
from firmware_protocol.stream import StreamCounters
from host import recording_format as fmt
from host.errors import UsageError
from host.link import Link, grouped, joined
from host.link_uri import parse_link_uri
from host.loss_ledger import LossReport
from host.operator_actions import OperatorAction, action_of
from host.recording_reader import RecordingHeader, RecordingReader
from host.sample_arrivals import SampleArrivals, clock_values
from host.samples import SampleAssembler, SampleBlock, SegmentStart, series_of
from host.transports.chunks import AnyChunk

MAX_EVENTS = 10_000
"""More events than a hand can make are damage or a flood: the rest is not kept."""


@dataclass(frozen=True, slots=True)
class TimedEvent:
    """An event of the object (button, marker) on the time axis of the samples."""

    time_s: float
    kind: str
    """``BUTTON`` or ``MARKER``."""
    value: int


@dataclass(frozen=True, slots=True, eq=False)
class RecordedTrial:
    """Everything a recording says that a score needs."""

    series: OrientationSeries
    """The samples; ``index`` is the unwrapped sequence number, time the device's own clock."""
    losses: LossReport
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
    clock: dict[str, Any] | None
    """What the offline pass says of the object's clock and of the link's jitter; None where nothing can be said."""
    segments: tuple[SegmentStart, ...]
    """Where the device was reset or its clock stepped, after the first."""
    damage: tuple[str, ...]
    """What was wrong with the file."""
    header: RecordingHeader | None
    """What the file says of itself; None where the chunks came from elsewhere."""
    actions: tuple[OperatorAction, ...] = ()
    """What the operator did, in order, at most :data:`MAX_EVENTS`."""


def assemble(chunks: Iterable[AnyChunk], source: str, node: int | None = None) -> RecordedTrial:
    """Turn raw chunks into a trial.

    Parameters
    ----------
    chunks : iterable of AnyChunk
        What the link delivered, in order; neighbours are joined.
    source : str
        Where they come from, for people.
    node : int, optional
        Node id of the object on a bus; by default the first that is heard.
    """
    link, assembler = Link(node=node), SampleAssembler()
    blocks: list[SampleBlock] = []
    events: list[TimedEvent] = []
    temperatures_c: list[float] = []
    reopened = 0
    arrivals = SampleArrivals()
    heard_ns = 0
    for parts in grouped(chunks):
        chunk = joined(parts)
        items = link.feed(chunk)
        arrivals.feed(parts, items)
        blocks += assembler.feed(items, chunk.host_time_ns if chunk.data else heard_ns)
        if chunk.data:
            heard_ns = chunk.host_time_ns
        else:  # what was still held came before the cut
            assembler.reopened()
            reopened += 1
        for item in items:
            if isinstance(item, Event) and len(events) < MAX_EVENTS:
                time_s = assembler.locate_s(item, chunk.host_time_ns)
                if time_s is not None:
                    events.append(TimedEvent(time_s, item.kind.name, item.value))
            elif isinstance(item, Status) and len(temperatures_c) < MAX_EVENTS:
                temperatures_c.append(item.temperature_c)
    held = link.flush()
    arrivals.leave_out(held)
    blocks += assembler.feed(held, heard_ns)
    blocks += assembler.release()
    notes = [
        f"{segment.reason} at {segment.time_s:.1f} s: later samples are placed by the host's clock"
        for segment in assembler.segments[1:]
    ]
    return RecordedTrial(
        series=series_of(blocks, source, notes),
        losses=assembler.losses(link.damaged_frames),
        counters=link.counters,
        info=assembler.info,
        status=assembler.status,
        temperatures_c=tuple(temperatures_c),
        events=tuple(events),
        reconnects=reopened,
        clock=clock_values(arrivals.remapped(), arrivals.n_unplaced),
        segments=tuple(assembler.segments),
        damage=(),
        header=None,
    )


def load_trial(path: Path, continuation: bytes = b"") -> RecordedTrial:
    """Read a recording.

    Parameters
    ----------
    path : Path
        The ``.mcap`` file; cut ones are read up to the cut.
    continuation : bytes
        Records the disk did not take, from the capture that just ended.

    Raises
    ------
    FileError
        Not a recording of ours.
    SeriesError
        Its samples cannot be a series.
    """
    reader = RecordingReader(path, continuation)
    actions: list[OperatorAction] = []
    trial = assemble(_chunks(reader, actions), path.name, _node(reader.header))
    return replace(trial, actions=tuple(actions), damage=tuple(reader.damage), header=reader.header)


def _chunks(reader: RecordingReader, actions: list[OperatorAction]) -> Iterator[AnyChunk]:
    """Give what the link delivered; collect what the operator did on the way."""
    for message in reader.messages({fmt.RECEIVED, fmt.ACTION}):
        try:
            if message.topic == fmt.RECEIVED:
                yield fmt.decode_raw(message.data)
            elif len(actions) < MAX_EVENTS:
                actions.append(action_of(message.values()))
        except (ValueError, KeyError) as error:
            reader.damage.append(f"a record of {message.topic} is damaged ({error}) and left out")


def _node(header: RecordingHeader) -> int | None:
    """Read the node id from the link's URI, so that the same object is scored that was captured."""
    try:
        text = parse_link_uri(header.link).options.get("node", "")
    except UsageError:
        return None
    return int(text, 0) if re.fullmatch(r"\d{1,3}|0[xX][0-9a-fA-F]{1,2}", text) else None
