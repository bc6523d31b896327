"""A clean recording from a cut or damaged one: what is whole is found wherever it stands.

A flipped bit in a record's length throws every reader off that walks from record to record. Here each place that looks
like the start of one of our messages is tried, and believed only if its own CRC-32 fits: what was damaged is left
out, what comes after it is found all the same. Whatever the bytes claim, the search takes time in proportion to them:
:mod:`host.recording.bulk.span_checksums` checks a claim of any length at the same cost.
"""

from __future__ import annotations

import contextlib
import heapq
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from host.errors import FileError, unreadable
from host.links.transport import MAX_CHUNK_BYTES, AnyChunk
from host.recording import format as fmt
from host.recording.bulk.span_checksums import span_checksums
from host.recording.cdr import CDR_LITTLE_ENDIAN, RosMessageType
from host.recording.completeness import FARTHEST, stated_counts
from host.recording.load import node_of
from host.recording.reader import RecordingHeader, parse_header, parse_missing
from host.recording.views import add_views
from host.recording.writer import RecordingWriter
from host.trial.live import Trial

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was found in a damaged recording, and what was not."""

    chunks: int
    """Whole records of what the link delivered."""
    sent: int
    """Whole records of what the host sent."""
    actions: int
    """Whole records of what the operator did."""
    notes: int
    missing_chunks: int
    """Records of what the link delivered that are damaged; behind the last whole one only a closed file counts them."""
    missing_others: int
    """Records of the other kinds above that are damaged."""
    header_found: bool
    """Whether link, date and settings are known."""

    def sentences(self) -> list[str]:
        """Return it in words."""
        found = [f"{self.chunks} records of received data are whole, {self.missing_chunks} are damaged and left out"]
        if self.missing_others:
            found.append(f"{self.missing_others} records of commands, actions or notes are damaged and left out")
        if not self.header_found:
            found.append("the file's own description is damaged: link and settings are not known")
        return found

    def to_json(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def recover(source: Path, target: Path) -> Recovery:
    """Write a clean recording of everything whole in a damaged one.

    The raw channels, the operator's actions and the notes are copied; samples, packets and end points for viewers are
    made again from them. Nothing is taken over whose CRC-32 does not fit.

    Parameters
    ----------
    source : Path
        Any file that once was a recording.
    target : Path
        Must not exist.

    Raises
    ------
    FileError
        Nothing can be found, or the new file cannot be written.
    """
    header, messages = salvage(source)
    leading = list[SalvagedMessage]()
    for message in messages:
        leading.append(message)
        if not message.missing:
            break
    head, first = header, next((message for message in leading if not message.missing), None)
    if head is None and first is not None:  # the date from the first whole record
        head = RecordingHeader("", "", first.time_ns, 0 if first.chunk is None else first.chunk.host_time_ns)
    if head is None:
        raise FileError(f"{source} holds no whole record of a recording", "give a file that `rotdrift capture` wrote")
    # The source's own numbers stay in the notes: a recovered recording shows what it is.
    writer = RecordingWriter(target, head.link, head.wall_time_ns, head.monotonic_ns, head.settings)
    copier = _Copier(writer, head)
    try:
        # A capture killed before its first flush leaves a header and nothing else: that is a recording too.
        for message in chain(leading, messages):
            copier.copy(message)
        copier.count_last(stated_counts(source))
        found = copier.finish(header_found=header is not None)
        writer.add_note("recovered", f"from {source.name}: {'; '.join(found.sentences())}", copier.last_ns)
    finally:
        problems: list[str] = []
        writer.close(problems.append)
    if problems:
        raise FileError(problems[0], "make room on the disk and try again")
    return found


class _Copier:
    def __init__(self, writer: RecordingWriter, head: RecordingHeader) -> None:
        self._writer = writer
        self._wall_minus_monotonic_ns = head.wall_time_ns - head.monotonic_ns
        self._trial = Trial(node_of(head))
        self._counts: Counter[str] = Counter()
        self._next: dict[str, int] = {}
        self._missing: Counter[str] = Counter()
        self.last_ns = head.monotonic_ns

    def copy(self, message: SalvagedMessage) -> None:
        if message.missing:
            self._note_missing(message.topic, message.missing)
            return
        self._count(message)
        chunk = message.chunk
        if chunk is None:
            at_ns = max(self.last_ns, min(message.time_ns - self._wall_minus_monotonic_ns, self.last_ns + 10**9))
            self._writer.add_values(message.topic, message.values, at_ns)
        elif message.topic == fmt.SENT:
            self._writer.add_sent(chunk.data, chunk.host_time_ns)
        else:
            self._writer.add_received(chunk)
            add_views(self._writer, self._trial.feed(chunk), chunk.host_time_ns)
            self.last_ns = chunk.host_time_ns
        self._writer.flush_if_due(self.last_ns)

    def _count(self, message: SalvagedMessage) -> None:
        """Count what is missing by the records' own numbers; a number far off is damage itself and passed over."""
        self._counts[message.topic] += 1
        expected = self._next.get(message.topic, 0)
        gone = message.sequence - expected
        if 0 <= gone < FARTHEST:
            if gone:
                self._note_missing(message.topic, gone)
            self._next[message.topic] = message.sequence + 1
        else:
            self._next[message.topic] = expected + 1

    def count_last(self, stated: Mapping[int, int]) -> None:
        """Count what is missing behind the last whole record of each channel, by how many the file states."""
        for channel, topic in enumerate(fmt.TOPICS, start=1):
            gone = stated.get(channel, 0) - self._next.get(topic.name, 0)
            if topic.name in COUNTED and 0 < gone < FARTHEST:
                self._note_missing(topic.name, gone)

    def _note_missing(self, topic: str, records: int) -> None:
        """Count missing records, and record them in their place, so that nobody takes them for a loss on the link."""
        self._missing[topic] += records
        self._writer.add_missing(topic, records)

    def finish(self, *, header_found: bool) -> Recovery:
        """Copy what the decoder still holds; return what was found."""
        add_views(self._writer, self._trial.finish(), self.last_ns)
        for sentence in self._trial.failures:  # why channels of the viewers lack something
            self._writer.add_note("warning", sentence, self.last_ns)
        return Recovery(
            chunks=self._counts[fmt.RECEIVED],
            sent=self._counts[fmt.SENT],
            actions=self._counts[fmt.ACTION],
            notes=self._counts[fmt.NOTE],
            missing_chunks=self._missing[fmt.RECEIVED],
            missing_others=self._missing[fmt.SENT] + self._missing[fmt.ACTION] + self._missing[fmt.NOTE],
            header_found=header_found,
        )


MAX_FILE_BYTES = 8 * 2**30
"""Longer recordings, two hundred hours at 200 Hz, are refused: the whole file is held in memory."""
LONGEST_RAW_BYTES = fmt.RAW_HEAD_BYTES + 2 * MAX_CHUNK_BYTES
"""No raw message is longer: the thread that reads a link joins two reads at most. A length above it is damage."""
MAX_CHECKED_BYTES = 2**16
"""Nor is an action or a note, whose texts are bounded."""
SEARCH_BLOCK_BYTES = 2**20
"""Searched at a time. What a block claims reaches behind it by the longest message: an eighth is checksummed twice."""
MAX_MISSING_BYTES = 256
"""Of a metadata record on missing records: name, topic, number, CRC."""
COUNTED = (fmt.RECEIVED, fmt.SENT, fmt.ACTION, fmt.NOTE)
"""Topics whose records are copied."""
MAX_HEADER_TRIES = 64
"""Reading a description costs more per byte than anything else; a recording has one, and at most a few copies."""
_MESSAGE = struct.Struct("<BQHIQQ")  # kind, length, channel, sequence, log time, publish time
_KEPT = {number: topic.name for number, topic in enumerate(fmt.TOPICS, start=1) if topic.name in {fmt.ACTION, fmt.NOTE}}
"""By channel id, which every recording of ours has in common: a damaged channel record does no harm."""
_ENCAPSULATION = int.from_bytes(CDR_LITTLE_ENDIAN, "little")


@dataclass(frozen=True, slots=True)
class SalvagedMessage:
    """One message that is whole."""

    topic: str
    time_ns: int
    """Wall clock as in its record; not covered by the CRC."""
    sequence: int
    """Number of the message on its channel as in its record; not covered by the CRC."""
    chunk: AnyChunk | None = None
    """Of a raw message."""
    values: dict[str, Any] = field(default_factory=dict)
    """Of another one."""
    missing: int = 0
    """No message, but so many of the topic that the file itself states to be missing here: it was recovered before."""


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
        if path.exists() and not (path.is_file() or path.is_dir()):  # a device may never end
            raise FileError(f"{path} is not a file", "give a file that `rotdrift capture` wrote")
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
    for _ in range(MAX_HEADER_TRIES):
        header = parse_header(data[at : at + 65536]) if at >= 0 else None
        if at < 0 or header is not None:
            return header
        at = data.find(name, at + 1)
    return None


def _find_missing(data: bytes) -> Iterator[tuple[int, SalvagedMessage]]:
    """Yield where the file states that records are missing, with what."""
    name = struct.pack("<I", len(fmt.MISSING_NAME)) + fmt.MISSING_NAME.encode()
    at = data.find(name)
    while at >= 0:
        missing = parse_missing(data[at : at + MAX_MISSING_BYTES])
        if missing is not None and missing[0] in COUNTED and 0 < missing[1] < FARTHEST:
            yield at, SalvagedMessage(missing[0], 0, 0, missing=missing[1])
        at = data.find(name, at + 1)


def _find_messages(data: bytes) -> Iterator[SalvagedMessage]:
    """Return the whole messages, and what the file states to be missing, in the order of the file."""
    located = heapq.merge(_locate_messages(data), _find_missing(data), key=itemgetter(0))
    return map(itemgetter(1), located)


def _locate_messages(data: bytes) -> Iterator[tuple[int, SalvagedMessage]]:
    """Search block by block for what claims to be a message; yield it with its place.

    A CRC that fits proves where a message ends: claims within it are its data, and it is read once or never.
    """
    view, done = memoryview(data), 0
    for first in range(0, len(data), SEARCH_BLOCK_BYTES):
        base = max(first - _MESSAGE.size, 0)  # the record in front of the first message
        block = view[base : first + SEARCH_BLOCK_BYTES + LONGEST_RAW_BYTES]
        heads = np.flatnonzero(_numbers(block, "<u4") == _ENCAPSULATION) + base
        heads = heads[(heads >= first) & (heads < first + SEARCH_BLOCK_BYTES)] - base
        found = [(at, end, "") for at, end in _whole_raw(block, heads)]
        for number, topic in _KEPT.items():
            found += [(at, end, topic) for at, end in _whole_checked(block, heads, number, fmt.TYPES[topic])]
        for at, end, topic in sorted(found):
            if base + at >= done:
                done = base + end
                message = _message_at(data, base + at, done, topic)
                if message is not None:
                    yield base + at, message


def _numbers(block: memoryview, dtype: str) -> npt.NDArray[np.unsignedinteger]:
    """Return the number that starts at each byte of a block."""
    size = np.dtype(dtype).itemsize
    return np.ndarray((max(len(block) - size + 1, 0),), dtype, block, strides=(1,))


def _whole_raw(block: memoryview, heads: IntArray) -> Iterator[tuple[int, int]]:
    """Yield start and end of the raw messages whose own header and CRC fit; the record around each is not asked."""
    heads = heads[heads + fmt.RAW_HEAD_BYTES <= len(block)]
    kinds, sizes = _numbers(block, "u1")[heads + 16], _numbers(block, "<u4")[heads + 20]
    starts = heads + fmt.RAW_HEAD_BYTES
    ends = starts + sizes
    claims = (kinds <= fmt.SENT_KIND) & (ends - heads <= LONGEST_RAW_BYTES) & (ends <= len(block))
    heads, starts, ends = heads[claims], starts[claims], ends[claims]
    crcs = np.zeros(len(heads), np.uint32)  # of host time, kind and data, as `encode_raw` has them
    for start, end in ((heads + 4, heads + 12), (heads + 16, heads + 17), (starts, ends)):
        crcs = span_checksums(block, start, end, crcs)
    fits = crcs == _numbers(block, "<u4")[heads + 12]
    return zip(heads[fits].tolist(), ends[fits].tolist(), strict=True)


def _whole_checked(block: memoryview, heads: IntArray, channel: int, kind: RosMessageType) -> Iterator[tuple[int, int]]:
    """Yield start and end of the messages of a type whose CRC, the last field, fits; their length is the record's."""
    heads = heads[heads >= _MESSAGE.size]
    records = heads - _MESSAGE.size
    sizes = (_numbers(block, "<u8")[records + 1] - np.uint64(_MESSAGE.size - 9)).astype(np.int64)
    claims = (_numbers(block, "u1")[records] == int(Opcode.MESSAGE)) & (_numbers(block, "<u2")[records + 9] == channel)
    claims &= (sizes >= 8) & (sizes <= MAX_CHECKED_BYTES) & (heads + sizes <= len(block))
    heads, ends = heads[claims], (heads + sizes)[claims]
    seeds = np.full(len(heads), zlib.crc32(kind.name.encode()), np.uint32)
    crcs = span_checksums(block, heads + len(CDR_LITTLE_ENDIAN), ends - 4, seeds)
    fits = crcs == _numbers(block, "<u4")[ends - 4]
    return zip(heads[fits].tolist(), ends[fits].tolist(), strict=True)


def _message_at(data: bytes, at: int, end: int, topic: str) -> SalvagedMessage | None:
    """Read a message whose CRC fits, a raw one without a topic; the record around it has its number and wall time."""
    sequence, publish_ns = 0, 0
    if at >= _MESSAGE.size:
        _, _, _, sequence, _, publish_ns = _MESSAGE.unpack_from(data, at - _MESSAGE.size)
    for name in [topic] if topic else [fmt.RECEIVED, fmt.SENT]:
        with contextlib.suppress(ValueError):  # the other raw topic; or a version with other fields
            if topic:
                return SalvagedMessage(topic, publish_ns, sequence, values=fmt.TYPES[topic].decode(data[at:end]))
            return SalvagedMessage(name, publish_ns, sequence, fmt.decode_raw(data[at:end], name))
    return None
