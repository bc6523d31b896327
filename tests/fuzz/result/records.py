"""Mutations of a recording, record by record: lengths, CRCs, numbers, statistics and indexes are put right afterwards.

What stands in the raw records is itself a mutated session, or a plain one. The ends of a file are written here, not by
the product's writer, from what the records have become.
"""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Footer, Metadata, Schema
from mcap.records import Chunk as McapChunk

from firmware_protocol.serial.framing import encode_frame
from host.links.transport import AnyChunk, Chunk, FrameChunk
from host.recording import format as fmt
from host.recording.writer import RecordingWriter
from tests.fuzz.result import frames, packets
from tests.fuzz.result.layouts import FLOATS, edge_integer
from tests.fuzz.result.mcap_file import MESSAGE, Line, Record, numbered, record_of, records_in, whole
from tests.fuzz.result.packets import PAUSES_NS, some
from tests.fuzz.result.sessions import Session
from tests.recorded_trials import MONOTONIC_NS, WALL_NS

MESSAGE_LIMITS = (2**16, 2**32, 2**64, 2**64)
RAW = struct.Struct("<4sQIB3xI")
RAW_CRC = struct.Struct("<QB")
CHANNEL_IDS = {topic.name: number for number, topic in enumerate(fmt.TOPICS, start=1)}
RAW_IDS = (CHANNEL_IDS[fmt.RECEIVED], CHANNEL_IDS[fmt.SENT])
MAX_RECORDS = 1000
TEXTS = (
    "",
    "\x1b[2J",
    "[bold]x[/]",
    "\u202eabc",
    "nan",
    "-1",
    "1e999",
    str(2**64),
    str(10**400),
    "[" * 3000,
    "{}",
    "null",
)
ACTION_KINDS = ("marker", "note", "window-start", "window-stop", "exclude", "include", "finish", "pause", "guide", "?")
UNREADABLE = (McapError, struct.error, ValueError)
"""What the library raises of records that an earlier mutation cut."""
TIMES_S = (*FLOATS, 0.5, 1.0, 1.5, 2.0, 1e9)


@cache
def beginning() -> tuple[Record, ...]:
    """Return the records in front of the first message, as the product writes them."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "empty.mcap"
        RecordingWriter(path, "serial:/dev/ttyACM0?baud=115200", WALL_NS, MONOTONIC_NS, {"cycles": 5}).close()
        found = records_in(path.read_bytes())
    return tuple(found[: next(n for n, record in enumerate(found) if record.kind == Opcode.DATA_END)])


def message(topic: str, data: bytes, time_ns: int, number: int = 0) -> Record:
    """Return the record of a message; times are monotonic."""
    wall_ns = min(max(time_ns + WALL_NS - MONOTONIC_NS, 0), 2**63)
    return Record(Opcode.MESSAGE, MESSAGE.pack(CHANNEL_IDS[topic], number, wall_ns, wall_ns) + data)


def mutated(rng: Random) -> tuple[bytes, bool]:
    """Return the bytes of a recording, and whether its end was written."""
    line = [*beginning(), *_messages(rng)]
    for _ in range(min(int(rng.expovariate(0.5)), 8)):
        rng.choice(MUTATIONS)(line, rng)
        del line[MAX_RECORDS:]
        if not line:
            break
    if rng.random() < 0.6:
        line = numbered(line)
    return whole(line, rng)


def _messages(rng: Random) -> list[Record]:
    """Return what a capture of a session writes, in the order of its times."""
    session, chunks = _link(rng)
    found = [(chunk.host_time_ns, message(fmt.RECEIVED, fmt.encode_raw(chunk), chunk.host_time_ns)) for chunk in chunks]
    is_can = any(isinstance(chunk, FrameChunk) for chunk in chunks)
    for time_ns, packet in session.commands:
        sent = Chunk(packet if is_can else encode_frame(packet), time_ns)
        found.append((time_ns, message(fmt.SENT, fmt.encode_raw(sent, sent=True), time_ns)))
    first_ns, last_ns = (chunks[0].host_time_ns, chunks[-1].host_time_ns) if chunks else (MONOTONIC_NS, MONOTONIC_NS)
    for _ in range(rng.choice((0, 0, 1, 3, 8))):
        time_ns = rng.randint(first_ns, last_ns)
        found.append((time_ns, _action(rng, time_ns)))
    found.append((first_ns, message(fmt.NOTE, fmt.TYPES[fmt.NOTE].encode({"kind": "warning", "text": "x"}), first_ns)))
    view = fmt.encode_quaternion(WALL_NS, (1.0, 0.0, 0.0, 0.0))
    found += [(time_ns, message(fmt.ORIENTATION, view, time_ns)) for time_ns in (first_ns, last_ns)]
    return [record for _, record in sorted(found, key=lambda each: each[0])]


def _link(rng: Random) -> tuple[Session, Sequence[AnyChunk]]:
    if rng.random() < 0.25:
        session, heard = frames.mutated(rng)
        return session, frames.can_chunks(heard, rng)
    session, line = packets.mutated(rng)
    return session, packets.serial_chunks(line, rng)[0]


def _action(rng: Random, time_ns: int) -> Record:
    """Something that the operator did, at any time, with any text."""

    def time_s() -> float:
        return rng.choice((rng.uniform(0, 3), rng.uniform(0, 3), rng.choice(TIMES_S)))

    values = {"kind": rng.choice((*ACTION_KINDS, rng.choice(TEXTS))), "time_s": time_s(), "text": rng.choice(TEXTS)}
    data = fmt.TYPES[fmt.ACTION].encode(values | {"from_s": time_s(), "to_s": time_s()})
    return message(fmt.ACTION, data, time_ns)


def _of(line: Line, *kinds: int) -> list[int]:
    """Return where records of some kinds stand."""
    return [place for place, record in enumerate(line) if record.kind in kinds]


def _raw(line: Line) -> list[int]:
    return [
        place
        for place in _of(line, Opcode.MESSAGE)
        if len(line[place].body) >= MESSAGE.size + RAW.size and MESSAGE.unpack_from(line[place].body)[0] in RAW_IDS
    ]


def _message_field(line: Line, rng: Random) -> None:
    """An edge value in the head of one message, or of all from it on: channel, number, times."""
    places = _of(line, Opcode.MESSAGE)
    if not places:
        return
    start, field, value = rng.randrange(len(places)), rng.randrange(4), None
    for place in places[start : start + rng.choice((1, 1, 5, len(places)))]:
        body = line[place].body
        if len(body) < MESSAGE.size:
            continue
        head = list(MESSAGE.unpack_from(body))
        high = 9 if field == 0 and rng.random() < 0.8 else MESSAGE_LIMITS[field] - 1
        value = edge_integer(rng, 0, high, head[field]) if value is None else value
        head[field] = value
        line[place] = Record(Opcode.MESSAGE, MESSAGE.pack(*head) + body[MESSAGE.size :])


def _raw_field(line: Line, rng: Random) -> None:
    """Another host time, kind or data of one raw message, or of all from it on; the CRC is put right."""
    places = _raw(line)
    if not places:
        return
    start, kind = rng.randrange(len(places)), rng.randrange(4)
    step_ns = rng.choice((-1, 1)) * rng.choice(PAUSES_NS)
    for place in places[start : start + rng.choice((1, 1, 5, len(places)))]:
        head, body = line[place].body[: MESSAGE.size], line[place].body[MESSAGE.size :]
        mark, time_ns, _, what, _ = RAW.unpack_from(body)
        data = body[RAW.size :]
        if kind == 0:
            time_ns = (time_ns + step_ns) % 2**64
        elif kind == 1:
            time_ns = edge_integer(rng, 0, 2**64 - 1, time_ns)
        elif kind == 2:
            what = rng.choice((0, 1, 2, 3, 255))
        else:
            data = rng.choice((b"", data * 2, data[: rng.randrange(len(data) + 1)], rng.randbytes(40), data[::-1]))
        crc = zlib.crc32(data, zlib.crc32(RAW_CRC.pack(time_ns, what)))
        line[place] = Record(Opcode.MESSAGE, head + RAW.pack(mark, time_ns, crc, what, len(data)) + data)


def _description(line: Line, rng: Random) -> None:
    """The recording's own description with edge values; its CRC is put right."""
    for place in _of(line, Opcode.METADATA):
        try:
            values = dict(Metadata.read(ReadDataStream(io.BytesIO(line[place].body))).metadata)
        except UNREADABLE:
            continue
        if not values:
            continue
        key = rng.choice(sorted(values))
        if rng.random() < 0.2:
            del values[key]
        else:
            number = str(rng.choice((-1, 0, 1, 2**31, 2**63, 2**64, 10**30, -(2**63))))
            values[key] = rng.choice((*TEXTS, number, number, json.dumps({"a": [1, None, "\x1b"]}), "can:vcan0?node=3"))
        values["crc32"] = fmt.metadata_crc(values)
        line[place] = record_of(Metadata(rng.choice((fmt.METADATA_NAME,) * 9 + ("x",)), values))


def _channel(line: Line, rng: Random) -> None:
    """A channel with another number, name, encoding or schema; or described twice."""
    places = _of(line, Opcode.CHANNEL)
    if not places:
        return
    place = rng.choice(places)
    try:
        channel = Channel.read(ReadDataStream(io.BytesIO(line[place].body)))
    except UNREADABLE:
        return
    topics = [topic.name for topic in fmt.TOPICS]
    other = (
        replace(channel, id=rng.choice((0, 1, 2, 9, 10, 65535))),
        replace(channel, topic=rng.choice((*topics, *TEXTS))),
        replace(channel, message_encoding=rng.choice(TEXTS), metadata={"offered_qos_profiles": rng.choice(TEXTS)}),
        replace(channel, schema_id=rng.choice((0, 1, 65535))),
    )[rng.randrange(4)]
    if rng.random() < 0.5:
        line[place] = record_of(other)
    else:
        line.insert(rng.randrange(len(line)), record_of(other))


def _other_records(line: Line, rng: Random) -> None:
    """Records that other tools write into a file, or that this format may have one day."""
    record = rng.choice(
        (
            record_of(Attachment(0, 0, "a.txt", "text/plain", rng.randbytes(30))),
            record_of(Metadata("x", {"a": "b"})),
            record_of(Schema(77, rng.randbytes(8), "ros2msg", "a/B")),
            Record(rng.choice((0, 16, 0x80, 0xFF)), rng.randbytes(rng.choice((0, 1, 20)))),
            Record(Opcode.MESSAGE_INDEX, struct.pack("<HI", 1, 0)),
        )
    )
    line.insert(rng.randrange(len(line) + 1), record)


def _another_kind(line: Line, rng: Random) -> None:
    for place in range(*some(line, rng, 10).indices(len(line))):
        line[place] = Record(rng.choice((0, *map(int, Opcode), 16, 255)), line[place].body)


def _early_end(line: Line, rng: Random) -> None:
    end = rng.choice((record_of(DataEnd(rng.choice((0, 1)))), record_of(Footer(0, 0, 0))))
    line.insert(rng.randrange(len(line) + 1), end)


def _another_length(line: Line, rng: Random) -> None:
    place = rng.randrange(len(line))
    body = line[place].body
    line[place] = Record(line[place].kind, rng.choice((body + rng.randbytes(9), body[: rng.randrange(len(body) + 1)])))


def _dropped(line: Line, rng: Random) -> None:
    del line[some(line, rng)]


def _doubled(line: Line, rng: Random) -> None:
    part = line[some(line, rng)]
    at = rng.randrange(len(line) + 1)
    line[at:at] = part


def _swapped(line: Line, rng: Random) -> None:
    part = some(line, rng, 12)
    found = line[part]
    rng.choice((rng.shuffle, list.reverse))(found)
    line[part] = found


def _spliced(line: Line, rng: Random) -> None:
    other = _messages(rng)
    at = rng.randrange(len(line) + 1)
    line[at:at] = other[some(other, rng, 60)]


def _chunked(line: Line, rng: Random) -> None:
    """A part of the records in a chunk, as other tools write them: plain, lz4 or zstd."""
    part = some(line, rng, len(line))
    inner = b"".join(record.data for record in line[part])
    kind, data = rng.choice((("", inner), ("lz4", lz4.frame.compress(inner)), ("zstd", zstandard.compress(inner))))
    size, crc = len(inner), zlib.crc32(inner)
    if rng.random() < 0.2:
        size = edge_integer(rng, 0, 2**64 - 1, size)
    if rng.random() < 0.1:
        crc = rng.choice((0, crc ^ 1))
    if rng.random() < 0.1:
        kind = rng.choice(("x", "zstd", "lz4", ""))
    line[part] = [record_of(McapChunk(kind, data, 2**62, 0, crc, size))]


MUTATIONS: tuple[Callable[[Line, Random], None], ...] = (
    _message_field,
    _message_field,
    _raw_field,
    _raw_field,
    _raw_field,
    _description,
    _channel,
    _other_records,
    _another_kind,
    _early_end,
    _another_length,
    _dropped,
    _doubled,
    _swapped,
    _spliced,
    _chunked,
    _chunked,
)
