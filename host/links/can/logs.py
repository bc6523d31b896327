"""Logs of other CAN tools as chunks: candump ``.log``, Vector ASC and BLF, PCAN-View's TRC, python-can's CSV.

Read through python-can, text logs line by line (:mod:`host.links.can.log_lines`). A BLF is compressed, and mutated ones
have been seen to loop for ever or to need 800 MB, so all are read in a process of their own with limits
(:mod:`analysis.confined`).
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

import can

from analysis.confined.call import StoppedError, pieces_of
from analysis.confined.limits import Limits
from firmware_protocol.can.frames import CanFrame, frame_array, iter_frames, pack_frames
from host.errors import FileError, unreadable
from host.links.can.bus import received_frame
from host.links.can.log_kind import HEAD_BYTES, can_log_kind
from host.links.can.log_lines import MAX_TIME_S, LinesLeftOut, text_messages
from host.links.transport import FrameChunk
from host.text import plain

FRAMES_A_CHUNK = 1000
COALESCED_NS = 250_000_000
"""Frames further apart are in different chunks."""
_MAX_NAME = 255
_READER = f"{__name__}:frame_batches"


@dataclass(frozen=True, slots=True)
class CanLog:
    """The content of a log."""

    kind: str
    """``candump``, ``ASC``, ``CSV``, ``TRC``, ``BLF`` or ``candump on screen``."""
    channels: dict[str, tuple[FrameChunk, ...]]
    """The frames of each channel, in the log's order; the time of reception is the log's own, ns."""
    damage: tuple[str, ...]
    """What could not be read, a sentence each."""

    @property
    def chunks(self) -> tuple[FrameChunk, ...]:
        """The frames of all channels, one channel behind the other."""
        return tuple(chunk for chunks in self.channels.values() for chunk in chunks)


def read_can_log(path: Path, file: IO[bytes] | None = None) -> CanLog:
    """Read a log.

    Parameters
    ----------
    path : Path
        The log.
    file : binary file, optional
        The log where it is open already, at its start; closed at the end. It is opened again by its own process.

    Raises
    ------
    FileError
        It cannot be opened, is not a CAN log, or holds no frame.
    """
    damage: list[str] = []
    try:
        with file or path.open("rb") as log:
            kind = can_log_kind(log.read(HEAD_BYTES))
            if kind is None:
                raise FileError(
                    f"{path} is not a CAN log",
                    "give a candump log, an ASC, a BLF, a TRC, or a CSV written by python-can",
                )
        channels: dict[str, list[FrameChunk]] = {}
        for channel, chunk in _chunks_apart(path, kind, damage):
            channels.setdefault(channel, []).append(chunk)
    except OSError as error:
        raise unreadable(path, error) from error
    if not channels:
        raise FileError(
            f"{path} holds no CAN frames", damage[0] if damage else "give a log of a bus with an object on it"
        )
    return CanLog(kind, {channel: tuple(chunks) for channel, chunks in channels.items()}, tuple(damage))


def frame_batches(path: str, kind: str) -> Generator[bytes, None, tuple[list[str], str]]:
    """Read the frames of a log; called in its process.

    Returns
    -------
    What could not be read, a sentence each; and why the whole log cannot be, empty where it can.

    Yields
    ------
    bytes
        Length of a channel's name, the name, and frames of it as a batch.
    """
    damage: list[str] = []
    left_out = LinesLeftOut(kind)
    try:
        if kind == "BLF":
            yield from _batches(_blf(Path(path), damage), damage)
        else:
            with Path(path).open(encoding="utf-8", errors="replace") as file:
                yield from _batches(text_messages(kind, file, left_out), damage)
            damage += left_out.sentences()
    except FileError as error:
        return damage, str(error)
    return damage, ""


def _batches(messages: Iterable[can.Message], damage: list[str]) -> Iterator[bytes]:
    """Yield the frames of each channel in batches as short as a link delivers them.

    A chunk has one time of reception, so a silence of the log has to be one between chunks.
    """
    waiting: dict[str, list[CanFrame]] = {}
    for message in messages:
        if not abs(message.timestamp) < MAX_TIME_S:
            damage.append(f"a frame has the time {message.timestamp:g} s: it and what follows are left out")
            break
        frame = received_frame(message, round(message.timestamp * 1e9))
        channel = "" if message.channel is None else str(message.channel)
        batch = waiting.setdefault(channel, [])
        if batch and not (
            len(batch) < FRAMES_A_CHUNK and 0 <= frame.host_time_ns - batch[0].host_time_ns <= COALESCED_NS
        ):
            yield _packed(channel, batch)
            batch.clear()
        batch.append(frame)
    for channel, batch in waiting.items():
        yield _packed(channel, batch)


def _packed(channel: str, batch: list[CanFrame]) -> bytes:
    name = channel.encode("utf-8", "replace")[:_MAX_NAME]
    return bytes([len(name)]) + name + pack_frames(batch)


def _blf(path: Path, damage: list[str]) -> Iterator[can.Message]:
    size = path.stat().st_size
    try:
        with can.BLFReader(path) as reader:
            yield from reader
            whole = reader.file_size
    except MemoryError:
        raise  # the limit of this process
    except Exception as error:  # noqa: BLE001 - a damaged file makes it raise anything
        damage.append(f"the BLF is damaged ({plain(f'{type(error).__name__}: {error}', 100)})")
        return
    if size < whole:  # to the library, the end of the file is the end of the log
        damage.append(f"the BLF is damaged (it is cut: {size} of {whole} bytes are there)")


def _chunks_apart(path: Path, kind: str, damage: list[str]) -> Iterator[tuple[str, FrameChunk]]:
    """Yield the frames that a process of its own reads, with the name of their channel.

    What it returns before it reaches a limit is kept. Raises FileError where the log cannot be read at all.
    """
    limits = Limits.of_file(path.stat().st_size)
    try:
        end = yield from _unpacked(pieces_of(_READER, str(path), kind, limits=limits))
    except StoppedError as error:
        damage.append(f"the {kind} log could not be read to its end: {plain(str(error), 200)}")
        return
    found, refusal = cast(tuple[list[str], str], end)
    damage += found
    if refusal:
        raise FileError(refusal)


def _unpacked(pieces: Generator[bytearray, None, object]) -> Generator[tuple[str, FrameChunk], None, object]:
    while True:
        try:
            piece = bytes(next(pieces))
        except StopIteration as end:
            return end.value
        start = 1 + piece[0]
        data = piece[start:]
        *_, last = iter_frames(frame_array(data)[-1:])
        yield piece[1:start].decode(errors="replace"), FrameChunk(data, last.host_time_ns)
