"""A trial from the bare bytes of our own wire: what ``emulate --link file:`` writes, or a terminal program logged.

Such a file has no times of reception. The device's own clock places the samples; what needs the host's clock, the place
of a restart and the offset of the clocks, is not known, and that is reported.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from firmware_protocol.items import StreamCounters
from firmware_protocol.serial.decoder import StreamDecoder
from host.errors import FileError
from host.links.transport import MAX_CHUNK_BYTES, Chunk
from host.recording.format import RECEIVED
from host.recording.load import RecordedTrial, assemble

MIN_PACKETS = 3
"""So many packets with sound checksums, at the start of a file, are no accident: one in 2^32 is, for random bytes."""
HEAD_BYTES = 65_536
RECORDING_MARKS = (b"MCAP", RECEIVED.encode(), b"ros2msg")
"""A recording whose start is damaged holds the same bytes, with times that must not be thrown away in silence."""
NO_TIMES = (
    "the file holds the bytes of a link without times of arrival: the object's clock alone places the samples, and a "
    "pause while the object restarted is not known"
)


def is_raw_wire(head: bytes) -> bool:
    """Return whether a file holds bytes of our serial wire, by its first bytes, whatever stands before them."""
    head = head[:HEAD_BYTES]
    if any(mark in head for mark in RECORDING_MARKS):
        return False
    return b"\0" in head and _n_packets(head) >= MIN_PACKETS


def _n_packets(data: bytes) -> int:
    decoder = StreamDecoder()
    decoder.feed(data)
    counters: StreamCounters = decoder.counters
    return sum(counters.packets.values())


def load_raw_wire(path: Path, file: BinaryIO) -> RecordedTrial:
    """Read a file of bare bytes.

    Parameters
    ----------
    path : Path
        The file.
    file : binary file
        The same, open at its start.

    Raises
    ------
    FileError
        No samples are in it.
    """
    trial = assemble(_chunks(file), path.name)
    if not len(trial.series):
        raise FileError(f"{path} holds no samples", "log the link for as long as the trial takes")
    return replace(trial, damage=(NO_TIMES,))


def _chunks(file: BinaryIO) -> Iterator[Chunk]:
    while data := file.read(MAX_CHUNK_BYTES):
        yield Chunk(data, 0)
