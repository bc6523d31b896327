"""Checking any MCAP file as it is walked: memory grows with its channels, chunks and indexes, not with its messages."""

from __future__ import annotations

import io
import struct
import time
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

from host.errors import FileError, unreadable
from host.recording.bulk.compressed_chunks import CompressedChunks, unpacked
from host.recording.bulk.record_runs import EvenRun, MessageRun, RecordRuns
from host.recording.bulk.walk import FRAME, MESSAGE, RecordBody, RecordWalk
from host.recording.check.account import ChannelAccount, CheckReport, Findings
from host.recording.check.message_index import MessageIndexCheck
from host.recording.check.messages import CheckedChannel, MessageCheck
from host.recording.check.own import OwnCheck
from host.recording.check.summary import WRONG_INDEX, MetChunk, MetRecords, SummaryCheck
from host.recording.completeness import SectionChecksums

STILL_WRITTEN_S = 5.0
"""A file without an end that changed within so long is being recorded right now."""
_PARSE_ERRORS = (McapError, struct.error, ValueError, EOFError, KeyError, RecursionError, MemoryError, OverflowError)
_DATA_KINDS = {
    int(kind)
    for kind in (
        Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.MESSAGE_INDEX,
        Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END,
    )
}  # fmt: skip
_SUMMARY_KINDS = {
    int(kind)
    for kind in (
        Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX,
        Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER,
    )
}  # fmt: skip
_PRIVATE = 0x80
"""Kinds from here on belong to other tools."""
_TEXT_MISPLACED = "the record's kind is damaged, or a piece of the file is missing"
"""What a record of another section means."""


def check_mcap(path: Path, now_s: Callable[[], float] = time.time) -> CheckReport:
    """Check an MCAP file.

    Raises
    ------
    FileError
        It cannot be read, or does not start as an MCAP file does.
    """
    try:
        with path.open("rb", buffering=0) as file, closing(CompressedChunks(path)) as compressed:
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                raise FileError(f"{path} does not start as an MCAP file does", "give a recording")
            age_s = now_s() - path.stat().st_mtime
            return _McapCheck(file, compressed).report(being_written=0 <= age_s < STILL_WRITTEN_S)
    except OSError as error:
        raise unreadable(path, error) from error


class _McapCheck:
    """One pass over a file."""

    def __init__(self, file: io.FileIO, compressed: CompressedChunks) -> None:
        self._compressed = compressed
        self._damage = Findings()
        self._notes = Findings()
        self._checksums = SectionChecksums()
        self._messages = MessageCheck(self._damage, self._notes)
        self._own = OwnCheck(self._messages, self._damage, self._notes)
        self._met = MetRecords()
        self._summary = SummaryCheck(self._met, self._messages, self._damage)
        self._schemas: dict[int, tuple[str, str, bytes]] = {}
        self._indexes = MessageIndexCheck(self._damage)
        self._data_end: int | None = None  # offset behind the end of the data
        self._closed = False
        self._end_problems: list[tuple[int, str]] = []
        self._walk = RecordWalk(file, self._messages.channels, self._note_end, self._checksums.add_bytes)

    def _note_end(self, at: int, problem: str) -> None:
        """Keep what ends the walk: what it means depends on whether the file is still being written."""
        self._end_problems.append((at, problem))

    def report(self, *, being_written: bool) -> CheckReport:
        """Walk the file and return what was found."""
        first = True
        for record in self._walk.records():
            if first and record.kind != Opcode.HEADER:
                self._damage.add(len(MCAP0_MAGIC), "the file does not start with its header", _TEXT_MISPLACED)
            first = False
            if record.run is not None:
                self._add_run(record.body, record.run, record.at)
            else:
                self._add_record(record.at, record.kind, record.body)
        self._indexes.finish(self._messages.channels)
        for at, problem in self._end_problems:
            if problem.startswith("the recording was not closed"):
                self._add_unclosed(at, problem, being_written=being_written)
            else:
                self._damage.add(at, problem, "`rotdrift recover` searches the rest" if self._messages.ours else "")
        self._check_sums()
        return self._put_together()

    def _add_unclosed(self, at: int, problem: str, *, being_written: bool) -> None:
        if being_written and self._data_end is None:
            meaning = (
                f"it changed within the last {STILL_WRITTEN_S:.0f} s, so it is being recorded; check it again then"
            )
            self._notes.add(at, "the file has no end yet", meaning)
            return
        meaning = "its capture was killed, or the copy of it is cut"
        if self._messages.ours:
            meaning += "; it is read up to there, and `rotdrift recover` makes a closed recording of it"
        self._damage.add(at, problem.replace("the recording was", "the file was"), meaning)

    def _check_sums(self) -> None:
        sums = self._checksums
        if not sums.data_fits and self._data_end is not None:
            self._damage.add(None, "the checksum over the data does not fit", "bytes are not as they were written")
        if not sums.summary_fits:
            self._damage.add(None, "the checksum over the summary does not fit", "counts and indexes are damaged")

    def _put_together(self) -> CheckReport:
        messages, sums, stated = self._messages, self._checksums, self._summary.stated
        names = {"data": (sums.stated_data, sums.data_fits), "summary": (sums.stated_summary, sums.summary_fits)}
        if messages.backward and not messages.ours:
            self._notes.add(None, f"{messages.backward} messages are logged earlier than the one before")
        accounts = []
        for number, channel in sorted(messages.channels.items()):
            numbered = channel.count > 1 and not channel.numbers.unnumbered
            missing = channel.numbers.missing if numbered else 0
            if missing and not messages.ours:
                self._notes.add(None, f"{missing} numbers are left out on {channel.topic}")
            schema = self._schemas.get(channel.schema_id, ("", "", b""))[0]
            expected = None if stated is None else stated.get(number, 0)
            accounts.append(ChannelAccount(channel.topic, schema, channel.count, expected, missing, numbered))
        span = None if messages.first_ns is None or messages.last_ns is None else messages.last_ns - messages.first_ns
        return CheckReport(
            kind="a recording of rotdrift" if messages.ours else "an MCAP file of another tool",
            n_bytes=self._walk.size,
            closed=self._closed,
            problems=tuple(self._damage.kept),
            n_problems=self._damage.n,
            notes=tuple(self._notes.kept),
            channels=tuple(accounts),
            checksums={
                name: "not stated" if not stated_sum else "fits" if fits else "does not fit"
                for name, (stated_sum, fits) in names.items()
            },
            span_s=None if span is None or messages.n < 2 else span / 1e9,
            decoded=self._own.decoded() if messages.ours else None,
        )

    def _add_run(self, block: memoryview, run: MessageRun | EvenRun, at: int, within: int | None = None) -> None:
        whole = run.whole() if isinstance(run, EvenRun) else run
        place = at if within is None else within
        if self._data_end is not None:
            n = len(whole.starts)
            self._damage.add(place, f"{n} message{'s' * (n > 1)} behind the end of the data", _TEXT_MISPLACED)
        times_ns = self._messages.add(block, whole, at, within)
        if self._messages.ours:
            self._own.add(block, whole, at, within)
        if within is None:
            self._indexes.finish(self._messages.channels)
        else:
            self._indexes.add_messages(whole, times_ns)

    def _add_record(self, at: int, kind: int, body: memoryview, within: int | None = None) -> None:
        place = at if within is None else within
        if kind == Opcode.MESSAGE:
            if len(body) < MESSAGE.size:
                self._damage.add(place, "a message shorter than its header", "its length is damaged")
                return
            # As part of a block, where the run counts from.
            block = memoryview(FRAME.pack(kind, len(body)) + bytes(body))
            run = MessageRun(np.array([0]), np.array([len(block)]), np.array([MESSAGE.unpack_from(body)[0]]))
            self._add_run(block, run, at, within)
            return
        expected = _DATA_KINDS if self._data_end is None else _SUMMARY_KINDS
        if within is not None:
            expected = {Opcode.SCHEMA, Opcode.CHANNEL}
        if kind not in expected:
            self._add_unexpected(place, kind)
            return
        if within is None and kind != Opcode.MESSAGE_INDEX:
            self._indexes.finish(self._messages.channels)
        if self._data_end is not None:
            self._met.add_to_group(kind, at, at + FRAME.size + len(body))
        try:
            self._parse(place, kind, body)
        except _PARSE_ERRORS:
            self._damage.add(place, f"a record of kind {Opcode(kind).name} cannot be read", "it is damaged")

    def _add_unexpected(self, at: int, kind: int) -> None:
        known = kind in {int(opcode) for opcode in Opcode}
        if known:
            where = "behind the end of the data" if self._data_end is not None else "among the data"
            self._damage.add(at, f"a record of kind {Opcode(kind).name} stands {where}", _TEXT_MISPLACED)
        elif kind == 0 or self._messages.ours:
            meaning = "the kind of the record is damaged, or zeros stand in its place; what it held is missing"
            self._damage.add(at, f"a record of kind {kind}, which the format does not know", meaning)
        else:
            owner = "another tool's own" if kind >= _PRIVATE else "a later version of the format's"
            self._notes.add(at, f"a record of kind {kind} is {owner}", "it is passed over")

    def _parse(self, at: int, kind: int, body: memoryview) -> None:
        stream = RecordBody(body)
        size = FRAME.size + len(body)
        if kind == Opcode.HEADER:
            Header.read(stream)
        elif kind == Opcode.SCHEMA:
            self._add_schema(at, Schema.read(stream))
        elif kind == Opcode.CHANNEL:
            self._add_channel(at, Channel.read(stream))
        elif kind == Opcode.CHUNK:
            self._add_chunk(at, body)
        elif kind == Opcode.MESSAGE_INDEX:
            self._indexes.add_index(at, MessageIndex.read(stream), size)
        elif kind == Opcode.ATTACHMENT:
            self._add_attachment(at, body)
        elif kind == Opcode.METADATA:
            name = Metadata.read(stream).name
            self._met.metadata[at] = size, name
            self._own.add_metadata(at, bytes(body), name)
        elif kind == Opcode.DATA_END:
            self._checksums.add_data_end(body)
            self._data_end = at + size
        elif kind == Opcode.STATISTICS:
            self._summary.add_statistics(at, Statistics.read(stream))
        elif kind == Opcode.CHUNK_INDEX:
            self._summary.add_chunk_index(at, ChunkIndex.read(stream))
        elif kind == Opcode.ATTACHMENT_INDEX:
            self._summary.add_attachment_index(at, AttachmentIndex.read(stream))
        elif kind == Opcode.METADATA_INDEX:
            self._summary.add_metadata_index(at, MetadataIndex.read(stream))
        elif kind == Opcode.SUMMARY_OFFSET:
            self._summary.add_summary_offset(at, SummaryOffset.read(stream))
        elif kind == Opcode.FOOTER:
            self._checksums.add_footer(body)
            self._closed = True
            self._summary.add_footer(at, Footer.read(stream), self._data_end)

    def _add_schema(self, at: int, schema: Schema) -> None:
        found = schema.name, schema.encoding, bytes(schema.data)
        if not schema.id:
            self._damage.add(at, "a schema has the number 0, which stands for none", "its record is damaged")
        elif self._schemas.setdefault(schema.id, found) != found:
            self._damage.add(at, f"schema {schema.id} is described twice, in different ways", "one is damaged")
        self._met.n_schemas = len(self._schemas)

    def _add_channel(self, at: int, channel: Channel) -> None:
        schema = self._schemas.get(channel.schema_id)
        if schema is None and channel.schema_id:
            what = f"channel {channel.topic} has the schema {channel.schema_id}, which is not described before"
            self._damage.add(at, what, "its messages cannot be read by tools that need it")
        definition = channel.topic, channel.message_encoding, channel.schema_id, tuple(sorted(channel.metadata.items()))
        before = self._messages.channels.get(channel.id)
        if before is None:
            if self._data_end is not None:  # the official writer does so where no message followed
                meaning = "its record among the data is damaged or missing" if self._messages.ours else "it is empty"
                where = self._damage if self._messages.ours else self._notes
                where.add(at, f"channel {channel.topic} is described in the summary alone", meaning)
            self._messages.channels[channel.id] = CheckedChannel(channel.topic, channel.schema_id, definition)
            self._own.add_definition(at, channel.topic, (*(schema or ("", "", b"")), channel.message_encoding))
        elif before.definition != definition:
            self._damage.add(at, f"channel {channel.id} is described twice, in different ways", "the first is taken")

    def _add_chunk(self, at: int, body: memoryview) -> None:
        report = partial(self._damage.add, at, meaning="all messages in it are missing")
        found = unpacked(body, report, self._compressed)
        if found is None:
            return
        chunk, view = found
        met = self._met.chunks[at] = MetChunk(FRAME.size + len(body), replace(chunk, data=b""))
        self._indexes.start(at, met)
        outside = self._messages.start_span()
        offset, runs = 0, RecordRuns(view, self._messages.channels)
        while len(view) - offset >= FRAME.size:
            run = runs.at(offset)
            if run is not None:
                self._add_run(view, run, 0, at)
                offset = run.end
                continue
            kind, length = FRAME.unpack_from(view, offset)
            end = offset + FRAME.size + length
            if end > len(view):
                break
            if kind == Opcode.MESSAGE and length >= MESSAGE.size:  # on a channel that is not described
                channel = MESSAGE.unpack_from(view, offset + FRAME.size)[0]
                self._add_run(view, MessageRun(np.array([offset]), np.array([end]), np.array([channel])), 0, at)
                offset = end
                continue
            self._add_record(offset, kind, view[offset + FRAME.size : end], at)
            offset = end
        if offset < len(view):
            self._damage.add(at, "a chunk ends within a record", "a length in it is damaged")
        span = self._messages.end_span(outside)
        if span != (chunk.message_start_time, chunk.message_end_time):
            self._damage.add(at, "a chunk states another first or last time than its messages have", WRONG_INDEX)

    def _add_attachment(self, at: int, body: memoryview) -> None:
        stream = RecordBody(body)
        stream.read(16)
        name = stream.read_prefixed_string()
        stream.read_prefixed_string()
        stream.read(stream.read8())
        end = stream.count
        stated = stream.read4()
        self._met.attachments[at] = FRAME.size + len(body), name
        if stated not in {0, zlib.crc32(body[:end])}:
            self._damage.add(at, f"the checksum of the attachment '{name}' does not fit", "its content is damaged")
