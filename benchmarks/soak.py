"""A long capture in virtual time: the whole host path, as fast as it goes, watched for growth and loss.

    python -m benchmarks.soak                  24 h at 200 Hz
    python -m benchmarks.soak --hours 1

Reader thread, capture loop, session, recording, online cycles and score are those of ``rotdrift capture``; the object
is the emulator's, and time is what the object says.
"""

from __future__ import annotations

import argparse
import gc
import os
import resource
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path

from emulator.scenario import load_scenario
from emulator.virtual_object import VirtualObject
from host.capture.loop import Capture
from host.capture.settings import CaptureSettings
from host.links.transport import Chunk, LinkEnd, Transport
from host.recording.writer import RecordingWriter
from host.screen.screens import QuietScreen
from host.trial.live import Trial
from tests.memory_link import MemoryLink

START_NS = 10**12
AHEAD_STEPS = 20
AHEAD_BYTES = 1 << 14
"""How far the object may run ahead of the capture: a real one cannot, for time would pass."""


class VirtualTransport(Transport):
    """A live link on which time is what the object says."""

    name = "virtual:"
    is_live = True

    def __init__(self, virtual: VirtualObject, seconds: float, chunk_s: float, trial: Trial) -> None:
        self._virtual, self._seconds, self._chunk_s, self._trial = virtual, seconds, chunk_s, trial
        self._wire = MemoryLink()
        self._wire.open()
        self._lock = threading.Lock()
        self._step = self._delivered = self._seen = 0
        self.now_ns = START_NS

    def clock(self) -> int:
        """Give the time to the capture, and so learn how far it is."""
        self._seen = self._step
        return self.now_ns

    def read(self, timeout_s: float) -> Chunk | None:  # noqa: ARG002 - it never waits
        if self._delivered - self._trial.link.n_bytes > AHEAD_BYTES or self._step - self._seen > AHEAD_STEPS:
            time.sleep(0.0005)
            return None
        self._step += 1
        now_s = self._step * self._chunk_s
        if now_s > self._seconds:
            raise LinkEnd
        with self._lock:
            for command in self._wire.receive():
                self._virtual.firmware.receive(command, now_s)
        self._virtual.firmware.step(now_s, self._wire.send)
        data = self._wire.take()
        self.now_ns = START_NS + round(1e9 * now_s)
        if not data:
            return None
        self._delivered += len(data)
        return Chunk(data, self.now_ns)

    def write(self, data: bytes) -> None:
        with self._lock:
            self._wire.put_bytes(data)

    def close(self) -> None:
        pass


@dataclass(frozen=True)
class Soak:
    """What a soak came to."""

    seconds: float
    samples: int
    missing: int
    cycles: int
    growth_mb: float
    """Resident memory at its highest after the warm-up, above that at its end."""
    recording_mb: float
    cpu_s: float
    wall_s: float
    warnings: tuple[str, ...]
    produced: int
    """By the object, as its own account says."""


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def soak(seconds: float, rate_hz: int, warm_up_s: float, folder: Path, chunk_s: float = 0.05) -> Soak:
    """Capture an object that streams for so long in its own time.

    Parameters
    ----------
    seconds, warm_up_s
        How long, and from when on memory is watched.
    rate_hz
        Sample rate.
    folder
        Where the recording goes.
    chunk_s
        How often the link delivers.
    """
    found = load_scenario("default")
    cycles = int(seconds / found.motion.period_s) + 2
    scenario = replace(
        found, motion=replace(found.motion, cycles=cycles), device=replace(found.device, rate_hz=rate_hz)
    )
    virtual, trial = VirtualObject(scenario), Trial()
    transport = VirtualTransport(virtual, seconds, chunk_s, trial)
    path = folder / "soak.mcap"
    writer = RecordingWriter(path, transport.name, 0, START_NS)
    memory: list[float] = []
    done = threading.Event()

    def watch() -> None:
        while not done.wait(0.25):
            if transport.now_ns > START_NS + 1e9 * warm_up_s:
                memory.append(resident_mb())

    watcher = threading.Thread(target=watch)
    watcher.start()
    started, before = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF)
    try:
        outcome = Capture(
            transport, writer, trial, QuietScreen(), CaptureSettings(), threading.Event(), transport.clock
        ).run()
    finally:
        done.set()
        watcher.join()
    gc.collect()
    after = resource.getrusage(resource.RUSAGE_SELF)
    losses = trial.assembler.losses()
    # What the object produced after its last packet has no way to us: the link is over.
    return Soak(
        seconds=seconds,
        samples=losses.received,
        missing=losses.missing,
        cycles=trial.n_endpoints,
        growth_mb=max(memory) - memory[0] if memory else 0.0,
        recording_mb=path.stat().st_size / 1e6,
        cpu_s=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        wall_s=time.monotonic() - started,
        warnings=outcome.warnings,
        produced=virtual.truth()["device"]["samples_produced"],
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rate", type=int, default=200, help="Hz")
    parser.add_argument("--folder", type=Path, help="where the recording goes meanwhile (3 GB for 24 h)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rotdrift-soak-", dir=args.folder) as folder:
        result = soak(3600 * args.hours, args.rate, min(3600.0, 600 * args.hours), Path(folder))
    print(
        f"{args.hours:g} h at {args.rate} Hz: {result.samples} samples, {result.missing} missing "
        f"({result.produced} produced), {result.cycles} end points, memory +{result.growth_mb:.1f} MB after the "
        f"warm-up, recording {result.recording_mb:.0f} MB, {result.cpu_s:.0f} s of processor in {result.wall_s:.0f} s"
    )
    for warning in result.warnings:
        print(f"warning: {warning}")
    return int(result.missing > 0 or result.growth_mb > 20 or result.samples != result.produced)


if __name__ == "__main__":
    sys.exit(main())
