"""What the dashboard costs: ``python -m benchmarks.dashboard_cost [--seconds 62] [--size 80x24]``.

A virtual object at 1 kHz on a pty, one capture of it in a terminal of its own. The dashboard is drawn in every second
stretch of three seconds and rests in the others, so that whatever slows the machine meets both alike; figures are taken
per pair of neighbouring stretches. Measured:

arrival to decode
    From the stamp of a chunk (right after the read that brought it) to the end of ``Trial.feed`` with it.
CPU
    Of the process that draws, and what the capture itself uses more than in the stretch before, as shares of a core.
pictures
    A second, counted as rewritten "losses" lines, which change with every sample.
end point to screen
    From the arrival of the sample at the end point to the moment the terminal received the new count of cycles. The
    end point must first be confirmed: the angle has to go back from it, which is a share of the period.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measurement import COST, Row, Topic, figure
from benchmarks.report import markdown
from host.virtual_object_process import VirtualObjectProcess

PERIOD_S = 1.0
SCENARIO = f"""
purpose = "A thousand samples a second."
[motion]
period_s = {PERIOD_S}
swing_deg = 30.0
cycles = 100000
lead_in_s = 0.2
begins = "on-start"
[drift]
angle_deg = 0.4
[device]
rate_hz = 1000
"""
STRETCH_NS = 3_000_000_000
SETTLE_NS = 300_000_000
"""At the start of a stretch, not counted: the last picture, or the first."""
WARM_UP = 1
"""Pairs not counted."""
SECONDS = 62.0
SIZE = (80, 24)
ENDPOINT_LIMIT_S = 0.4 * PERIOD_S + 0.15
_COUNT = re.compile(rb"(\d+) cycles?(?:\x1b\[[\d;]*m)* \xc2\xb7")


def run_one(link: str, folder: Path, seconds: float) -> None:
    """Be the capture: instrumented, in this process's terminal; figures go to a file."""
    from host.capture import run as capture_run
    from host.capture.settings import CaptureSettings
    from host.screen.choice import open_screen
    from host.screen.live_screen import LiveScreen
    from host.trial.live import Trial

    delays: list[tuple[int, int]] = []
    arrivals: list[tuple[float, int]] = []
    endpoints: dict[int, int] = {}

    class MeasuredTrial(Trial):
        def feed(self, chunk: Any) -> Any:
            update = super().feed(chunk)
            delays.append((chunk.host_time_ns, time.monotonic_ns() - chunk.host_time_ns))
            arrivals.append((self.newest_s, chunk.host_time_ns))
            for row in update.cycles:
                recent = arrivals[-5000:]
                at = int(np.searchsorted([newest_s for newest_s, _ in recent], row.time_s))
                endpoints[row.number] = recent[min(at, len(recent) - 1)][1]
            return update

    stretches: list[dict[str, Any]] = []
    screen: Any = open_screen(False)
    assert isinstance(screen, LiveScreen), "needs a terminal"
    draw = screen.update

    def every_second_stretch(state: Any, index: int = 0) -> None:
        now_ns = time.monotonic_ns()
        if not stretches or now_ns - stretches[-1]["from_ns"] >= STRETCH_NS:
            moment = {"ns": now_ns, "cpu_s": time.process_time(), "screen_cpu_s": _cpu_s(screen.process)}
            if stretches:
                stretches[-1]["end"] = moment
            stretches.append({"from_ns": now_ns, "drawn": len(stretches) % 2 == 1, "begin": moment})
        if stretches[-1]["drawn"]:
            draw(state, index)

    screen.update = every_second_stretch
    capture_run.Trial = MeasuredTrial  # type: ignore[misc]
    capture_run.record(link, folder / "trial.mcap", CaptureSettings(duration_s=seconds), screen, threading.Event())
    screen.stop()
    at_ns, delay_ns = np.array(delays, dtype=np.int64).T
    for stretch in stretches[:-1]:
        inside = (at_ns >= stretch["from_ns"] + SETTLE_NS) & (at_ns < stretch["end"]["ns"])
        stretch["delays_ms"] = (delay_ns[inside] / 1e6).tolist()
    (folder / "figures.json").write_text(json.dumps({"stretches": stretches[:-1], "endpoints": endpoints}))


def _cpu_s(process: subprocess.Popen[bytes] | None) -> float:
    """CPU time of another process, s; NaN where the system does not tell."""
    if process is None or not sys.platform.startswith("linux"):
        return float("nan")
    return time.clock_gettime((~process.pid << 3) | 2)  # the kernel's number of that process's CPU clock


def watch(link: str, seconds: float, size: tuple[int, int]) -> dict[str, Any]:
    """Run one capture in a terminal and watch what arrives there."""
    import fcntl
    import pty
    import struct
    import termios

    master, slave = pty.openpty()
    width, height = size
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", height, width, 0, 0))
    losses = f"\x1b[{height - 3};1H".encode()
    seen: dict[int, int] = {}
    pictures_ns: list[int] = []

    def read() -> None:
        while True:
            try:
                data = os.read(master, 65536)
            except OSError:
                return
            now_ns = time.monotonic_ns()
            pictures_ns.extend([now_ns] * data.count(losses))
            for found in _COUNT.finditer(data):
                seen.setdefault(int(found[1]), now_ns)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.dashboard_cost", "--run", link, folder, str(seconds)]
        environment = {**os.environ, "TERM": "xterm-256color", "PYTHONUTF8": "1"}
        done = subprocess.run(
            command, stdin=slave, stdout=slave, stderr=slave, check=False, preexec_fn=_take_terminal, env=environment
        )
        os.close(slave)
        if done.returncode:
            raise SystemExit("the capture failed")
        figures: dict[str, Any] = json.loads((Path(folder) / "figures.json").read_text())
    reader.join(5)
    return {**figures, "seen": seen, "pictures_ns": pictures_ns}


def _take_terminal() -> None:
    """Make standard input the controlling terminal: only then is the capture in its foreground."""
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def measure(quick: bool = False, seconds: float | None = None, size: tuple[int, int] = SIZE) -> Topic:
    """Measure everything of this topic."""
    topic = Topic(f"Dashboard: one object at 1 kHz, {size[0]}x{size[1]}, period {PERIOD_S:g} s")
    if sys.platform == "win32":
        topic.left_out.append("the dashboard: needs a pty")
        return topic
    if quick and seconds is None:
        topic.left_out.append("the dashboard: takes a minute, `python -m benchmarks --only dashboard_cost`")
        return topic
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "kilohertz.toml"
        scenario.write_text(SCENARIO)
        with VirtualObjectProcess(str(scenario)) as virtual:
            got = watch(virtual.link, seconds or SECONDS, size)
    stretches = got["stretches"][2 * WARM_UP :]
    pairs = list(zip(stretches[0::2], stretches[1::2], strict=False))
    note = f"median of {len(pairs)} pairs of stretches of {STRETCH_NS / 1e9:g} s; range of single pairs"
    for name, at in (("resting", 0), ("drawn", 1)):
        values = [_p99(pair[at]) for pair in pairs]
        topic.rows.append(figure(f"arrival to decode p99, dashboard {name}", values, "ms"))
    ratios = [_p99(drawn) / _p99(resting) for resting, drawn in pairs]
    topic.rows.append(figure("arrival to decode p99: drawn / resting", ratios, "×", note, 1.10, COST))
    used = {part: [_share(pair[1], part) for pair in pairs] for part in ("cpu_s", "screen_cpu_s")}
    more = [_share(drawn, "cpu_s") - _share(resting, "cpu_s") for resting, drawn in pairs]
    topic.rows.append(figure("CPU of the capture, dashboard drawn", used["cpu_s"], "% of a core"))
    topic.rows.append(figure("CPU of the process that draws", used["screen_cpu_s"], "% of a core"))
    both = [a + b for a, b in zip(used["screen_cpu_s"], more, strict=True)]
    topic.rows.append(figure("CPU for the dashboard, both processes", both, "% of a core", note, 8.0, COST))
    rates = [_pictures(drawn, got["pictures_ns"]) for _, drawn in pairs]
    topic.rows.append(Row("pictures a second, most", max(rates), "1/s", min(rates), max(rates), 10.0, COST))
    latencies = _latencies(pairs, got)
    if latencies:
        value = figure("end point to screen", latencies, "s", f"of {len(latencies)} end points")
        topic.rows.append(value)
        limit = f"goal: 0.4 period + 150 ms; of {len(latencies)} end points"
        topic.rows.append(
            Row("end point to screen, longest", max(latencies), "s", goal=ENDPOINT_LIMIT_S, sense=COST, note=limit)
        )
    return topic


def _p99(stretch: dict[str, Any]) -> float:
    return float(np.percentile(stretch["delays_ms"], 99))


def _share(stretch: dict[str, Any], part: str) -> float:
    begin, end = stretch["begin"], stretch["end"]
    return float(100 * (end[part] - begin[part]) / ((end["ns"] - begin["ns"]) / 1e9))


def _pictures(stretch: dict[str, Any], pictures_ns: list[int]) -> float:
    from_ns, to_ns = stretch["from_ns"] + SETTLE_NS, stretch["end"]["ns"]
    return sum(from_ns <= at_ns < to_ns for at_ns in pictures_ns) / ((to_ns - from_ns) / 1e9)


def _latencies(pairs: list[tuple[dict[str, Any], dict[str, Any]]], got: dict[str, Any]) -> list[float]:
    """End point to screen, s, of those end points whose cycle should have been seen in a drawn stretch."""
    found = []
    for number, at_ns in got["endpoints"].items():
        for _, drawn in pairs:
            if drawn["from_ns"] <= at_ns < drawn["end"]["ns"] - 2e9 * ENDPOINT_LIMIT_S and int(number) in got["seen"]:
                found.append((got["seen"][int(number)] - at_ns) / 1e9)
    return found


def main() -> None:
    """Measure, or be the capture that is measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--size", default="80x24")
    parser.add_argument("--run", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        run_one(args.run[0], Path(args.run[1]), float(args.run[2]))
        return
    width, height = map(int, args.size.split("x"))
    print(markdown([measure(seconds=args.seconds, size=(width, height))]))
    print(f"load: {' '.join(f'{value:.1f}' for value in os.getloadavg())}")


if __name__ == "__main__":
    main()
