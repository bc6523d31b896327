"""What of a recording is there, by the format's own checks: numbers of records, statistics, checksums.

A record that is damaged in its head is skipped without a trace, and the samples in it look as if the link had lost
them. But the records of a channel are numbered, and a file that was closed states how many there are. So it is known
where records are missing, and the account of samples separates the file's damage from the link's losses.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Statistics
from mcap.writer import MCAP0_MAGIC

from host.recording.bulk.walk import ENDINGS, FRAME, MAX_RECORD_BYTES, SUMMARY_CRC_BYTES

IntArray = npt.NDArray[np.int64]

FARTHEST = 1_000_000
"""A number farther from the one before is damaged itself: nothing of what it leaves out is counted."""
_PARSE_ERRORS = (McapError, struct.error, ValueError, EOFError)
_FOOTER_BYTES = FRAME.size + ENDINGS[Opcode.FOOTER]


class SectionChecksums:
    """The checksums over the two parts of a file: the data, and behind it the summary with the footer."""

    def __init__(self) -> None:
        self.ended = False
        """Whether the end of the data has been met."""
        self.stated_data = self.stated_summary = 0
        """As stated in the file; 0 where it states none."""
        self._data = self._summary = 0

    def add_bytes(self, data: memoryview | bytes) -> None:
        """Enter the next bytes of the file, up to the last checksum in it: of the data, then of the summary."""
        if self.ended:
            self._summary = zlib.crc32(data, self._summary)
        else:
            self._data = zlib.crc32(data, self._data)

    def add_data_end(self, body: memoryview) -> None:
        """Enter the record that ends the data."""
        self.ended, self._summary = True, 0
        self.stated_data = DataEnd.read(ReadDataStream(io.BytesIO(body))).data_section_crc

    def add_footer(self, body: memoryview) -> None:
        """Enter the record that ends the file."""
        self.stated_summary = Footer.read(ReadDataStream(io.BytesIO(body))).summary_crc

    @property
    def data_fits(self) -> bool:
        """Whether the bytes in front of the end of the data are those that were written, where that is known."""
        return self.stated_data in {0, self._data}

    @property
    def summary_fits(self) -> bool:
        """Whether the bytes behind it, with what the file states about itself, are those written."""
        return not self.ended or self.stated_summary in {0, self._summary}


class NumberedRecords:
    """The numbers of one channel's records, in the order of the file; the first is 0 unless stated otherwise."""

    def __init__(self, first: int = 0) -> None:
        self.read = self.missing = self.disordered = 0
        self._next = first

    @property
    def unnumbered(self) -> bool:
        """Whether all numbers so far are 0, as other tools write them."""
        return self._next == 1 and self.disordered == self.read - 1

    def add(self, numbers: IntArray) -> list[tuple[int, int]]:
        """Enter the numbers (n,) of the next records, n > 0.

        Returns
        -------
        list of (place, records)
            In front of which of them the file lacks records, and how many; 0 where the order is broken otherwise.
        """
        self.read += len(numbers)
        expected, self._next = self._next, int(numbers[-1]) + 1
        if numbers[0] == expected and len(numbers) == numbers[-1] + 1 - expected and (np.diff(numbers) == 1).all():
            return []
        ahead = np.diff(numbers, prepend=expected - 1) - 1
        # A number that jumps, and the next one goes on as if it had not: only the number itself is damaged.
        lone = np.flatnonzero((ahead[:-1] != 0) & (ahead[:-1] == -ahead[1:]))
        self.disordered += len(lone)
        ahead[lone] = ahead[lone + 1] = 0
        if expected <= 1:  # 0 again and again is not a number
            n_zeros = int(np.argmax(np.append(numbers, 1) != 0))
            self.disordered += max(n_zeros - 1 + expected, 0)
            ahead[:n_zeros] = 0
        gone = np.where((ahead > 0) & (ahead < FARTHEST), ahead, 0)
        self.missing += int(gone.sum())
        self.disordered += int(np.count_nonzero(ahead)) - int(np.count_nonzero(gone))
        places = np.flatnonzero(ahead)
        return list(zip(places.tolist(), gone[places].tolist(), strict=True))


class Completeness:
    """Compares the records of a file, as they are read in order, with what the file states about them."""

    def __init__(self) -> None:
        self.checksums = SectionChecksums()
        self._channels: dict[int, NumberedRecords] = {}
        self._earlier: Counter[str] = Counter()
        self._stated: Mapping[int, int] | None = None
        self._strange = self._undescribed = self._behind = 0

    def add_messages(self, channel: int, numbers: IntArray) -> list[tuple[int, int]]:
        """Enter messages of a channel that is read; returns as :meth:`NumberedRecords.add`."""
        self._behind += len(numbers) if self.checksums.ended else 0
        return self._channels.setdefault(channel, NumberedRecords()).add(numbers)

    def add_undescribed(self, n: int) -> None:
        """Enter messages on channels that the file has not described."""
        self._undescribed += n

    def add_missing_before(self, topic: str, records: int) -> None:
        """Enter records that were missing from the file that this one was recovered from."""
        self._earlier[topic] += records

    def add_other(self, kind: int, body: memoryview) -> None:
        """Enter a record other than a message."""
        if not 0 < kind <= Opcode.DATA_END:
            self._strange += 1
        elif kind == Opcode.DATA_END:
            self.checksums.add_data_end(body)
        elif kind == Opcode.FOOTER:
            self.checksums.add_footer(body)
        elif kind == Opcode.STATISTICS and self.checksums.ended:
            try:
                self._stated = Statistics.read(ReadDataStream(io.BytesIO(body))).channel_message_counts
            except _PARSE_ERRORS:
                self._stated = None

    def sentences(self, topics: Mapping[int, str]) -> list[str]:
        """Return what does not add up; ``topics`` are the names of the channels that were read."""
        found = []
        if self._strange:
            found.append(f"{self._strange} records are of no kind that the format knows: damaged in the file")
        if self._undescribed:
            found.append(f"{self._undescribed} messages are on channels that the file does not describe")
        if self._behind:
            found.append(f"{self._behind} messages stand behind the end of the data: damaged in the file")
        if not self.checksums.summary_fits:
            found.append("the summary of the file is damaged: how many records it states is not relied on")
            self._stated = None
        for channel, topic in topics.items():
            found += self._of_channel(channel, topic)
        for topic, n in self._earlier.items():
            if topic in topics.values():
                found.append(f"{_records(n, topic)} missing from the file that this one was recovered from: {WHOSE}")
        return found

    def _of_channel(self, channel: int, topic: str) -> list[str]:
        records = self._channels.get(channel, NumberedRecords())
        read, missing, disordered = records.read, records.missing, records.disordered
        stated = read + missing if self._stated is None else self._stated.get(channel, 0)
        if records.unnumbered:
            missing = disordered = 0
        if missing and stated != read:
            return [f"{_records(missing, topic)} missing from the file: {WHOSE}"]
        if stated != read and self._stated is not None:
            return [f"the file states {stated} records of {topic} and holds {read}: damaged in the file"]
        if missing or disordered:
            return [f"records of {topic} stand in the file twice or out of order: damaged in the file"]
        return []


def stated_counts(path: Path) -> dict[int, int]:
    """Return how many records a closed file states by channel; empty where it was not closed, or states it damaged.

    Raises
    ------
    OSError
        It cannot be read.
    """
    end_bytes = _FOOTER_BYTES + len(MCAP0_MAGIC)
    with path.open("rb") as file:
        footer_at = file.seek(0, io.SEEK_END) - end_bytes
        if footer_at < 0:
            return {}
        file.seek(footer_at)
        end = file.read()
        if end[0] != Opcode.FOOTER or end[_FOOTER_BYTES:] != MCAP0_MAGIC:
            return {}
        footer = Footer.read(ReadDataStream(io.BytesIO(end[FRAME.size :])))
        if not max(footer_at - MAX_RECORD_BYTES, 0) < footer.summary_start < footer_at:
            return {}
        file.seek(footer.summary_start)
        summary = file.read(footer_at - footer.summary_start + _FOOTER_BYTES)
    if footer.summary_crc != zlib.crc32(summary[:-SUMMARY_CRC_BYTES]):
        return {}
    at = 0
    while at + FRAME.size <= len(summary) - _FOOTER_BYTES:
        kind, length = FRAME.unpack_from(summary, at)
        if kind == Opcode.STATISTICS:
            body = io.BytesIO(summary[at + FRAME.size : at + FRAME.size + length])
            try:
                return dict(Statistics.read(ReadDataStream(body)).channel_message_counts)
            except _PARSE_ERRORS:  # under a right checksum, but not what it should be
                return {}
        at += FRAME.size + length
    return {}


WHOSE = "damaged there, not lost on the link"


def _records(n: int, topic: str) -> str:
    return f"1 record of {topic} is" if n == 1 else f"{n} records of {topic} are"
