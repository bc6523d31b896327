"""Reading a recording back: whole, cut, or still being written.

Only the records' frames (one byte of kind, eight of length) are walked; what nobody asked for is skipped without being
parsed, so that an hour is read in seconds. A file that ends in the middle of a record is read up to there. Chunked
files, as other MCAP tools write them from ours, are read as well.
"""

from __future__ import annotations

import io
import json
import os
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata
from mcap.records import Chunk as McapChunk
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from host.errors import FileError, unreadable
from host.links.transport import AnyChunk
from host.recording import format as fmt
from host.recording.bulk.raw_span import RawSpan, raw_spans
from host.recording.bulk.record_runs import EvenRun, MessageRun, RecordRuns, on_channels
from host.recording.completeness import Completeness

MAX_RECORD_BYTES = 64 * 2**20
"""A longer record is damage: ours have at most 64 KiB."""
ENDINGS = {int(Opcode.DATA_END): 4, int(Opcode.FOOTER): 20}
"""Length of the records that end the data and the file."""
READ_BLOCK_BYTES = 2 * 2**20
HANDFUL_BYTES = 4096
"""So little at the end of a block waits for the next: a few records by themselves cost as much as thousands."""
HEADER_BLOCK_BYTES = 16 * 2**10
_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
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
        self._headless = False
        self._size = self._given_bytes = 0
        self.header = self._read_header()

    def share_read(self) -> float:
        """Return which share of the file has been delivered, at least: what is only read does not count."""
        return self._given_bytes / max(self._size, 1)

    def chunks(self, topic: str = fmt.RECEIVED) -> Iterator[AnyChunk]:
        """Yield what the link delivered, in order, each with its time of reception."""
        for _, body in self._wanted({topic}):
            yield from self._chunk(topic, body)

    def spans(self, topics: Iterable[str] = ()) -> Iterator[RawSpan | AnyChunk | RecordedMessage]:
        """Yield what the link delivered, in order, many chunks at a time; and, not later, the messages on other topics.

        The chunks of a byte link come end to end; empty ones and those of CAN frames one by one.
        """
        for topic, body, run in self._chosen({fmt.RECEIVED, *topics}):
            if run is None:
                if topic == fmt.RECEIVED:
                    yield from self._chunk(topic, body)
                else:
                    yield _recorded(topic, body)
                continue
            raw = [channel for channel, name in self._channels.items() if name == fmt.RECEIVED]
            received = on_channels(run.channels, raw)
            for channel, start, end in run.where(~received).places():
                yield _recorded(self._channels[channel], body[start:end])
            chunks = run.where(received)
            for item in raw_spans(body, chunks.starts, chunks.ends):
                if isinstance(item, fmt.DamagedMessageError):
                    self.note_damaged(fmt.RECEIVED, item)
                else:
                    yield item

    def _chunk(self, topic: str, body: memoryview) -> Iterator[AnyChunk]:
        try:
            yield fmt.decode_raw(bytes(body[_MESSAGE.size :]), topic)
        except fmt.DamagedMessageError as error:
            self.note_damaged(topic, error)

    def note_damaged(self, topic: str, error: Exception) -> None:
        """Note among :attr:`damage` that a record is left out."""
        self.damage.append(f"a record of {topic} is damaged ({error}) and left out")

    def messages(self, topics: Iterable[str]) -> Iterator[RecordedMessage]:
        """Yield the messages on some topics, in the order of the file."""
        for topic, body in self._wanted(set(topics)):
            yield _recorded(topic, body)

    def _wanted(self, topics: set[str]) -> Iterator[tuple[str, memoryview]]:
        """Yield topic and body of the messages on some topics; the others are skipped many at a time."""
        for topic, body, run in self._chosen(topics):
            if run is None:
                yield topic, body
            else:
                for channel, start, end in run.places():
                    yield self._channels[channel], body[start:end]

    def _chosen(self, topics: set[str]) -> Iterator[tuple[str, memoryview, MessageRun | None]]:
        """Yield topic and body of single messages; or the block, and where in it lie messages on some topics."""
        self.damage.clear()
        if self._headless:
            self.damage.append("the recording's own description is damaged: link, date and settings are not known")
        found = Completeness()
        with self._open() as file:
            for kind, body, run in self._records(file, on_bytes=found.add_bytes):
                if run is not None:
                    found.add_undescribed(run.not_on(self._channels))
                    channels = [channel for channel, name in self._channels.items() if name in topics]
                    if channels:
                        chosen = run.on(channels)
                        for channel in channels:
                            numbers = chosen.on([channel]).numbers(body)
                            if len(numbers):
                                found.add_messages(channel, numbers)
                        yield "", body, MessageRun(chosen.starts + _FRAME.size, chosen.ends, chosen.channels)
                elif kind != Opcode.MESSAGE:
                    self._note_channel(kind, body)
                    found.add_other(kind, body)
                elif len(body) < _MESSAGE.size:
                    self.damage.append("a message shorter than its header is left out")
                else:
                    channel, number, _, _ = _MESSAGE.unpack_from(body)
                    topic = self._channels.get(channel)
                    found.add_undescribed(topic is None)
                    if topic in topics:
                        found.add_messages(channel, np.array([number], np.int64))
                        yield topic, body, None
        self.damage += found.sentences({channel: name for channel, name in self._channels.items() if name in topics})
        if not self.damage and not found.checksum_fits():
            self.damage.append("the file is not as it was written; what was read from it is whole")

    def _read_header(self) -> RecordingHeader:
        with self._open() as file:
            for kind, body, _ in self._records(file, HEADER_BLOCK_BYTES):
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

    def _records(
        self,
        file: io.FileIO,
        block_bytes: int = READ_BLOCK_BYTES,
        on_bytes: Callable[[memoryview | bytes], None] = lambda _: None,
    ) -> Iterator[tuple[int, memoryview, MessageRun | EvenRun | None]]:
        """Walk the records up to the footer, the end, or the first impossible length.

        Yields kind and body of each; or, of messages that follow each other, the block they are in and their places.
        What is yielded is overwritten when the next is asked for. ``on_bytes`` is called with all bytes, in order, many
        records at a time; with those in front of the end of the data before that is yielded.
        """
        continuation = io.BytesIO(self._continuation)
        buffer = memoryview(bytearray(block_bytes))
        kept = 0  # bytes at its start, of a record that ends in the next block
        on_bytes(MCAP0_MAGIC)
        self._size = os.fstat(file.fileno()).st_size + len(self._continuation)
        self._given_bytes = 0
        while True:
            if kept > block_bytes // 2:  # a record that hardly fits, or does not
                buffer = memoryview(bytearray(bytes(buffer[:kept]) + bytes(max(kept, block_bytes))))
            n_read = file.readinto(buffer[kept:]) or continuation.readinto(buffer[kept:])
            view = buffer[: kept + n_read]
            offset = passed_on = 0
            runs = RecordRuns(view, self._channels)
            while len(view) - offset >= _FRAME.size:
                run = runs.at(offset)
                if run is not None:
                    offset = run.end
                    yield Opcode.MESSAGE, view, run
                    if n_read and len(view) - offset < HANDFUL_BYTES:
                        break
                    continue
                kind, length = _FRAME.unpack_from(view, offset)
                if length > MAX_RECORD_BYTES:
                    self.damage.append("a record has an impossible length: the rest of the file is not read")
                    return
                end = offset + _FRAME.size + length
                if end > len(view):
                    break
                body = view[offset + _FRAME.size : end]
                offset = end
                if length != ENDINGS.get(kind, length):
                    self.damage.append("a record that should end the file has an impossible length and is left out")
                    continue
                if kind == Opcode.DATA_END:
                    on_bytes(view[passed_on : offset - _FRAME.size - length])
                    passed_on = offset
                if kind == Opcode.FOOTER:
                    behind = bytes(view[offset:]) + file.read(len(MCAP0_MAGIC)) + continuation.read(len(MCAP0_MAGIC))
                    if behind != MCAP0_MAGIC:
                        self.damage.append("the file does not end behind its footer: the rest is not read")
                    return
                if kind == Opcode.CHUNK:
                    yield from ((kind, body, None) for kind, body in self._chunk_records(body))
                else:
                    yield kind, body, None
            on_bytes(view[passed_on:offset])
            self._given_bytes += offset
            kept = len(view) - offset
            buffer[:kept] = bytes(view[offset:])
            if not n_read:
                left = f", {kept} bytes of a last record are left out" if kept else ""
                self.damage.append(f"the recording was not closed: it is read up to where it ends{left}")
                return

    def _chunk_records(self, body: memoryview) -> Iterator[tuple[int, memoryview]]:
        try:
            chunk = McapChunk.read(ReadDataStream(io.BytesIO(body)))
            if chunk.uncompressed_size > MAX_RECORD_BYTES:
                raise ValueError("too large")
            stream, _ = get_chunk_data_stream(chunk, validate_crc=True)
            view = memoryview(stream.read(chunk.uncompressed_size))
        except Exception as error:  # noqa: BLE001 - decompressors raise their own kinds
            self.damage.append(f"a chunk is damaged ({type(error).__name__}) and left out")
            return
        offset = 0
        while len(view) - offset >= _FRAME.size:
            kind, length = _FRAME.unpack_from(view, offset)
            end = offset + _FRAME.size + length
            if end > len(view):
                self.damage.append("a chunk ends within a record")
                return
            yield kind, view[offset + _FRAME.size : end]
            offset = end


def _recorded(topic: str, body: memoryview) -> RecordedMessage:
    _, _, _, time_ns = _MESSAGE.unpack_from(body)
    return RecordedMessage(topic, bytes(body[_MESSAGE.size :]), time_ns)


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
