"""What is thrown hostile bytes: each target takes bytes, and may raise nothing.

A target knows which exceptions are answers (one sentence for a person), checks what must hold whatever came in, and
lets everything else through: that is a find.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from analysis.confined.values import from_pieces, to_pieces
from analysis.formats import SourceFile, read_series
from analysis.formats.parquet import read_parquet
from analysis.formats.ros_bag import read_ros_bag
from analysis.formats.rows.streams import StreamChoice
from analysis.formats.time_stamps import RawSamples, to_series
from analysis.scoring.choice import load_endpoints
from analysis.series import AnalysisError
from emulator import ScenarioError
from emulator.scenario import load_scenario
from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from firmware_protocol.packets import OrientationBatch
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import MAX_PIECE_BYTES
from host.cards.definitions import load_cards
from host.errors import FileError, HostError
from host.links.can.log_kind import HEAD_BYTES, can_log_kind
from host.links.can.logs import frame_batches
from host.links.transport import FrameChunk
from host.losses.ledger import LossReport
from host.recording.load import assemble, load_trial
from host.recording.reader import RecordingReader
from host.recording.recovery import recover
from host.stream.samples import SampleAssembler
from host.trial.operator import edits_of
from tests.fuzz.commands import commands

_FOLDER = Path(tempfile.mkdtemp(prefix="rotdrift-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
_MAX_CHUNK = 4096


def one_sentence(error: Exception) -> None:
    """Demand of an answer that it is short, printable text on one line: no escapes reach the terminal."""
    text = str(error)
    assert text.isprintable(), text
    assert len(text) < 1000, text


def check_ledger(report: LossReport) -> None:
    """Demand that every sample is accounted for."""
    kinds = (report.received, report.lost, report.rejected, report.dropped, report.damaged_in_file)
    assert report.produced == sum(kinds)
    parts = (*kinds, report.duplicates, report.reordered)
    assert min(parts) >= 0, report


def stream(data: bytes) -> None:
    """Bytes of a serial link, cut as their first byte says, down to samples and the account of them."""
    decoder, assembler = StreamDecoder(), SampleAssembler()
    cut = 1 + data[0] if data else 1
    whole = StreamDecoder()
    n_whole = sum(len(item) for item in whole.feed(data) if isinstance(item, OrientationBatch))
    n, damage = 0, list[int]()
    for number, at in enumerate(range(0, len(data), cut)):
        items = decoder.feed(data[at : at + cut])
        n += sum(len(item) for item in items if isinstance(item, OrientationBatch))
        hits = decoder.take_damage()
        damage += hits
        assembler.damaged(hits)
        for block in assembler.feed(items, number * 10_000_000):
            assert np.isfinite(block.time_s).all()
            assert np.abs(np.linalg.norm(block.quats_wxyz, axis=1) - 1).max() < 1e-9
    assert n == n_whole
    assert damage == whole.take_damage()
    counters = decoder.counters
    assert counters == whole.counters
    assert counters.bytes == len(data)
    assert counters.bytes == (
        counters.delimiters + counters.frame_bytes + counters.skipped_bytes + counters.pending_bytes
    )
    assert counters.pending_bytes <= MAX_PIECE_BYTES
    check_ledger(assembler.losses())


def can(data: bytes) -> None:
    """Bytes as a frame batch of a recording, and as frames: id and length from the bytes, any content."""
    CanStreamDecoder().feed(data)
    frames = []
    at = 0
    while at + 3 <= len(data) and len(frames) < 300:
        head = int.from_bytes(data[at : at + 2], "little")
        length = data[at + 2] % 9
        flags = FrameFlag(0) if head < 0xF000 else FrameFlag(data[at + 2] & 0x3F & ~FrameFlag.FD)
        frames.append(CanFrame(head & 0x7FF, data[at + 3 : at + 3 + length], flags, host_time_ns=1000 * at))
        at += 3 + length
    if not frames:
        return
    decoder, assembler = CanStreamDecoder(), SampleAssembler()
    for start in range(0, len(frames), 7):
        items = decoder.feed(pack_frames(frames[start : start + 7]))
        assembler.damaged(decoder.take_damage())
        assembler.feed(items, 10_000_000 * start)
    assembler.feed(decoder.flush(), 10_000_000 * len(frames))
    check_ledger(assembler.losses())


def recording(data: bytes) -> None:
    """A file that should be a recording: read, loaded, recovered."""
    path, target = _FOLDER / f"{os.getpid()}.mcap", _FOLDER / f"{os.getpid()}-clean.mcap"
    path.write_bytes(data)
    try:
        reader = RecordingReader(path)
        known = list(reader.chunks())
        edits_of(load_trial(path).actions)
    except (HostError, AnalysisError) as error:
        one_sentence(error)
        known = []
    target.unlink(missing_ok=True)
    try:
        found = recover(path, target)
    except FileError as error:
        one_sentence(error)
    else:
        clean = RecordingReader(target)
        recovered = list(clean.chunks())
        assert all("missing" in sentence for sentence in clean.damage), clean.damage  # as stated in the recovered file
        assert len(recovered) == found.chunks >= len(known) - 1


def _answered(load: Callable[[Path], object], suffix: str, *errors: type[Exception]) -> Callable[[bytes], None]:
    def run(data: bytes) -> None:
        path = _FOLDER / f"{os.getpid()}{suffix}"
        path.write_bytes(data)
        try:
            load(path)
        except errors as error:
            one_sentence(error)

    return run


def _load_scenario(path: Path) -> object:
    return load_scenario(str(path))


def _read_bag_here(path: Path) -> object:
    """Read what a process of its own reads, without the process: a limit of memory is an answer there."""
    with SourceFile(path) as source:
        return to_series(read_ros_bag(source, None, StreamChoice()), source.label)


def parquet(data: bytes) -> None:
    """A parquet file; whatever pyarrow raises ends its process and becomes a sentence (analysis.confined.process)."""
    path = _FOLDER / f"{os.getpid()}.parquet"
    path.write_bytes(data)
    with SourceFile(path) as source, suppress(Exception):
        pieces = [bytearray(piece) for piece in to_pieces(read_parquet(source, None, StreamChoice()))]
        assert len(from_pieces(pieces, RawSamples).quats_wxyz)


def can_log(data: bytes) -> None:
    """A text log, in its process and behind it; BLF has none here, as python-can loops for ever on some."""
    path = _FOLDER / f"{os.getpid()}.log"
    path.write_bytes(data)
    kind = can_log_kind(data[:HEAD_BYTES])
    if kind in {None, "BLF"}:
        return
    batches: list[bytes] = []
    with suppress(Exception):
        batches.extend(frame_batches(str(path), kind))
    assemble([FrameChunk(batch[1 + batch[0] :], 1) for batch in batches], "log")


cards = _answered(load_cards, ".toml", HostError)
scenario = _answered(_load_scenario, ".toml", ScenarioError)
series = _answered(read_series, ".csv", AnalysisError)
bag = _answered(_read_bag_here, ".bag", AnalysisError, MemoryError)
mcap = _answered(_read_bag_here, ".mcap", AnalysisError, MemoryError)
endpoints = _answered(load_endpoints, ".csv", AnalysisError)

TARGETS: dict[str, Callable[[bytes], None]] = {
    "stream": stream,
    "can": can,
    "recording": recording,
    "cards": cards,
    "scenario": scenario,
    "series": series,
    "bag": bag,
    "mcap": mcap,
    "parquet": parquet,
    "can_log": can_log,
    "endpoints": endpoints,
    "commands": commands,
}
"""Name -> what takes the bytes."""
