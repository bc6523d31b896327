"""Eight objects on eight ptys, one capture that is bound to one core: how many samples a second without a loss."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from benchmarks.live import open_pty
from benchmarks.measurement import GAIN, Topic, figure
from benchmarks.native import NoCompilerError, build
from host.capture.loop import STATE_NS
from host.capture.settings import CaptureSettings
from host.capture.several import capture_several
from host.screen.screens import QuietScreen
from host.trial.state import TrialState

OBJECTS = 8
GOAL_HZ = 20_000
RATES_HZ = (1000, 2600, 4000, 6000)
"""Of one object; the highest that all keep is reported."""
SECONDS = 6.0
SILENCE_S = 2.0
LATE_S = 0.1 + 1e-9 * STATE_NS
"""All must be worked on within so long after it was sent; the capture tells its state every STATE_NS."""
BUSY = 80.0
"""Share of the core, %, above which it is the core that was too slow."""


class _Watch(QuietScreen):
    """The screen of the capture: notes when all that will come was worked on, and what it took."""

    def __init__(self) -> None:
        super().__init__()
        self.states: dict[int, TrialState] = {}
        self._first = self.last = (0, 0.0)  # monotonic time, ns, and CPU, s, at the first and the newest sample

    def update(self, state: TrialState, index: int = 0) -> None:
        """Look whether there is more than before; say when all links are open."""
        before = self.states.get(index, TrialState()).stream.losses.received
        if len(self.states | {index: state}) == OBJECTS > len(self.states):
            print("ready", flush=True)
        self.states[index] = state
        if state.stream.losses.received > before:
            self.last = time.monotonic_ns(), time.process_time()
            if not self._first[0]:
                self._first = self.last

    def figures(self) -> dict[str, Any]:
        """Give what came and what it took."""
        streams = [self.states[index].stream for index in sorted(self.states)]
        return {
            "samples": [stream.losses.received for stream in streams],
            "lost": sum(stream.losses.missing for stream in streams),
            "errors": sum(stream.counters.crc_errors + stream.counters.malformed for stream in streams),
            "overflows": sum(state.link.overflow_chunks for state in self.states.values()),
            "seconds": (self.last[0] - self._first[0]) / 1e9,
            "cpu": self.last[1] - self._first[1],
        }


def receive(paths: list[str]) -> dict[str, Any]:
    """Be the host: ``rotdrift capture`` of all objects, without a terminal, until they fall silent."""
    for name in ("scipy.ndimage", "scipy.stats"):  # or the import is part of the figure
        importlib.import_module(name)
    watch = _Watch()
    with tempfile.TemporaryDirectory() as folder:
        capture_several(
            [f"serial:{path}" for path in paths],
            [Path(folder) / f"{number}.mcap" for number in range(len(paths))],
            CaptureSettings(silence_limit_s=SILENCE_S, reconnect_s=0.0),
            watch,
            threading.Event(),
        )
    return watch.figures()


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
    result["kept"] = complete and result["seconds"] < SECONDS + LATE_S
    result["rate_hz"] = OBJECTS * rate_hz if result["kept"] else sum(result["samples"]) / result["seconds"]
    return result


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic(f"Eight objects: {OBJECTS} ptys, a capture bound to one core")
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
        name = f"{OBJECTS} × {rate_hz} Hz: worked on"
        topic.rows.append(figure(name, [result["rate_hz"]], "samples/s", note))
        if not result["kept"]:
            break
        kept = result
    note = "ports, decoding, recording, clock, online cycles: a capture without a terminal"
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
