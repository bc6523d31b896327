"""Logs of other CAN tools as chunks: candump ``.log``, Vector ASC and BLF, python-can's CSV.

Read through python-can. It stops at the first line it cannot read, so candump lines are checked before they reach it,
and what stops the others is reported. A BLF is compressed, and mutated ones have been seen to loop for ever or to need
800 MB, so it is read in a process of its own with limits (:mod:`host.links.can.blf_process`).
"""

from __future__ import annotations

import io
import itertools
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TextIO

import can

from firmware_protocol.can.frames import frame_array, iter_frames, pack_frames
from host.errors import FileError, unreadable
from host.links.can.bus import received_frame
from host.links.can.log_kind import CANDUMP_LINE, HEAD_BYTES, can_log_kind
from host.links.transport import FrameChunk
from host.text import plain

FRAMES_A_CHUNK = 1000
BLF_SECONDS_PER_MB = 20.0
"""A hundred times what a sound file needs."""
BLF_LEAST_SECONDS = 20.0

_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class CanLog:
    """The content of a log."""

    kind: str
    """``candump``, ``ASC``, ``CSV`` or ``BLF``."""
    chunks: tuple[FrameChunk, ...]
    """The frames; the time of reception is the log's own, ns."""
    damage: tuple[str, ...]
    """What could not be read, a sentence each."""


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
                    f"{path} is not a CAN log", "give a candump log, an ASC, a BLF, or a CSV written by python-can"
                )
            if kind == "BLF":
                chunks = tuple(_blf_chunks(path, damage))
            else:
                log.seek(0)
                text = io.TextIOWrapper(log, encoding="utf-8", errors="replace", newline="")
                chunks = tuple(_chunks(_messages(kind, text, damage)))
    except OSError as error:
        raise unreadable(path, error) from error
    if not chunks:
        raise FileError(
            f"{path} holds no CAN frames", damage[0] if damage else "give a log of a bus with an object on it"
        )
    return CanLog(kind, chunks, tuple(damage))


def _messages(kind: str, file: TextIO, damage: list[str]) -> Iterator[can.Message]:
    if kind == "candump":
        yield from _candump(file, damage)
        return
    reader = can.ASCReader(file) if kind == "ASC" else can.CSVReader(file)
    count = 0
    try:
        for message in reader:
            count += 1
            yield message
    except Exception as error:  # noqa: BLE001 - the readers raise whatever a bad line happens to hit
        reason = f"{type(error).__name__}: {plain(str(error), 80)}"
        damage.append(f"what follows frame {count} cannot be read ({reason}) and is left out")


def _candump(file: TextIO, damage: list[str]) -> Iterator[can.Message]:
    bad = 0

    def good_lines() -> Iterator[str]:
        nonlocal bad
        for line in file:
            if CANDUMP_LINE.match(line):
                yield line.rstrip("\n")
            else:
                bad += bool(line.strip())

    lines = good_lines()
    while batch := list(itertools.islice(lines, FRAMES_A_CHUNK)):
        count = 0
        try:
            for message in can.CanutilsLogReader(io.StringIO("\n".join(batch))):
                count += 1
                yield message
        except Exception:  # noqa: BLE001
            bad += len(batch) - count
    if bad:
        damage.append(f"{bad} lines are no candump lines and are left out")


def _chunks(messages: Iterable[can.Message]) -> Iterator[FrameChunk]:
    frames = (received_frame(message, round(message.timestamp * 1e9)) for message in messages)
    while batch := list(itertools.islice(frames, FRAMES_A_CHUNK)):
        yield FrameChunk(pack_frames(batch), batch[-1].host_time_ns)


def write_chunks(messages: Iterable[can.Message], file: IO[bytes]) -> None:
    """Write messages as frame batches, each behind its length: what a reading process returns to its parent."""
    for chunk in _chunks(messages):
        file.write(_LENGTH.pack(len(chunk.data)))
        file.write(chunk.data)


def _blf_chunks(path: Path, damage: list[str]) -> Iterator[FrameChunk]:
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
            data = output.read(_LENGTH.unpack(head)[0])
            if len(data) < _LENGTH.unpack(head)[0]:
                return  # the process was stopped while it wrote
            *_, last = iter_frames(frame_array(data)[-1:])
            yield FrameChunk(data, last.host_time_ns)
