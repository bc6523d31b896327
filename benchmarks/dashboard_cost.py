"""What the dashboard costs: ``python -m benchmarks.dashboard_cost [--rounds 3] [--seconds 12] [--size 80x24]``.

A virtual object at 1 kHz on a pty, a capture of it in a terminal of its own, in turn with the dashboard and with a line
per cycle. Measured:

arrival-to-decode
    From the stamp of a chunk (right after the read that brought it) to the end of ``Trial.feed`` with it.
pictures
    A second, counted as rewritten "losses" lines, which change with every sample.
CPU
    Of the capture and of the process that draws, as shares of one core.
end point to screen
    From the arrival of the sample at the end point to the moment the terminal received the new count of cycles. The
    end point must first be confirmed: the angle has to go back from it, which is a share of the period.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import median

import numpy as np

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
WARM_UP_S = 2.0
_COUNT = re.compile(rb"(\d+) cycles? \xc2\xb7")


def run_one(link: str, folder: Path, seconds: float, plain: bool) -> None:
    """Be the capture: instrumented, in this process's terminal; figures go to a file."""
    import threading as threads

    from host import capture_run
    from host.capture import CaptureSettings
    from host.screen import ScreenChoice, open_screen
    from host.trial import Trial

    delays_ns: list[tuple[int, int]] = []
    arrivals: list[tuple[float, int]] = []
    endpoints: dict[int, int] = {}

    class MeasuredTrial(Trial):
        def feed(self, chunk):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
            update = super().feed(chunk)
            delays_ns.append((chunk.host_time_ns, time.monotonic_ns() - chunk.host_time_ns))
            arrivals.append((self.newest_s, chunk.host_time_ns))
            for row in update.cycles:
                at = np.searchsorted([newest_s for newest_s, _ in arrivals[-5000:]], row.time_s)
                endpoints[row.number] = arrivals[-5000:][min(at, len(arrivals[-5000:]) - 1)][1]
            return update

    capture_run.Trial = MeasuredTrial  # type: ignore[misc]
    screen = open_screen(False, choice=ScreenChoice(plain_lines=plain))
    before = resource.getrusage(resource.RUSAGE_SELF)
    capture_run.record(link, folder / "trial.mcap", CaptureSettings(duration_s=seconds), screen, threads.Event())
    after, children = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    first_ns = delays_ns[0][0] + WARM_UP_S * 1e9
    figures = {
        "delays_ms": [delay / 1e6 for at, delay in delays_ns if at > first_ns],
        "endpoints_ns": endpoints,
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "screen_cpu_s": children.ru_utime + children.ru_stime,
    }
    (folder / "figures.json").write_text(json.dumps(figures))


def watch(link: str, seconds: float, size: tuple[int, int], plain: bool) -> dict[str, float]:
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
    pictures = 0
    n_bytes = 0

    def read() -> None:
        nonlocal pictures, n_bytes
        while True:
            try:
                data = os.read(master, 65536)
            except OSError:
                return
            now_ns = time.monotonic_ns()
            n_bytes += len(data)
            pictures += data.count(losses)
            for found in _COUNT.finditer(data):
                seen.setdefault(int(found[1]), now_ns)

    threading.Thread(target=read, daemon=True).start()
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "benchmarks.dashboard_cost",
            "--run",
            link,
            folder,
            str(seconds),
            str(int(plain)),
        ]
        done = subprocess.run(
            command, stdin=slave, stdout=slave, stderr=slave, check=False, preexec_fn=_take_terminal, env=_environment()
        )
        os.close(slave)
        figures = json.loads((Path(folder) / "figures.json").read_text()) if not done.returncode else {}
    if not figures:
        raise SystemExit("the capture failed")
    delays = np.array(figures["delays_ms"])
    latencies = [seen[int(n)] - at for n, at in figures["endpoints_ns"].items() if int(n) > 2 and int(n) in seen]
    return {
        "p50_ms": float(np.percentile(delays, 50)),
        "p99_ms": float(np.percentile(delays, 99)),
        "pictures_per_s": pictures / seconds,
        "kB_per_s": n_bytes / 1e3 / seconds,
        "capture_cpu_percent": 100 * figures["cpu_s"] / seconds,
        "screen_cpu_percent": 100 * figures["screen_cpu_s"] / seconds,
        "endpoint_to_screen_s": max(latencies) / 1e9 if latencies else float("nan"),
        "endpoint_to_screen_p50_s": median(latencies) / 1e9 if latencies else float("nan"),
    }


def _take_terminal() -> None:
    """Make standard input the controlling terminal: only then is the capture in its foreground."""
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def _environment() -> dict[str, str]:
    return {**os.environ, "TERM": "xterm-256color", "PYTHONUTF8": "1"}


def main() -> None:
    """Measure, or be the capture that is measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--size", default="80x24")
    parser.add_argument("--run", nargs=4, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.run:
        run_one(args.run[0], Path(args.run[1]), float(args.run[2]), args.run[3] == "1")
        return
    width, height = map(int, args.size.split("x"))
    rounds: dict[bool, list[dict[str, float]]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "kilohertz.toml"
        scenario.write_text(SCENARIO)
        for _ in range(args.rounds):
            for plain in (True, False):
                with VirtualObjectProcess(str(scenario)) as virtual:
                    rounds[plain].append(watch(virtual.link, args.seconds, (width, height), plain))
    ratios = [a["p99_ms"] / b["p99_ms"] for a, b in zip(rounds[False], rounds[True], strict=True)]
    print(f"1 kHz, period {PERIOD_S:g} s, {args.size}, medians of {args.rounds} rounds of {args.seconds:g} s\n")
    print("| figure | dashboard | lines |\n|---|---|---|")
    for name in rounds[False][0]:
        with_it, without = (median(item[name] for item in rounds[plain]) for plain in (False, True))
        print(f"| {name} | {with_it:.3f} | {without:.3f} |")
    print(f"\np99 with / without: {median(ratios):.3f} (rounds {', '.join(f'{ratio:.2f}' for ratio in ratios)})")
    limit_s = 0.4 * PERIOD_S + 0.15
    worst_s = max(item["endpoint_to_screen_s"] for item in rounds[False])
    print(f"end point to screen, longest of all rounds: {worst_s:.3f} s (limit 0.4 period + 150 ms = {limit_s:.3f} s)")


if __name__ == "__main__":
    main()
