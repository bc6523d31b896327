"""Eight objects on eight ptys, one process that is bound to one core: how many samples a second without a loss."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.live import open_pty, take_chunk
from benchmarks.measurement import GAIN, Topic, figure
from benchmarks.native import NoCompilerError, build
from host.reader import GATHER_S, ReaderThread
from host.recording.writer import RecordingWriter
from host.transports import open_transport
from host.trial import Trial

OBJECTS = 8
GOAL_HZ = 20_000
RATES_HZ = (1000, 1800, 2600, 4000)
"""Of one object; the highest that all keep is reported."""
SECONDS = 4.0
SILENCE_S = 2.0
BUSY = 80.0
"""Share of the core, %, above which it is the core that was too slow."""


def receive(paths: list[str]) -> dict[str, Any]:
    """Be the host: read, record and follow all objects until they fall silent; what came, and what it took."""
    readers = [ReaderThread(open_transport(f"serial:{path}")) for path in paths]
    trials = [Trial() for _ in paths]
    with tempfile.TemporaryDirectory() as folder:
        writers = [
            RecordingWriter(Path(folder) / f"{k}.mcap", "serial:x", time.time_ns(), time.monotonic_ns())
            for k in range(len(paths))
        ]
        for reader in readers:
            reader.start()
        print("ready", flush=True)
        first_ns, last_ns = 0, time.monotonic_ns() + 10 * 10**9  # they may take a while to begin
        used, at_first, done_ns = 0.0, 0.0, 0
        while time.monotonic_ns() - last_ns < SILENCE_S * 1e9:
            time.sleep(GATHER_S)
            for reader, trial, writer in zip(readers, trials, writers, strict=True):
                for chunk in reader.take(0.0):
                    take_chunk(trial, writer, chunk)
                    if not first_ns:
                        first_ns, at_first = chunk.host_time_ns, time.process_time()
                        last_ns = first_ns
                    last_ns = max(last_ns, chunk.host_time_ns)
                    used, done_ns = time.process_time() - at_first, time.monotonic_ns()
        for reader, writer in zip(readers, writers, strict=True):
            reader.stop()
            writer.close()
    return {
        "samples": [trial.assembler.losses().received for trial in trials],
        "lost": sum(trial.link.counters.samples_lost for trial in trials),
        "errors": sum(trial.link.damaged_frames for trial in trials),
        "overflows": sum(reader.overflow_chunks for reader in readers),
        "seconds": (done_ns - first_ns) / 1e9,  # until all was worked on, not only read
        "cpu": used,
    }


def run_once(program: Path, rate_hz: int) -> dict[str, Any]:
    """One rate: senders on the other cores, the host on the first."""
    cores = sorted(os.sched_getaffinity(0))
    ptys = [open_pty() for _ in range(OBJECTS)]
    n = int(SECONDS * rate_hz)
    senders = []
    host = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.eight_objects", *(path for _, _, path in ptys)],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        os.sched_setaffinity(host.pid, cores[:1])
        assert host.stdout is not None
        assert host.stdout.readline().strip() == "ready"
        for master, _, _ in ptys:
            command = [str(program), "send", str(master), str(n), str(rate_hz)]
            senders.append(subprocess.Popen(command, pass_fds=[master]))
            os.sched_setaffinity(senders[-1].pid, cores[1:] or cores)
        text, _ = host.communicate(timeout=60)
    finally:
        for process in (host, *senders):
            if process.poll() is None:
                process.kill()
            process.wait()
        for master, slave, _ in ptys:
            os.close(master)
            os.close(slave)
    result: dict[str, Any] = json.loads(text)
    complete = result["samples"] == [n] * OBJECTS and not (result["lost"] or result["errors"] or result["overflows"])
    # A host that is too slow keeps what it read waiting, or fills the pty and makes the sender wait: it takes longer.
    result["kept"] = complete and result["seconds"] < 1.1 * SECONDS
    result["rate_hz"] = sum(result["samples"]) / result["seconds"]
    return result


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic(f"Eight objects: {OBJECTS} ptys, a process bound to one core")
    if not hasattr(os, "sched_setaffinity"):
        topic.left_out.append("a process cannot be bound to a core here")
        return topic
    try:
        program = build("native_live.c", shared=False)
    except NoCompilerError as error:
        topic.left_out.append(str(error))
        return topic
    kept: dict[str, Any] | None = None
    for rate_hz in RATES_HZ[1:2] if quick else RATES_HZ:
        result = run_once(program, rate_hz)
        cpu = 100 * result["cpu"] / result["seconds"]
        note = f"{sum(result['samples'])} samples, {result['lost']} lost, {result['errors']} damaged, {cpu:.0f} % CPU"
        if not result["kept"]:
            note += "; it took longer than the objects sent: "
            note += "more than a core can take" if cpu > BUSY else "for the machine, which had other work"
        name = f"{OBJECTS} × {rate_hz} Hz: received"
        topic.rows.append(figure(name, [result["rate_hz"]], "samples/s", note))
        if not result["kept"]:
            break
        kept = result
    note = "ports, decoding, recording, clock, online cycles; no screen"
    if kept is None:
        kept = result
        note += "; NOT kept: it took longer than the objects sent, nothing was lost"
    topic.rows.append(
        figure("highest aggregate rate kept without loss", [kept["rate_hz"]], "samples/s", note, GOAL_HZ, GAIN)
    )
    topic.rows.append(figure("CPU at that rate", [100 * kept["cpu"] / kept["seconds"]], "% of the core"))
    topic.rows.append(figure("CPU a sample", [1e6 * kept["cpu"] / sum(kept["samples"])], "µs"))
    return topic


if __name__ == "__main__":
    print(json.dumps(receive(sys.argv[1:])))
