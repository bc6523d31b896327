"""What of a recording is there, by the format's own checks: numbers of records, statistics, checksum.

A record that is damaged in its head is skipped without a trace, and the samples in it look as if the link had lost
them. But the records of a channel are numbered, and a file that was closed states how many there are.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import DataEnd, Statistics

FARTHEST = 1_000_000
"""A number farther from the one before is damaged itself: nothing of what it leaves out is counted."""


class Completeness:
    """Compares the records of a file, as they are read in order, with what the file states about them."""

    def __init__(self) -> None:
        self.ended = False
        """Whether the end of the data has been met."""
        self._crc = self._stated_crc = 0
        self._read: Counter[int] = Counter()
        self._next: dict[int, int] = {}
        self._missing: Counter[int] = Counter()
        self._disordered: Counter[int] = Counter()
        self._stated: Mapping[int, int] | None = None
        self._strange = self._undescribed = self._behind = 0

    def add_bytes(self, data: memoryview | bytes) -> None:
        """Enter the next bytes of the file, for the checksum over all in front of the end of the data."""
        if not self.ended:
            self._crc = zlib.crc32(data, self._crc)

    def add_messages(self, channel: int, numbers: npt.NDArray[np.int64]) -> None:
        """Enter messages of a channel that is read; ``numbers`` (n,) are those in their records, n > 0."""
        self._read[channel] += len(numbers)
        self._behind += len(numbers) if self.ended else 0
        expected = self._next.get(channel, 0)
        self._next[channel] = int(numbers[-1]) + 1
        if numbers[0] == expected and len(numbers) == numbers[-1] + 1 - expected and (np.diff(numbers) == 1).all():
            return
        ahead = np.diff(numbers, prepend=expected - 1) - 1
        self._missing[channel] += int(ahead[(ahead > 0) & (ahead < FARTHEST)].sum())
        self._disordered[channel] += int(np.count_nonzero((ahead < 0) | (ahead >= FARTHEST)))

    def add_undescribed(self, n: int) -> None:
        """Enter messages on channels that the file has not described."""
        self._undescribed += n

    def add_other(self, kind: int, body: memoryview) -> None:
        """Enter a record that is no message."""
        if not 0 < kind <= Opcode.DATA_END:
            self._strange += 1
        elif kind == Opcode.DATA_END:
            self.ended = True
            self._stated_crc = DataEnd.read(ReadDataStream(io.BytesIO(body))).data_section_crc
        elif kind == Opcode.STATISTICS and self.ended:
            try:
                self._stated = Statistics.read(ReadDataStream(io.BytesIO(body))).channel_message_counts
            except (McapError, struct.error, EOFError):
                self._stated = None

    def checksum_fits(self) -> bool:
        """Return whether the bytes in front of the end of the data are those that were written, where that is known."""
        return self._stated_crc in {0, self._crc}

    def sentences(self, topics: Mapping[int, str]) -> list[str]:
        """Return what does not add up; ``topics`` are the names of the channels that were read."""
        found = []
        if self._strange:
            found.append(f"{self._strange} records are of no kind that the format knows: damaged in the file")
        if self._undescribed:
            found.append(f"{self._undescribed} messages are on channels that the file does not describe")
        if self._behind:
            found.append(f"{self._behind} messages stand behind the end of the data: damaged in the file")
        for channel, topic in topics.items():
            found += self._of_channel(channel, topic)
        return found

    def _of_channel(self, channel: int, topic: str) -> list[str]:
        read, missing, disordered = self._read[channel], self._missing[channel], self._disordered[channel]
        stated = read + missing if self._stated is None else self._stated.get(channel, 0)
        if disordered == read - 1 and self._next.get(channel) == 1:  # all are 0: another tool does not number them
            missing = disordered = 0
        if missing and stated != read:
            what = f"1 record of {topic} is" if missing == 1 else f"{missing} records of {topic} are"
            why = "damaged there, not lost on the link, where the losses count what it held"
            return [f"{what} missing from the file: {why}"]
        if stated != read and self._stated is not None:
            return [f"the file states {stated} records of {topic} and holds {read}: damaged in the file"]
        if missing or disordered:
            return [f"records of {topic} stand in the file twice or out of order: damaged in the file"]
        return []
