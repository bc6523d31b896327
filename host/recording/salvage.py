"""Finding what is whole in a damaged recording, wherever it stands, without trusting anything around it.

A flipped bit in a record's length throws every reader off that walks from record to record. Here each place that looks
like the beginning of one of our messages is tried, and believed only if its own CRC-32 fits: what was damaged is left
out, what comes after it is found all the same.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Metadata

from host.errors import FileError, unreadable
from host.recording import format as fmt
from host.recording.reader import RecordingHeader, parse_header
from host.recording.ros_message import CDR_LITTLE_ENDIAN
from host.transports.chunks import AnyChunk

MAX_FILE_BYTES = 8 * 2**30
"""Longer recordings, two hundred hours at 200 Hz, are refused: the whole file is held in memory."""
MAX_RAW_BYTES = 16 * 2**20
"""No chunk is longer; a length above it is damage."""
_MESSAGE = struct.Struct("<BQHIQQ")  # kind, length, channel, sequence, log time, publish time
_TOPIC_OF_CHANNEL = {number: topic.name for number, topic in enumerate(fmt.TOPICS, start=1)}
"""Channel ids as every recording of ours has them: a damaged channel record does no harm."""
_KEPT = (fmt.ACTION, fmt.NOTE)


@dataclass(frozen=True, slots=True)
class SalvagedMessage:
    """One message that is whole."""

    topic: str
    time_ns: int
    """Wall clock as its record says; not covered by the CRC."""
    sequence: int
    """Number of the message on its channel as its record says; not covered by the CRC."""
    chunk: AnyChunk | None = None
    """Of a raw message."""
    values: dict[str, Any] = field(default_factory=dict)
    """Of another one."""


def salvage(path: Path) -> tuple[RecordingHeader | None, Iterator[SalvagedMessage]]:
    """Find the header, if it is whole, and the whole messages of a recording in the order of the file.

    Found are both raw channels, the operator's actions and the notes: all others can be made from these again. What
    another tool has compressed cannot be searched.

    Raises
    ------
    FileError
        The file cannot be read, or is too long.
    """
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise FileError(f"{path} is too long to be searched ({size / 2**30:.0f} GiB)", "cut it with an MCAP tool")
        data = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    return _find_header(data), _find_messages(data)


def _find_header(data: bytes) -> RecordingHeader | None:
    name = struct.pack("<I", len(fmt.METADATA_NAME)) + fmt.METADATA_NAME.encode()
    at = data.find(name)
    while at >= 0:
        try:
            metadata = Metadata.read(ReadDataStream(io.BytesIO(data[at : at + 65536])))
            header = parse_header(metadata)
        except Exception:  # noqa: BLE001 - the library raises whatever damaged bytes make it raise
            header = None
        if header is not None:
            return header
        at = data.find(name, at + 1)
    return None


def _find_messages(data: bytes) -> Iterator[SalvagedMessage]:
    at = data.find(CDR_LITTLE_ENDIAN)
    while at >= 0:
        found, end = _raw_at(data, at)
        if found is None:
            found, end = _other_at(data, at)
        if found is None:
            at = data.find(CDR_LITTLE_ENDIAN, at + 1)
        else:
            yield found
            at = data.find(CDR_LITTLE_ENDIAN, end)


def _raw_at(data: bytes, at: int) -> tuple[SalvagedMessage | None, int]:
    """Read a raw message by its own header and CRC alone; the record around it is only asked for its number."""
    length = fmt.raw_length(data, at)
    if length is None or length > MAX_RAW_BYTES or at + length > len(data):
        return None, 0
    message = data[at : at + length]
    for topic in (fmt.RECEIVED, fmt.SENT):
        try:
            chunk = fmt.decode_raw(message, topic)
        except fmt.DamagedMessageError:
            continue
        _, _, sequence, _, publish_ns = _record_before(data, at)
        return SalvagedMessage(topic, publish_ns, sequence, chunk), at + length
    return None, 0


def _other_at(data: bytes, at: int) -> tuple[SalvagedMessage | None, int]:
    """Read an action or a note: its length stands in its record only, its CRC at its end tells whether it is right."""
    kind, length, sequence, topic, publish_ns = _record_before(data, at)
    end = at + length
    if kind != Opcode.MESSAGE or topic not in _KEPT or not 0 < length <= 65536 or end > len(data):
        return None, 0
    kind_of_message = fmt.TYPES[topic]
    try:
        values = kind_of_message.decode(data[at:end])
    except ValueError:
        return None, 0
    if len(kind_of_message.encode(values)) != length:  # a damaged length would swallow what follows
        return None, 0
    return SalvagedMessage(topic, publish_ns, sequence, values=values), end


def _record_before(data: bytes, at: int) -> tuple[int, int, int, str, int]:
    """Give kind, length of the message, number, topic and wall time of the record a message stands in."""
    if at < _MESSAGE.size:
        return 0, 0, 0, "", 0
    kind, length, channel, sequence, _, publish_ns = _MESSAGE.unpack_from(data, at - _MESSAGE.size)
    return kind, length - (_MESSAGE.size - 9), sequence, _TOPIC_OF_CHANNEL.get(channel, ""), publish_ns
