"""Reading a recording back: whole, cut, or still being written.

What nobody asked for is skipped without being parsed, so that an hour is read in seconds. A file that ends in the
middle of a record is read up to there, and where records are missing a gap is yielded in their place. Chunked files, as
other MCAP tools write them from ours, are read as well.
"""

from __future__ import annotations

import io
import json
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata
from mcap.writer import MCAP0_MAGIC

from host.errors import FileError, unreadable
from host.links.transport import AnyChunk, GapChunk
from host.recording import format as fmt
from host.recording.bulk.compressed_chunks import CompressedChunks, chunk_records
from host.recording.bulk.raw_span import RawSpan, raw_spans
from host.recording.bulk.record_runs import EvenRun, MessageRun, by_channel, on_channels
from host.recording.bulk.walk import FRAME, MESSAGE, READ_BLOCK_BYTES, RecordWalk
from host.recording.completeness import Completeness

IntArray = npt.NDArray[np.int64]

HEADER_BLOCK_BYTES = 16 * 2**10
_PARSE_ERRORS = (McapError, struct.error, ValueError, EOFError, KeyError, RecursionError)


@dataclass(frozen=True, slots=True)
class RecordingHeader:
    """How a recording describes itself."""

    version: str
    """Of rotdrift."""
    link: str
    """URI of the link."""
    wall_time_ns: int
    """Wall clock at the start, ns since 1970."""
    monotonic_ns: int
    """Monotonic clock at the same instant."""
    settings: dict[str, Any] = field(default_factory=dict)
    """How the capture was started."""


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One message of a recording."""

    topic: str
    data: bytes
    time_ns: int
    """When it was received or happened, wall clock, ns since 1970."""

    def values(self) -> dict[str, Any]:
        """Return the values of a message on one of the topics of :data:`host.recording.format.TYPES`.

        Raises
        ------
        ValueError
            Damaged.
        """
        return fmt.TYPES[self.topic].decode(self.data)


@dataclass(frozen=True, slots=True, eq=False)
class _Chosen:
    """Messages that were asked for: one, many of a block, or none; and where in front of them the file lacks some."""

    topic: str
    """Of one message; empty where there are many or none."""
    body: memoryview
    """Of one message; of many, the block they are in."""
    run: MessageRun | None = None
    """Where in the block their bodies are."""
    gaps: Sequence[tuple[int, int]] = ()
    """Where records of what the link delivered are missing: in front of which start, and how many."""


def is_our_recording(path: Path) -> bool:
    """Return whether a file is a recording of ours: MCAP, with our name or our raw channel near its beginning.

    Any other file, also one that cannot be read, is not.
    """
    try:
        RecordingReader(path)
    except FileError:
        return False
    return True


class RecordingReader:
    """A recording on disk, and behind its end the records that could not be written (``continuation``).

    Raises
    ------
    FileError
        Missing, empty, not MCAP, or not one of ours.
    """

    def __init__(self, path: Path, continuation: bytes = b"") -> None:
        self.path = path
        self.damage: list[str] = []
        """What was wrong with the file; complete after the messages were read once."""
        self._continuation = continuation
        self._channels: dict[int, str] = {}
        self._left_out: Counter[tuple[str, str]] = Counter()  # records, by topic and what is wrong with them
        self._headless = False
        self._walk: RecordWalk | None = None
        self._last_ns = 0  # reception of the last chunk yielded
        self.header = self._read_header()

    def share_read(self) -> float:
        """Return which share of the file has been delivered, at least: what is only read does not count."""
        return 0.0 if self._walk is None else self._walk.walked_bytes / max(self._walk.size, 1)

    def chunks(self, topic: str = fmt.RECEIVED) -> Iterator[AnyChunk]:
        """Yield what the link delivered, or what was sent, in order, each with its time."""
        if topic == fmt.RECEIVED:
            yield from (chunk for chunk in self.delivered() if not isinstance(chunk, GapChunk))
            return
        for message in self.messages({topic}):
            try:
                yield fmt.decode_raw(message.data, topic)
            except fmt.DamagedMessageError as error:
                self.note_damaged(topic, error)

    def delivered(self) -> Iterator[AnyChunk]:
        """Yield what the link delivered as :meth:`spans` does, chunk by chunk."""
        for item in self.spans():
            if isinstance(item, RawSpan):
                yield from item.chunks()
            elif not isinstance(item, RecordedMessage):
                yield item

    def spans(self, topics: Iterable[str] = ()) -> Iterator[RawSpan | AnyChunk | RecordedMessage]:
        """Yield what the link delivered, in order, many chunks at a time; and, not later, the messages on other topics.

        The chunks of a byte link come end to end; empty ones and those of CAN frames one by one. A
        :class:`host.links.transport.GapChunk` stands where the file lacks records of what the link delivered.
        """
        self._last_ns = self.header.monotonic_ns
        for chosen in self._chosen({fmt.RECEIVED, *topics}):
            run, body = chosen.run, chosen.body
            if run is None:
                yield from (self._gap(records) for _, records in chosen.gaps)
                if chosen.topic == fmt.RECEIVED:
                    yield from self._received(body)
                elif chosen.topic:
                    yield _recorded(chosen.topic, body)
                continue
            raw = [channel for channel, name in self._channels.items() if name == fmt.RECEIVED]
            received = on_channels(run.channels, raw)
            for channel, start, end in run.where(~received).places():
                yield _recorded(self._channels[channel], body[start:end])
            chunks = run.where(received)
            first = 0
            for start, records in chosen.gaps:
                place = int(np.searchsorted(chunks.starts, start))
                yield from self._raw_spans(body, chunks.starts[first:place], chunks.ends[first:place])
                yield self._gap(records)
                first = place
            yield from self._raw_spans(body, chunks.starts[first:], chunks.ends[first:])

    def _raw_spans(self, body: memoryview, starts: IntArray, ends: IntArray) -> Iterator[RawSpan | AnyChunk]:
        """Yield raw messages of a block that follow each other, and a gap for each that is damaged."""
        for item in raw_spans(body, starts, ends) if len(starts) else ():
            if isinstance(item, fmt.DamagedMessageError):
                self.note_damaged(fmt.RECEIVED, item)
                yield self._gap(1)
                continue
            self._last_ns = int(item.host_time_ns[-1]) if isinstance(item, RawSpan) else item.host_time_ns
            yield item

    def _received(self, body: memoryview) -> Iterator[AnyChunk]:
        try:
            chunk = fmt.decode_raw(bytes(body[MESSAGE.size :]))
        except fmt.DamagedMessageError as error:
            self.note_damaged(fmt.RECEIVED, error)
            chunk = self._gap(1)
        self._last_ns = chunk.host_time_ns
        yield chunk

    def _gap(self, records: int) -> GapChunk:
        return GapChunk(b"", self._last_ns, records)

    def note_damaged(self, topic: str, error: Exception) -> None:
        """Note among :attr:`damage` that a record is left out."""
        self._left_out[topic, str(error)] += 1

    def messages(self, topics: Iterable[str]) -> Iterator[RecordedMessage]:
        """Yield the messages on some topics, in the order of the file."""
        for chosen in self._chosen(set(topics)):
            if chosen.run is not None:
                for channel, start, end in chosen.run.places():
                    yield _recorded(self._channels[channel], chosen.body[start:end])
            elif chosen.topic:
                yield _recorded(chosen.topic, chosen.body)

    def _chosen(self, topics: set[str]) -> Iterator[_Chosen]:
        """Yield the messages on some topics, one by one or many at a time, and where the file lacks some."""
        self.damage.clear()
        self._left_out.clear()
        if self._headless:
            self.damage.append("the recording's own description is damaged: link, date and settings are not known")
        found = Completeness()
        with self._open() as file, closing(CompressedChunks(self.path)) as compressed:
            for kind, body, run in self._records(file, compressed, found.checksums.add_bytes):
                if run is not None:
                    found.add_undescribed(run.not_on(self._channels))
                    channels = [channel for channel, name in self._channels.items() if name in topics]
                    if channels:
                        yield self._chosen_run(body, run.on(channels), found)
                elif kind == Opcode.METADATA and (missing := parse_missing(bytes(body))) is not None:
                    topic, records = missing
                    found.add_missing_before(topic, records)
                    if topic == fmt.RECEIVED:
                        yield _Chosen("", body, gaps=[(0, records)])
                elif kind != Opcode.MESSAGE:
                    self._note_channel(kind, body)
                    found.add_other(kind, body)
                elif len(body) < MESSAGE.size:
                    self.damage.append("a message shorter than its header is left out")
                else:
                    channel, number, _, _ = MESSAGE.unpack_from(body)
                    name = self._channels.get(channel, "")
                    found.add_undescribed(channel not in self._channels)
                    if name in topics:
                        gaps = found.add_messages(channel, np.array([number], np.int64))
                        yield _Chosen(name, body, gaps=gaps if name == fmt.RECEIVED else [])
        for (name, what), n in self._left_out.items():
            which = f"a record of {name} is" if n == 1 else f"{n} records of {name} are"
            self.damage.append(f"{which} damaged ({what}) and left out")
        self.damage += found.sentences({channel: name for channel, name in self._channels.items() if name in topics})
        if not self.damage and not found.checksums.data_fits:
            self.damage.append("the file is not as it was written; what was read from it is whole")

    def _chosen_run(self, body: memoryview, run: MessageRun, found: Completeness) -> _Chosen:
        gaps: list[tuple[int, int]] = []
        for channel, places in by_channel(run.channels) if len(run.starts) else ():
            of_channel = run.at(places)
            lacking = found.add_messages(channel, of_channel.numbers(body))
            if lacking and self._channels[channel] == fmt.RECEIVED:
                gaps += [(int(of_channel.starts[place]) + FRAME.size, records) for place, records in lacking]
        return _Chosen("", body, MessageRun(run.starts + FRAME.size, run.ends, run.channels), sorted(gaps))

    def _records(
        self,
        file: io.FileIO,
        compressed: CompressedChunks,
        on_bytes: Callable[[memoryview | bytes], object] = lambda _: None,
        block_bytes: int = READ_BLOCK_BYTES,
    ) -> Iterator[tuple[int, memoryview, MessageRun | EvenRun | None]]:
        """Yield kind and body of each record, those in chunks too, or a run and the block that it is in."""
        walk = self._walk = RecordWalk(
            file, self._channels, lambda _, problem: self.damage.append(problem), on_bytes, self._continuation
        )
        for record in walk.records(block_bytes):
            if record.kind == Opcode.CHUNK:
                inside = chunk_records(record.body, self.damage.append, compressed)
                yield from ((kind, body, None) for kind, body in inside)
            else:
                yield record.kind, record.body, record.run

    def _read_header(self) -> RecordingHeader:
        with self._open() as file, closing(CompressedChunks(self.path)) as compressed:
            for kind, body, _ in self._records(file, compressed, block_bytes=HEADER_BLOCK_BYTES):
                self._note_channel(kind, body)
                header = parse_header(bytes(body)) if kind == Opcode.METADATA else None
                if header is not None:
                    return header
                if kind == Opcode.MESSAGE and fmt.RECEIVED not in self._channels.values():
                    break
        if fmt.RECEIVED in self._channels.values():
            self._headless = True
            return RecordingHeader("", "", 0, 0)
        raise FileError(
            f"{self.path} is an MCAP file, but not a recording of rotdrift",
            "score a bag with `rotdrift score`, replay only what `rotdrift capture` wrote",
        )

    def _open(self) -> io.FileIO:
        try:
            file = self.path.open("rb", buffering=0)
        except OSError as error:
            raise unreadable(self.path, error) from error
        magic = file.read(len(MCAP0_MAGIC))
        if magic != MCAP0_MAGIC:
            file.close()
            what = "is empty" if not magic else "is not a recording"
            raise FileError(f"{self.path} {what}", "give the .mcap file that `rotdrift capture` wrote")
        return file

    def _note_channel(self, kind: int, body: memoryview) -> None:
        if kind != Opcode.CHANNEL:
            return
        try:
            channel = Channel.read(ReadDataStream(io.BytesIO(body)))
        except _PARSE_ERRORS:
            self.damage.append("a channel record is damaged")
            return
        if self._channels.setdefault(channel.id, channel.topic) != channel.topic:
            self.damage.append("a channel is described twice, in different ways: the first is taken")


def _recorded(topic: str, body: memoryview) -> RecordedMessage:
    _, _, _, time_ns = MESSAGE.unpack_from(body)
    return RecordedMessage(topic, bytes(body[MESSAGE.size :]), time_ns)


def parse_header(body: bytes) -> RecordingHeader | None:
    """Return what is in a metadata record of ours; None where it is another, or damaged."""
    try:
        metadata = Metadata.read(ReadDataStream(io.BytesIO(body)))
        values = metadata.metadata
        if metadata.name != fmt.METADATA_NAME or values.get("crc32") not in {None, fmt.metadata_crc(values)}:
            return None
        return RecordingHeader(
            version=values["version"],
            link=values["link"],
            wall_time_ns=int(values["wall_time_ns"]),
            monotonic_ns=int(values["monotonic_ns"]),
            settings=json.loads(values["settings"]),
        )
    except Exception:  # noqa: BLE001 - the library raises whatever damaged bytes make it raise
        return None


def parse_missing(body: bytes) -> tuple[str, int] | None:
    """Return topic and number of the records that a metadata record states to be missing in front of it.

    None where it is another, or damaged.
    """
    try:
        metadata = Metadata.read(ReadDataStream(io.BytesIO(body)))
        values = metadata.metadata
        if metadata.name != fmt.MISSING_NAME or values["crc32"] != fmt.metadata_crc(values):
            return None
        return values["topic"], int(values["records"])
    except Exception:  # noqa: BLE001 - the library raises whatever damaged bytes make it raise
        return None
