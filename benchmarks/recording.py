"""Recordings: size, write and read rates, memory, time to a score."""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.large_recordings import BYTES_A_SAMPLE, PER_READ, write_large
from benchmarks.measurement import COST, GAIN, Topic, cpu_s, figure
from benchmarks.sample_streams import FRAME_BYTES, frame_rows, turning
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Status
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk
from host.recording.reader import RecordingReader
from host.recording.writer import RecordingWriter

RATE_HZ = 1000
PERIOD_US = 1_000_000 // RATE_HZ
GOAL_RATE = 2.0
LARGEST_BYTES = 10**10
READ_TIMES_MEMORY = 4.0
"""Scoring may need so many times the size of the recording, and no more."""
_SCORE = """
import json, sys, time
from benchmarks.recording import peak_kib as peak
from pathlib import Path
from host.recording.load import load_trial
from host.results.result import ScoreOptions, score_trial
from analysis.scoring.result import result_text
from msgspec.structs import replace
import analysis.scoring.trial, scipy.fft, scipy.ndimage  # start-up has a topic of its own
base = peak()
start, wall = time.process_time(), time.perf_counter()
trial = load_trial(Path(sys.argv[1]))
read = time.process_time() - start
score = score_trial(trial, ScoreOptions())
total = time.process_time() - start
took = time.perf_counter() - wall
highest = peak()
if len(sys.argv) > 2:
    text = result_text(replace(score, clock=trial.clock))
whole = time.process_time() - start
print(json.dumps({"valid": score.valid, "n": len(trial.series), "read": read, "total": total,
    "wall": took, "whole": whole, "memory": (highest - base) * 1024, "endpoints": len(score.endpoints)}))
"""
_STREAM = """
import json, sys, time
from benchmarks.recording import peak_kib as peak
from pathlib import Path
from firmware_protocol.packets import OrientationBatch
from host.stream.decoding import Link
from host.recording.bulk.raw_span import RawSpan
from host.recording.reader import RecordingReader
base = peak()
start = time.process_time()
link, n = Link(), 0
for part in RecordingReader(Path(sys.argv[1])).spans():
    items = link.feed_span(part.data).items() if isinstance(part, RawSpan) else link.feed(part)
    n += sum(len(item) for item in items if isinstance(item, OrientationBatch))
assert link.counters.crc_errors == link.counters.malformed == 0
highest = peak()
print(json.dumps({"n": n, "cpu": time.process_time() - start, "memory": (highest - base) * 1024}))
"""


def peak_kib() -> int:
    """Largest memory this process has had, KiB; what it had before its program was loaded does not count."""
    try:
        status = Path("/proc/self/status").read_text()
        return int(status.partition("VmHWM:")[2].split()[0])
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def uneven_reads(n: int) -> Iterator[tuple[Chunk, np.ndarray]]:
    """Chunks of one to four samples, cut anywhere, a STATUS among them every second: as a busy host reads."""
    rng = np.random.default_rng(3)
    status = encode_frame(encode_packet(Status(5_000_000, temperature_c=21.5)))
    pending = b""
    for number, (chunk, quats) in enumerate(chunks(n, 2)):
        data = pending + chunk.data + (status if number % 500 == 499 else b"")
        cut = len(data) - int(rng.integers(0, 30)) if (number + 1) * 2 < n else len(data)
        pending = data[cut:]
        yield Chunk(data[:cut], chunk.host_time_ns + int(rng.integers(0, 900_000))), quats


def chunks(n: int, per_chunk: int, block: int = 1 << 17) -> Iterator[tuple[Chunk, np.ndarray]]:
    """Chunks of a link that delivers so many samples a read, with what they hold."""
    quats = turning(block, RATE_HZ)
    for first in range(0, n, block):
        count = min(block, n - first)
        data = frame_rows(quats[:count], first, PERIOD_US).tobytes()
        for at in range(0, count, per_chunk):
            end = min(at + per_chunk, count)
            host_ns = 10**9 + (first + end) * PERIOD_US * 1000
            yield Chunk(data[at * FRAME_BYTES : end * FRAME_BYTES], host_ns), quats[at:end]


def write(path: Path, n: int, per_chunk: int | None, decoded: bool = True) -> tuple[float, int]:
    """Write a recording as a capture does; CPU seconds of the writer and bytes."""
    writer = RecordingWriter(path, "pty:/dev/pts/9", 1_700_000_000 * 10**9, 10**9)
    used = 0.0
    batch: list[tuple[Chunk, np.ndarray]] = []

    def take() -> None:
        for chunk, quats in batch:
            writer.add_received(chunk)
            if decoded:
                stamps = chunk.host_time_ns - np.arange(len(quats))[::-1] * PERIOD_US * 1000
                writer.add_orientations(stamps, quats, chunk.host_time_ns)
            writer.flush_if_due(chunk.host_time_ns)

    for item in uneven_reads(n) if per_chunk is None else chunks(n, per_chunk):
        batch.append(item)
        if len(batch) == 1000:
            used += cpu_s(take)
            batch.clear()
    used += cpu_s(take)
    used += cpu_s(writer.close)
    return used, path.stat().st_size


def _child(script: str, path: Path, *more: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", script, str(path), *more], capture_output=True, text=True, timeout=1800
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout.splitlines()[-1]))


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic(f"Recording: one object at {RATE_HZ} Hz")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        n = 600_000  # fewer, and the first calls of a process are much of the time
        labels = {1: "1 sample a read", 10: "10 samples a read", 50: "50 samples a read", None: "uneven reads"}
        for per_chunk, label in labels.items():
            if quick and per_chunk != 10:
                continue
            path = folder / f"{per_chunk}.mcap"
            used, size = write(path, n, per_chunk)
            topic.rows.append(figure(f"{label}: size", [size / n], "bytes/sample", f"{FRAME_BYTES} of them the frame"))
            topic.rows.append(figure(f"{label}: write", [n / used / 1e6], "M samples/s"))
            results = [_child(_SCORE, path) for _ in range(3 if quick else 5)]
            assert all(result["valid"] and result["n"] == n for result in results), results
            rates = [n / result["total"] / 1e6 for result in results]
            topic.rows.append(
                figure(f"{label}: file to scored cycles", rates, "M samples/s", goal=GOAL_RATE, sense=GAIN)
            )
            topic.rows.append(
                figure(f"{label}: file to samples", [n / r["read"] / 1e6 for r in results], "M samples/s")
            )
            whole = _child(_SCORE, path, "json")["whole"]
            note = "the clock's offline pass and the result file with it"
            topic.rows.append(figure(f"{label}: file to result file", [n / whole / 1e6], "M samples/s", note))
            memory = [result["memory"] / size for result in results]
            topic.rows.append(
                figure(f"{label}: memory to score / size", memory, "×", goal=READ_TIMES_MEMORY, sense=COST)
            )
        if not quick:
            raw = folder / "raw.mcap"
            _, size = write(raw, n, 10, decoded=False)
            topic.rows.append(figure("10 samples a read, raw channel only: size", [size / n], "bytes/sample"))
            _large(topic, folder)
    return topic


def _large(topic: Topic, folder: Path) -> None:
    """One gigabyte scored, and ten streamed in the memory of one."""
    path = folder / "large.mcap"
    n = round(1e9 / BYTES_A_SAMPLE / PER_READ) * PER_READ
    size = write_large(path, n)
    label = f"{size / 1e9:.1f} GB"
    start = time.perf_counter()
    first = next(RecordingReader(path).chunks())
    assert first.data
    topic.rows.append(figure(f"{label}: first chunk delivered", [time.perf_counter() - start], "s"))
    result = _child(_SCORE, path)
    assert result["valid"]
    assert result["n"] == n
    note = f"{n / 1e6:.1f} M samples, on the wall"
    topic.rows.append(figure(f"{label}: time to the first result, the score", [result["wall"]], "s", note))
    memory = [result["memory"] / size]
    topic.rows.append(figure(f"{label}: memory to score / size", memory, "×", "", READ_TIMES_MEMORY, COST))
    _streamed(topic, label, path, n)
    path.unlink()
    if shutil.disk_usage(folder).free < 2 * LARGEST_BYTES:
        topic.left_out.append("10 GB: too little room on the disk")
        return
    n = round(LARGEST_BYTES / BYTES_A_SAMPLE / PER_READ) * PER_READ
    label = f"{write_large(path, n) / 1e9:.1f} GB"
    _streamed(topic, label, path, n)
    path.unlink()


def _streamed(topic: Topic, label: str, path: Path, n: int) -> None:
    run = _child(_STREAM, path)
    assert run["n"] == n
    topic.rows.append(figure(f"{label}: file to samples, streamed", [n / run["cpu"] / 1e6], "M samples/s"))
    topic.rows.append(figure(f"{label}: memory to stream", [run["memory"] / 2**20], "MiB", "", 64.0, COST))
