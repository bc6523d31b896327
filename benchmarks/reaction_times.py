"""How soon a capture reacts: ``python -m benchmarks.reaction_times [--times 7]``.

Real processes on pseudo-terminals, medians of several times (Linux, macOS):

cable
    From the moment a device vanishes to the reader's knowing, and from its return to the first data.
Ctrl-C
    From the signal to the closed recording: STOP answered, everything written, the index behind it.
SIGKILL
    How long before the kill the first read came that is not in the recording; the log of the link says what was read.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue

from benchmarks.measurement import COST, Row, Topic, figure
from benchmarks.report import markdown
from emulator.faults.definitions import parse_fault_command
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from host.links import open_lasting
from host.links.transport import Transport
from host.recording.reader import RecordingReader
from host.virtual_object_process import VirtualObjectProcess

PATIENCE_S = 30.0
TIMES = 7
WATCH_S = 0.0005
"""Between two looks at whether the device is there: shorter times are not told apart."""
END_OF_RECORDING = b"\x89MCAP0\r\n"


def cable(times: int) -> list[Row]:
    """Pull a device and put it back, several times."""
    noticed_ms, again_ms = [], []
    stop, ready, faults = threading.Event(), threading.Event(), SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="rotdrift-cable-") as folder:
        path = Path(folder) / "object"
        link = open_link(f"pty:{path}")
        # Streams without being asked: no handshake is in these times.
        thread = threading.Thread(
            target=lambda: run(
                load_scenario("mute"), link, stop=stop, on_ready=lambda _: ready.set(), live_faults=faults
            )
        )
        thread.start()
        try:
            assert ready.wait(PATIENCE_S)
            with open_lasting(f"serial:{path}", PATIENCE_S) as transport:
                for _ in range(times):
                    _until_data(transport)
                    seen_s: list[float] = []
                    watcher = threading.Thread(target=_watch, args=(path, seen_s))
                    watcher.start()
                    faults.put(parse_fault_command("unplug for_s=0.3"))
                    while transport.connected:
                        transport.read(0.05)
                    noticed_s = time.monotonic()
                    _until_data(transport)
                    again_s = time.monotonic()
                    watcher.join(PATIENCE_S)
                    noticed_ms.append(1e3 * max(noticed_s - seen_s[0], WATCH_S))
                    again_ms.append(1e3 * (again_s - seen_s[1]))
        finally:
            stop.set()
            thread.join(PATIENCE_S)
    return [
        figure("a pulled cable is noticed", noticed_ms, "ms", "looked at every 0.5 ms", 50.0, COST),
        figure("data again after its return", again_ms, "ms", goal=1000.0, sense=COST),
    ]


def ctrl_c(times: int) -> Row:
    """End captures with Ctrl-C."""
    closed_ms = []
    for _ in range(times):
        with _capture() as (capture, recording, _):
            asked_s = time.monotonic()
            capture.send_signal(signal.SIGINT)
            _until(lambda recording=recording: recording.read_bytes().endswith(END_OF_RECORDING))
            closed_ms.append(1e3 * (time.monotonic() - asked_s))
            capture.wait(PATIENCE_S)
    return figure("Ctrl-C to the closed recording", closed_ms, "ms", goal=500.0, sense=COST)


def sigkill(times: int) -> Row:
    """Kill captures, and look for what they had read and not written."""
    lost_ms = []
    for _ in range(times):
        with _capture() as (capture, recording, log):
            os.kill(capture.pid, signal.SIGKILL)
            capture.wait(PATIENCE_S)
            kept = sum(len(chunk.data) for chunk in RecordingReader(recording).chunks())
            lines = [line.split() for line in log.read_text().splitlines()[:-1] if not line.startswith("#")]
            reads = [(float(line[0]), len(bytes.fromhex("".join(line[3:])))) for line in lines if line[1] == "<"]
            first_lost_s = reads[-1][0]
            for at_s, size in reads:
                kept -= size
                if kept < 0:
                    first_lost_s = at_s
                    break
            lost_ms.append(1e3 * (reads[-1][0] - first_lost_s))
    return figure("received data lost by SIGKILL", lost_ms, "ms", goal=100.0, sense=COST)


@contextlib.contextmanager
def _capture() -> Iterator[tuple[subprocess.Popen[bytes], Path, Path]]:
    """Capture in a process until half a megabyte of the link is logged; gives process, recording and log."""
    with (
        tempfile.TemporaryDirectory(prefix="rotdrift-capture-") as folder,
        VirtualObjectProcess("high-rate") as virtual,
    ):
        recording, log = Path(folder) / "trial.mcap", Path(folder) / "link.txt"
        command = [sys.executable, "-P", "-m", "rotdrift", "capture", virtual.link, "--out", str(recording)]
        capture = subprocess.Popen(
            [*command, "--debug-link", str(log)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            _until(lambda: log.exists() and log.stat().st_size > 500_000)
            yield capture, recording, log
        finally:
            capture.kill()
            capture.wait(PATIENCE_S)


def _watch(path: Path, seen_s: list[float]) -> None:
    """Note when the device vanished, and when it was there again."""
    for there in (False, True):
        _until(lambda there=there: os.path.lexists(path) is there, WATCH_S)
        seen_s.append(time.monotonic())


def _until_data(transport: Transport) -> None:
    def came() -> bool:
        chunk = transport.read(0.05)
        return chunk is not None and bool(chunk.data)

    _until(came, 0.0)


def _until(true: Callable[[], bool], pause_s: float = 0.002) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        if time.monotonic() > deadline:
            raise TimeoutError("what was to be measured did not happen")
        time.sleep(pause_s)


def measure(quick: bool) -> Topic:
    """Measure everything; fewer times when ``quick``."""
    times = 3 if quick else TIMES
    return Topic("Reactions of a capture", [*cable(times), ctrl_c(times), sigkill(times)])


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=int, default=TIMES)
    args = parser.parse_args()
    rows = [*cable(args.times), ctrl_c(args.times), sigkill(args.times)]
    print(markdown([Topic("Reactions of a capture", rows)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
