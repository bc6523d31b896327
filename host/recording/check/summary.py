"""Checking what a file states about itself behind its data, against what was met: counts, indexes, offsets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Chunk, ChunkIndex, Footer, MetadataIndex, Statistics, SummaryOffset

from host.recording.check.account import Findings
from host.recording.check.messages import MessageCheck

WRONG_INDEX = "tools that jump by the index read the wrong place; the data are not concerned"
WRONG_COUNT = "records are missing from the file, or the statistics are damaged"


@dataclass(slots=True)
class MetChunk:
    """One chunk that was met, with the message indexes behind it."""

    record_bytes: int
    chunk: Chunk
    """Without its data."""
    index_places: dict[int, int] = field(default_factory=dict)
    """Where the message index of each channel stands."""
    index_bytes: int = 0


@dataclass(slots=True)
class MetRecords:
    """What a summary refers to, as it was met on the way."""

    chunks: dict[int, MetChunk] = field(default_factory=dict)
    """By offset, as the next two."""
    attachments: dict[int, tuple[int, str]] = field(default_factory=dict)
    """Bytes of the record, name."""
    metadata: dict[int, tuple[int, str]] = field(default_factory=dict)
    n_schemas: int = 0
    groups: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Of the summary, records of one kind that follow each other: by their start, kind and end."""
    last_group: int = -1
    """Start of the one that may go on."""

    def add_to_group(self, kind: int, start: int, end: int) -> None:
        """Enter a record of the summary."""
        if self.groups.get(self.last_group) != (kind, start):
            self.last_group = start
        self.groups[self.last_group] = kind, end


class SummaryCheck:
    """Compares the records of a summary with what was met."""

    def __init__(self, met: MetRecords, messages: MessageCheck, damage: Findings) -> None:
        self.stated: Mapping[int, int] | None = None
        """Records by channel, as the statistics have them."""
        self._met = met
        self._messages = messages
        self._damage = damage
        self._indexed: dict[str, set[int]] = {"chunk": set(), "attachment": set(), "metadata": set()}

    def add_statistics(self, at: int, found: Statistics) -> None:
        """Enter the counts."""
        met, messages = self._met, self._messages
        if self.stated is not None:
            self._damage.add(at, "the file states its counts twice", WRONG_COUNT)
            return
        self.stated = found.channel_message_counts
        pairs = {
            "messages": (found.message_count, messages.n),
            "schemas": (found.schema_count, met.n_schemas),
            "channels": (found.channel_count, len(messages.channels)),
            "attachments": (found.attachment_count, len(met.attachments)),
            "metadata records": (found.metadata_count, len(met.metadata)),
            "chunks": (found.chunk_count, len(met.chunks)),
        }
        for what, (stated, there) in pairs.items():
            if stated != there:
                self._damage.add(at, f"the file states {stated} {what} and holds {there}", WRONG_COUNT)
        for channel, checked in messages.channels.items():
            stated = found.channel_message_counts.get(channel, 0)
            if stated != checked.count:
                what = f"the file states {stated} records of {checked.topic} and holds {checked.count}"
                self._damage.add(at, what, WRONG_COUNT)
        for channel, stated in found.channel_message_counts.items():
            if stated and channel not in messages.channels:
                what = f"the file states {stated} records of channel {channel}, which is not described"
                self._damage.add(at, what, WRONG_COUNT)
        span = messages.first_ns or 0, messages.last_ns or 0
        if (found.message_start_time, found.message_end_time) != span:
            self._damage.add(at, "the file states another first or last time than its messages have", WRONG_COUNT)

    def add_chunk_index(self, at: int, found: ChunkIndex) -> None:
        """Enter the index of one chunk."""
        met = self._met.chunks.get(found.chunk_start_offset)
        self._indexed["chunk"].add(found.chunk_start_offset)
        if met is None:
            self._damage.add(
                at, f"a chunk starts at {found.chunk_start_offset} by the index, and none does", WRONG_INDEX
            )
            return
        pairs = {
            "length": (found.chunk_length, met.record_bytes),
            "compression": (found.compression, met.chunk.compression),
            "size": (found.uncompressed_size, met.chunk.uncompressed_size),
            "first time": (found.message_start_time, met.chunk.message_start_time),
            "last time": (found.message_end_time, met.chunk.message_end_time),
            "length of its message indexes": (found.message_index_length, met.index_bytes),
            "places of its message indexes": (found.message_index_offsets, met.index_places),
        }
        wrong = [what for what, (stated, there) in pairs.items() if stated != there]
        if wrong:
            what = f"the index of the chunk at {found.chunk_start_offset} states another {', '.join(wrong)}"
            self._damage.add(at, what, WRONG_INDEX)

    def add_attachment_index(self, at: int, found: AttachmentIndex) -> None:
        """Enter the index of one attachment."""
        self._add_index(at, "attachment", self._met.attachments, found)

    def add_metadata_index(self, at: int, found: MetadataIndex) -> None:
        """Enter the index of one metadata record."""
        self._add_index(at, "metadata", self._met.metadata, found)

    def _add_index(
        self, at: int, what: str, met: Mapping[int, tuple[int, str]], found: AttachmentIndex | MetadataIndex
    ) -> None:
        self._indexed[what].add(found.offset)
        if met.get(found.offset) != (found.length, found.name):
            self._damage.add(
                at, f"the index states {what} '{found.name}' at {found.offset}, where it is not", WRONG_INDEX
            )

    def add_summary_offset(self, at: int, found: SummaryOffset) -> None:
        """Enter where the records of one kind stand, as stated."""
        group = found.group_opcode, found.group_start + found.group_length
        if found.group_length and self._met.groups.get(found.group_start) != group:
            self._damage.add(at, f"no group of the summary is at {found.group_start}, as stated", WRONG_INDEX)

    def add_footer(self, at: int, found: Footer, summary_start: int | None) -> None:
        """Enter the footer; ``summary_start`` is the offset behind the end of the data, None where there is none."""
        offsets = [start for start, (kind, _) in self._met.groups.items() if kind == Opcode.SUMMARY_OFFSET]
        if found.summary_start and found.summary_start != summary_start:
            what = f"the summary starts at {found.summary_start} by the footer, the data end at {summary_start}"
            self._damage.add(at, what, WRONG_INDEX)
        if (
            found.summary_offset_start
            and offsets != [found.summary_offset_start]
            and (offsets or summary_start is None)
        ):
            what = f"the summary's offsets start at {found.summary_offset_start} by the footer, and none does"
            self._damage.add(at, what, WRONG_INDEX)
        if found.summary_start:
            self._check_complete(at)

    def _check_complete(self, at: int) -> None:
        """Report what has no index although others of its kind have one."""
        met = self._met
        there = {"chunk": met.chunks.keys(), "attachment": met.attachments.keys(), "metadata": met.metadata.keys()}
        for what, indexed in self._indexed.items():
            lacking = len(there[what] - indexed)
            if indexed and lacking:
                self._damage.add(at, f"{lacking} {what} record{'s' * (lacking > 1)} without an index", WRONG_INDEX)
