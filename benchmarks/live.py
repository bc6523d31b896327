"""Live: a pty at 1 kHz against a minimal C reader in the same run; a whole capture; the highest rate of a core."""

from __future__ import annotations

import fcntl
import os
import resource
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
import tty
from pathlib import Path
from statistics import median

from benchmarks.growth import stream_chunks
from benchmarks.measurement import COST, GAIN, Row, Topic, cpu_s, figure
from benchmarks.native import NoCompilerError, build
from host.links.transport import Chunk
from host.recording.writer import RecordingWriter
from host.trial.live import Trial

RATE_HZ = 1000
OBJECTS = 8
GOAL_HZ = 20_000
_READER = """
import json, resource, sys, time
from firmware_protocol.packets import OrientationBatch
from firmware_protocol.serial.decoder import StreamDecoder
from host.links import open_transport
n = int(sys.argv[2])
transport = open_transport("serial:" + sys.argv[1])
decoder, latency = StreamDecoder(), []
print("ready", flush=True)
before = resource.getrusage(resource.RUSAGE_SELF)
while len(latency) < n:
    chunk = transport.read(5.0)
    if chunk is None:
        break
    for item in decoder.feed(chunk.data):
        if isinstance(item, OrientationBatch):
            now = time.monotonic_ns() // 1000 & 0xFFFFFFFF
            latency += [(now - sent) & 0xFFFFFFFF for sent in item.device_time_us.tolist()]
after = resource.getrusage(resource.RUSAGE_SELF)
cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
latency.sort()
print(len(latency), latency[len(latency) // 2], latency[len(latency) * 99 // 100], cpu)
"""


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic(f"Live: one object at {RATE_HZ} Hz on a pty")
    try:
        program = build("native_live.c", shared=False)
    except NoCompilerError as error:
        topic.left_out.append(f"live on a pty: {error}")
    else:
        _latency(topic, program, quick)
        if not quick:
            _capture(topic, program)
    _highest_rate(topic, quick)
    return topic


def open_pty() -> tuple[int, int, str]:
    """Open a raw pty: its two ends and its name."""
    master, slave = os.openpty()
    tty.setraw(slave)
    return master, slave, os.ttyname(slave)


def _run_reader(program: Path, command: list[str], n: int) -> list[float]:
    """Samples, latency p50 and p99 in us, CPU s of one reader."""
    master, slave, path = open_pty()
    reader = subprocess.Popen([*command, path, str(n)], stdout=subprocess.PIPE, text=True)
    try:
        assert reader.stdout is not None
        assert reader.stdout.readline().strip() == "ready"
        arguments = [str(program), "send", str(master), str(n), str(RATE_HZ)]
        subprocess.run(arguments, pass_fds=[master], check=True, timeout=60)
        text, _ = reader.communicate(timeout=30)
    finally:
        if reader.poll() is None:
            reader.kill()
            reader.wait()
        os.close(master)
        os.close(slave)
    return [float(value) for value in text.split()[:4]]


def _latency(topic: Topic, program: Path, quick: bool) -> None:
    """Short turns of each reader, one after the other, so that both meet the same disturbances."""
    n = 2000 if quick else 4000
    readers = {"C": [str(program), "read"], "ours": [sys.executable, "-c", _READER]}
    got: dict[str, list[list[float]]] = {name: [] for name in readers}
    for _ in range(2 if quick else 5):
        for name, command in readers.items():
            result = _run_reader(program, command, n)
            assert result[0] == n, (name, result)
            got[name].append(result)
    for column, name, goal in ((1, "latency p50", 3.0), (2, "latency p99", 3.0), (3, "CPU per sample", 5.0)):
        scale = 1e6 / n if column == 3 else 1.0
        values = {who: [scale * result[column] for result in results] for who, results in got.items()}
        for who in readers:
            topic.rows.append(figure(f"{name}, {who}", values[who], "µs"))
        ratios = [ours / c for ours, c in zip(values["ours"], values["C"], strict=True)]
        value = median(values["ours"]) / median(values["C"])
        note = "median over median; range of single turns"
        topic.rows.append(Row(f"{name}: ours / C", value, "×", min(ratios), max(ratios), goal, COST, note))


def _capture(topic: Topic, program: Path) -> None:
    """A whole ``rotdrift capture`` drawing on a terminal; a longer run minus a shorter one: without the start."""
    shares = []
    for _ in range(3):
        used = [_captured_cpu(program, duration) for duration in (5, 14)]
        shares.append(100.0 * (used[1] - used[0]) / 9.0)
    note = "recording, clock, online cycles, dashboard drawn"
    topic.rows.append(figure("capture with everything on", shares, "% of a core", note, 25.0, COST))


def _captured_cpu(program: Path, duration_s: int) -> float:
    master, slave, path = open_pty()
    screen_master, screen_slave = os.openpty()
    fcntl.ioctl(screen_slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 120, 0, 0))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "trial.mcap"
        command = [sys.executable, "-m", "rotdrift", "capture", f"serial:{path}", "--duration", str(duration_s)]
        environment = {**os.environ, "TERM": "xterm-256color"}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        capture = subprocess.Popen(
            [*command, "--out", str(out)],
            stdin=screen_slave,
            stdout=screen_slave,
            stderr=screen_slave,
            env=environment,
            start_new_session=True,
            preexec_fn=_own_terminal,
        )
        os.close(screen_slave)
        drawn = bytearray()
        drain = threading.Thread(target=_drain, args=(screen_master, drawn), daemon=True)
        drain.start()
        n = (duration_s + 8) * RATE_HZ
        arguments = [str(program), "send", str(master), str(n), str(RATE_HZ)]
        sender = subprocess.Popen(arguments, pass_fds=[master])
        try:
            capture.wait(timeout=duration_s + 60)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)  # the sender is still running: not in it
        finally:
            for process in (capture, sender):
                if process.poll() is None:
                    process.kill()
                process.wait()
            for descriptor in (master, slave):
                os.close(descriptor)
        drain.join(5)
        assert capture.returncode in (0, 1), drawn[-500:]
        assert out.stat().st_size > 20 * RATE_HZ * duration_s
        assert len(drawn) > 2000 * duration_s, "the dashboard was not drawn"
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _own_terminal() -> None:
    """Make standard input the terminal of the new session: in the background nothing is drawn."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def _drain(descriptor: int, drawn: bytearray) -> None:
    try:
        while data := os.read(descriptor, 65536):
            drawn += data
    except OSError:
        pass  # the terminal's other end is closed
    os.close(descriptor)


def _highest_rate(topic: Topic, quick: bool) -> None:
    """Eight objects with trial, clock and recording each, reads of 10 ms: how many samples a core takes a second."""
    rates: list[float] = []
    written: list[float] = []
    for _ in range(2 if quick else 5):
        with tempfile.TemporaryDirectory() as folder:
            per_object = 10_000
            chunks = stream_chunks(per_object, 25)
            trials = [Trial() for _ in range(OBJECTS)]
            paths = [Path(folder) / f"{k}.mcap" for k in range(OBJECTS)]
            writers = [RecordingWriter(path, "serial:x", time.time_ns(), 10**9) for path in paths]
            both = list(zip(trials, writers, strict=True))

            def run(chunks: list[Chunk] = chunks, ends: list[tuple[Trial, RecordingWriter]] = both) -> None:
                for chunk in chunks:
                    for trial, writer in ends:
                        take_chunk(trial, writer, chunk)

            used = cpu_s(run)
            for writer in writers:
                writer.close()
            assert all(trial.assembler.losses().missing == 0 for trial in trials)
            rates.append(OBJECTS * per_object / used)
            written.append(1e6 * used / (OBJECTS * per_object))
    note = f"{OBJECTS} objects, reads of 25 samples; trial, clock and recording of each, no screen, no ports"
    topic.rows.append(figure("highest aggregate rate of a core", rates, "samples/s", note, GOAL_HZ, GAIN))
    topic.rows.append(figure("the same, per sample", written, "µs CPU"))


def take_chunk(trial: Trial, writer: RecordingWriter, chunk: Chunk) -> None:
    """What a capture does with a chunk."""
    writer.add_received(chunk)
    for batch in trial.feed(chunk).decoded:
        writer.add_orientations(batch.stamps_ns, batch.quats_wxyz, chunk.host_time_ns)
    writer.flush_if_due(chunk.host_time_ns)
