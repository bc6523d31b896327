"""Walking the records of an MCAP file in order: block by block, many messages at once, up to the end.

Only the records' frames (one byte of kind, eight of length) are looked at, so that an hour is walked in seconds. A file
that ends in the middle of a record is walked up to there. What the format forbids is reported with its place.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from host.recording.bulk.record_runs import EvenRun, MessageRun, RecordRuns

MAX_RECORD_BYTES = 64 * 2**20
"""A longer record is damage: ours have at most 64 KiB."""
ENDINGS = {int(Opcode.DATA_END): 4, int(Opcode.FOOTER): 20}
"""Length of the records that end the data and the file."""
SUMMARY_CRC_BYTES = 4
"""The last field of a footer, which its own checksum leaves out."""
READ_BLOCK_BYTES = 2 * 2**20
HANDFUL_BYTES = 4096
"""So little at the end of a block waits for the next: a few records by themselves cost as much as thousands."""
FRAME = struct.Struct("<BQ")
"""What each record starts with: kind, length of the body."""
MESSAGE = struct.Struct("<HIQQ")
"""What the body of a message starts with: channel, number, time of logging, time of publishing."""


class RecordBody(ReadDataStream):
    """The body of a record: a field that reaches behind it is an error, which the library takes for a shorter one."""

    def __init__(self, body: memoryview) -> None:
        super().__init__(io.BytesIO(body))

    def read(self, length: int) -> bytes:
        """Return so many bytes."""
        data = super().read(length)
        if len(data) != length:
            raise EOFError
        return data


@dataclass(frozen=True, slots=True, eq=False)
class WalkedRecord:
    """One record; or, where ``run`` is given, many messages that follow each other."""

    at: int
    """Offset in the file of the record's first byte; of a run, of the block that it is in."""
    kind: int
    body: memoryview
    """Of a run, the block. It is overwritten when the next record is asked for."""
    run: MessageRun | EvenRun | None = None
    """Places in the block."""


class RecordWalk:
    """The records of a file that is open behind its magic, and of what continues it.

    Parameters
    ----------
    file : io.FileIO
        Unbuffered, behind the magic.
    known : collection of int
        Ids of the channels met so far, which may grow: see :class:`host.recording.bulk.record_runs.RecordRuns`.
    on_problem : callable
        Called with the offset and a sentence for what the format forbids.
    on_bytes : callable
        Called with all bytes up to the checksum in the footer, in order, many records at a time; with those in front of
        the end of the data before that is yielded.
    continuation : bytes
        Records behind the end of the file.
    """

    def __init__(
        self,
        file: io.FileIO,
        known: Collection[int],
        on_problem: Callable[[int, str], object],
        on_bytes: Callable[[memoryview | bytes], object] = lambda _: None,
        continuation: bytes = b"",
    ) -> None:
        self.size = os.fstat(file.fileno()).st_size + len(continuation)
        """Bytes of the file and of what continues it."""
        self.walked_bytes = 0
        """Of these, those in whole blocks walked."""
        self._file = file
        self._known = known
        self._on_problem = on_problem
        self._on_bytes = on_bytes
        self._continuation = io.BytesIO(continuation)

    def records(self, block_bytes: int = READ_BLOCK_BYTES) -> Iterator[WalkedRecord]:
        """Yield the records up to the footer, the end, or the first impossible length."""
        file, on_bytes = self._file, self._on_bytes
        buffer = memoryview(bytearray(block_bytes))
        base, kept = len(MCAP0_MAGIC), 0  # offset of the buffer in the file; bytes at its start of a record cut by it
        on_bytes(MCAP0_MAGIC)
        while True:
            if kept > block_bytes // 2:  # a record that hardly fits, or does not
                buffer = memoryview(bytearray(bytes(buffer[:kept]) + bytes(max(kept, block_bytes))))
            n_read = file.readinto(buffer[kept:]) or self._continuation.readinto(buffer[kept:])
            view = buffer[: kept + n_read]
            offset = passed_on = 0
            runs = RecordRuns(view, self._known)
            while len(view) - offset >= FRAME.size:
                run = runs.at(offset)
                if run is not None:
                    offset = run.end
                    yield WalkedRecord(base, Opcode.MESSAGE, view, run)
                    if n_read and len(view) - offset < HANDFUL_BYTES:
                        break
                    continue
                kind, length = FRAME.unpack_from(view, offset)
                if length > MAX_RECORD_BYTES:
                    problem = "a record has an impossible length: the rest of the file is not read"
                    self._on_problem(base + offset, problem)
                    return
                start, end = offset, offset + FRAME.size + length
                if end > len(view):
                    break
                offset = end
                if length != ENDINGS.get(kind, length):
                    problem = "a record that should end the file has an impossible length and is left out"
                    self._on_problem(base + start, problem)
                    continue
                if kind == Opcode.DATA_END:
                    on_bytes(view[passed_on:start])
                    passed_on = end
                if kind == Opcode.FOOTER:
                    on_bytes(view[passed_on : end - SUMMARY_CRC_BYTES])
                yield WalkedRecord(base + start, kind, view[start + FRAME.size : end])
                if kind == Opcode.FOOTER:
                    self._check_end(view[offset:], base + offset)
                    return
            on_bytes(view[passed_on:offset])
            self.walked_bytes += offset
            base += offset
            kept = len(view) - offset
            buffer[:kept] = bytes(view[offset:])
            if not n_read:
                left = f", {kept} bytes of a last record are left out" if kept else ""
                self._on_problem(base, f"the recording was not closed: it is read up to where it ends{left}")
                return

    def _check_end(self, view: memoryview, at: int) -> None:
        n_magic = len(MCAP0_MAGIC)
        behind = bytes(view) + self._file.read(n_magic) + self._continuation.read(n_magic)
        if behind != MCAP0_MAGIC:
            self._on_problem(at, "the file does not end behind its footer: the rest is not read")
