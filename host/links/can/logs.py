"""Logs of other CAN tools as chunks: candump ``.log``, Vector ASC and BLF, PCAN-View's TRC, python-can's CSV.

Read through python-can, text logs line by line (:mod:`host.links.can.log_lines`). A BLF is compressed, and mutated ones
have been seen to loop for ever or to need 800 MB, so it is read in a process of its own with limits
(:mod:`host.links.can.blf_process`).
"""

from __future__ import annotations

import io
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import can

from firmware_protocol.can.frames import CanFrame, frame_array, iter_frames, pack_frames
from host.errors import FileError, unreadable
from host.links.can.bus import received_frame
from host.links.can.log_kind import HEAD_BYTES, can_log_kind
from host.links.can.log_lines import LinesLeftOut, text_messages
from host.links.transport import FrameChunk
from host.text import plain

FRAMES_A_CHUNK = 1000
BLF_SECONDS_PER_MB = 20.0
"""A hundred times what a sound file needs."""
BLF_LEAST_SECONDS = 20.0

COALESCED_NS = 250_000_000
"""Frames further apart are in different chunks."""
_LENGTH = struct.Struct("<IB")  # of a batch, and of its channel's name
_MAX_NAME = 255


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
        The log where it is open already, at its start; closed at the end. A BLF is opened again, by its own process.

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
            if kind == "BLF":
                found = _blf_chunks(path, damage)
            else:
                log.seek(0)
                text = io.TextIOWrapper(log, encoding="utf-8", errors="replace")
                left_out = LinesLeftOut(kind)
                found = _chunks(text_messages(kind, text, left_out))
            for channel, chunk in found:
                channels.setdefault(channel, []).append(chunk)
            if kind != "BLF":
                damage += left_out.sentences()
    except OSError as error:
        raise unreadable(path, error) from error
    if not channels:
        raise FileError(
            f"{path} holds no CAN frames", damage[0] if damage else "give a log of a bus with an object on it"
        )
    return CanLog(kind, {channel: tuple(chunks) for channel, chunks in channels.items()}, tuple(damage))


def _chunks(messages: Iterable[can.Message]) -> Iterator[tuple[str, FrameChunk]]:
    """Yield the frames of each channel in chunks as short as a link delivers them, with the channel's name.

    A chunk has one time of reception, so a silence of the log has to be one between chunks.
    """
    waiting: dict[str, list[CanFrame]] = {}
    for message in messages:
        frame = received_frame(message, round(message.timestamp * 1e9))
        channel = "" if message.channel is None else str(message.channel)
        batch = waiting.setdefault(channel, [])
        if batch and not (
            len(batch) < FRAMES_A_CHUNK and 0 <= frame.host_time_ns - batch[0].host_time_ns <= COALESCED_NS
        ):
            yield channel, FrameChunk(pack_frames(batch), batch[-1].host_time_ns)
            batch.clear()
        batch.append(frame)
    for channel, batch in waiting.items():
        yield channel, FrameChunk(pack_frames(batch), batch[-1].host_time_ns)


def write_chunks(messages: Iterable[can.Message], file: IO[bytes]) -> None:
    """Write messages as frame batches, each behind its length and channel: what a process returns to its parent."""
    for channel, chunk in _chunks(messages):
        name = channel.encode()[:_MAX_NAME]
        file.write(_LENGTH.pack(len(chunk.data), len(name)))
        file.write(name)
        file.write(chunk.data)


def _blf_chunks(path: Path, damage: list[str]) -> Iterator[tuple[str, FrameChunk]]:
    limit_s = max(BLF_LEAST_SECONDS, BLF_SECONDS_PER_MB * path.stat().st_size / 1e6)
    command = [sys.executable, "-P", "-m", "host.links.can.blf_process", str(path)]
    with tempfile.TemporaryFile() as output:
        try:
            done = subprocess.run(  # noqa: S603 - our own module
                command, stdout=output, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, timeout=limit_s, check=False
            )
            if done.returncode:
                words = done.stderr.decode(errors="replace").strip().splitlines()
                damage.append(f"the BLF is damaged ({plain(words[-1], 100) if words else 'its reader was stopped'})")
        except subprocess.TimeoutExpired:
            damage.append(f"the BLF is damaged: reading it did not end within {limit_s:.0f} s")
        output.seek(0)
        while len(head := output.read(_LENGTH.size)) == _LENGTH.size:
            n_bytes, n_name = _LENGTH.unpack(head)
            name, data = output.read(n_name), output.read(n_bytes)
            if len(data) < n_bytes:
                return  # the process was stopped while it wrote
            *_, last = iter_frames(frame_array(data)[-1:])
            yield name.decode(errors="replace"), FrameChunk(data, last.host_time_ns)
