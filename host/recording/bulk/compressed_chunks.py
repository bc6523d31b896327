"""Compressed chunks of a recording, as other MCAP tools write them: unpacked in a process of their own.

The decompressors reserve memory by what a frame claims. Here that is the memory of a process with limits, and a chunk
that asks for too much is a damaged chunk.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from analysis.confined.call import StoppedError, pieces_of
from analysis.confined.limits import Limits
from host.recording.bulk.walk import FRAME, MAX_RECORD_BYTES, RecordBody
from host.text import plain

_SOUND, _DAMAGED = b"\0", b"\1"
"""First byte of a piece: its content follows, or why there is none."""


class CompressedChunks:
    """The compressed chunks of a file, in order; the process starts with the first."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._pieces: Generator[bytearray, None, object] | None = None

    def next_content(self) -> bytes:
        """Return the content of the next one.

        Raises
        ------
        ValueError
            It is damaged, or the limits of the process are reached.
        """
        if self._pieces is None:
            limits = Limits.of_file(self._path.stat().st_size)
            self._pieces = pieces_of(f"{__name__}:contents", str(self._path), limits=limits)
        try:
            piece = next(self._pieces, None)
        except StoppedError as error:
            raise ValueError(plain(error)) from error
        if piece is None:
            raise ValueError("nothing more was unpacked")
        if piece[:1] != _SOUND:
            raise ValueError(plain(piece[1:].decode("utf-8", "replace")))
        return bytes(memoryview(piece)[1:])

    def close(self) -> None:
        """End the process."""
        if self._pieces is not None:
            self._pieces.close()


def unpacked(
    body: memoryview, on_problem: Callable[[str], object], compressed: CompressedChunks
) -> tuple[Chunk, memoryview] | None:
    """Return a chunk and what is in it, whose checksum is checked; None where that cannot be had, which is reported.

    Every chunk of a file has to be asked for, in order.
    """
    try:
        chunk = _chunk_of(body)
        return chunk, memoryview(compressed.next_content() if chunk.compression else _content_of(chunk))
    except Exception as error:  # noqa: BLE001 - damaged bytes make the library raise anything
        why = str(error) if isinstance(error, ValueError) else type(error).__name__
        on_problem(f"a chunk is damaged ({plain(why)}) and left out")
        return None


def chunk_records(
    body: memoryview, on_problem: Callable[[str], object], compressed: CompressedChunks
) -> Iterator[tuple[int, memoryview]]:
    """Yield kind and body of the records in a chunk; as :func:`unpacked`."""
    chunk = unpacked(body, on_problem, compressed)
    if chunk is None:
        return
    view = chunk[1]
    offset = 0
    while len(view) - offset >= FRAME.size:
        kind, length = FRAME.unpack_from(view, offset)
        end = offset + FRAME.size + length
        if end > len(view):
            on_problem("a chunk ends within a record")
            return
        yield kind, view[offset + FRAME.size : end]
        offset = end


def _chunk_of(body: memoryview | bytes) -> Chunk:
    """Return a chunk record; raises whatever damaged bytes make the library raise, ValueError where it is too large."""
    chunk: Chunk = Chunk.read(RecordBody(memoryview(body)))
    if chunk.uncompressed_size > MAX_RECORD_BYTES:
        raise ValueError("too large")
    return chunk


def _content_of(chunk: Chunk) -> bytes:
    """Return what is in a chunk, its CRC checked; raises whatever the decompressors raise."""
    stream, _ = get_chunk_data_stream(chunk, validate_crc=True)
    content: bytes = stream.read(chunk.uncompressed_size)
    return content


def contents(path: str) -> Iterator[bytes]:
    """Unpack each compressed chunk of a file; called in its process.

    Yields
    ------
    bytes
        The content, or why it cannot be read.
    """
    with Path(path).open("rb") as file:
        file.seek(len(MCAP0_MAGIC))
        while len(head := file.read(FRAME.size)) == FRAME.size:
            kind, length = FRAME.unpack(head)
            if kind == Opcode.FOOTER or length > MAX_RECORD_BYTES:
                return
            if kind != Opcode.CHUNK:
                file.seek(length, os.SEEK_CUR)
                continue
            compressed = False  # whoever asks does not ask for others, nor for one whose description is damaged
            try:
                chunk = _chunk_of(file.read(length))
                compressed = bool(chunk.compression)
                if compressed:
                    yield _SOUND + _content_of(chunk)
            except Exception as error:  # noqa: BLE001 - decompressors raise their own kinds
                if compressed:
                    yield _DAMAGED + type(error).__name__.encode()
