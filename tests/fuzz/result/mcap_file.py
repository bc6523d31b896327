"""An MCAP file from its records: the end of a file, with checksums, statistics and indexes, made from what they are."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random
from typing import TypeAlias

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk as McapChunk
from mcap.records import ChunkIndex, DataEnd, Footer, McapRecord, MetadataIndex, Statistics, SummaryOffset
from mcap.writer import MCAP0_MAGIC

from host.recording import format as fmt

HEAD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")


@dataclass(frozen=True)
class Record:
    """One record: its kind and what follows its length."""

    kind: int
    body: bytes

    @property
    def data(self) -> bytes:
        return HEAD.pack(self.kind, len(self.body)) + self.body


Line: TypeAlias = list[Record]


def records_in(data: bytes) -> list[Record]:
    """Return the records of a file, as the format says."""
    found, at = [], len(MCAP0_MAGIC)
    while at + HEAD.size <= len(data) - len(MCAP0_MAGIC):
        kind, length = HEAD.unpack_from(data, at)
        found.append(Record(kind, data[at + HEAD.size : at + HEAD.size + length]))
        at += HEAD.size + length
    return found


def record_of(value: McapRecord) -> Record:
    """Return a record of the library's as bytes."""
    builder = RecordBuilder()
    value.write(builder)
    data = builder.end()
    return Record(data[0], data[HEAD.size :])


def numbered(line: Line) -> Line:
    """Return the records with the messages of each channel numbered from 0, as a writer does."""
    counts: Counter[int] = Counter()
    found = []
    for record in line:
        if record.kind == Opcode.MESSAGE and len(record.body) >= MESSAGE.size:
            channel, _, log_ns, publish_ns = MESSAGE.unpack_from(record.body)
            head = MESSAGE.pack(channel, counts[channel] & 0xFFFFFFFF, log_ns, publish_ns)
            record = Record(record.kind, head + record.body[MESSAGE.size :])
            counts[channel] += 1
        found.append(record)
    return found


def whole(line: Line, rng: Random | None = None) -> tuple[bytes, bool]:
    """Return the file of records, with its end: checksum, statistics, indexes, footer. Some inputs have no end."""
    data = MCAP0_MAGIC + b"".join(record.data for record in line)
    if rng is not None and rng.random() < 0.1:
        return data[: len(data) - rng.choice((0, 0, 1, 8, 30))], False
    end = b"".join(record.data for record in _end(line, data, rng))
    return data + end + MCAP0_MAGIC, True


def _end(line: Line, data: bytes, rng: Random | None) -> Iterator[Record]:
    """Yield what follows the data: its checksum, and a summary of it with offsets and a checksum of its own."""
    data_end = record_of(DataEnd(zlib.crc32(data)))
    yield data_end
    start = at = len(data) + len(data_end.data)
    statistics = record_of(_statistics(line))
    if rng is not None and rng.random() < 0.15:
        hurt = bytearray(statistics.body)
        for _ in range(rng.choice((1, 1, 4))):
            hurt[rng.randrange(len(hurt))] = rng.choice((0, 1, 255))
        statistics = Record(statistics.kind, bytes(hurt))
    groups = (
        [record for record in line if record.kind == Opcode.SCHEMA],
        [record for record in line if record.kind == Opcode.CHANNEL],
        [statistics],
        list(_indexes(line)),
    )
    summary, offsets = [], []
    for group in groups:
        size = sum(len(record.data) for record in group)
        if group:
            offsets.append(record_of(SummaryOffset(group[0].kind, at, size)))
        summary += group
        at += size
    content = b"".join(record.data for record in (*summary, *offsets))
    crc = zlib.crc32(content + HEAD.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", start, at))
    yield from summary
    yield from offsets
    yield record_of(Footer(start, at, crc))


def _statistics(line: Line) -> Statistics:
    heads = [MESSAGE.unpack_from(record.body) for record in _flat(line) if len(record.body) >= MESSAGE.size]
    kinds = Counter(record.kind for record in line)
    times = [head[2] for head in heads] or [0]
    return Statistics(
        attachment_count=kinds[Opcode.ATTACHMENT],
        channel_count=kinds[Opcode.CHANNEL],
        channel_message_counts=Counter(head[0] for head in heads),
        chunk_count=kinds[Opcode.CHUNK],
        message_count=len(heads),
        message_end_time=max(times),
        message_start_time=min(times),
        metadata_count=kinds[Opcode.METADATA],
        schema_count=kinds[Opcode.SCHEMA],
    )


def _flat(line: Sequence[Record]) -> Iterator[Record]:
    """Yield the messages, those in chunks as well."""
    for record in line:
        if record.kind == Opcode.MESSAGE:
            yield record
        elif record.kind == Opcode.CHUNK:
            yield from _flat(_inside(record))


def _inside(chunk: Record) -> list[Record]:
    try:
        found = McapChunk.read(ReadDataStream(io.BytesIO(chunk.body)))
        data = {"": bytes, "lz4": lz4.frame.decompress, "zstd": zstandard.decompress}[found.compression](found.data)
    except (KeyError, RuntimeError, struct.error, ValueError, McapError, zstandard.ZstdError):
        return []  # one that is damaged on purpose
    return records_in(MCAP0_MAGIC + data + MCAP0_MAGIC)


def _indexes(line: Line) -> Iterator[Record]:
    at = len(MCAP0_MAGIC)
    for record in line:
        if record.kind == Opcode.CHUNK:
            yield record_of(_chunk_index(record, at))
        at += len(record.data)
    at = len(MCAP0_MAGIC)
    for record in line:
        if record.kind == Opcode.METADATA:
            yield record_of(MetadataIndex(at, len(record.data), fmt.METADATA_NAME))
        at += len(record.data)


def _chunk_index(record: Record, at: int) -> ChunkIndex:
    try:
        found = McapChunk.read(ReadDataStream(io.BytesIO(record.body)))
    except (struct.error, ValueError, McapError):
        found = McapChunk("", b"", 0, 0, 0, 0)
    return ChunkIndex(
        chunk_length=len(record.data),
        chunk_start_offset=at,
        compression=found.compression,
        compressed_size=len(found.data),
        message_end_time=found.message_end_time,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=found.message_start_time,
        uncompressed_size=found.uncompressed_size,
    )
