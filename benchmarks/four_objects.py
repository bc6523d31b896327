"""Four objects at 1 kHz at once, in real time: what is lost, and what it costs.

    python -m benchmarks.four_objects                 ten minutes
    python -m benchmarks.four_objects --seconds 60

The objects are the emulator's, each a process of its own on a pty; the capture is one ``rotdrift capture`` of all four.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from host.virtual_object_process import VirtualObjectProcess

OBJECTS = 4
SCENARIO = """
[motion]
cycles = {cycles}
[device]
rate_hz = 1000
device_id = {device_id}
name = "object {number}"
"""


def cpu_s(pid: int) -> float:
    """Processor time of a process so far, all threads, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    args = parser.parse_args()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rotdrift-four-")))
        objects = []
        for number in range(OBJECTS):
            path = folder / f"{number}.toml"
            cycles = int(args.seconds / 4) + 30
            path.write_text(SCENARIO.format(cycles=cycles, device_id=100 + number, number=number))
            objects.append(stack.enter_context(VirtualObjectProcess(str(path))))
        links = [item.link for item in objects]
        command = [sys.executable, "-P", "-m", "rotdrift", "capture", *links, "--duration", str(args.seconds)]
        capture = subprocess.Popen(
            [*command, "--out", str(folder / "trial.mcap"), "--json"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
        )
        started, used_s = time.monotonic(), 0.0
        while capture.poll() is None:
            elapsed_s = time.monotonic() - started
            if elapsed_s < args.seconds:  # after that it scores
                with contextlib.suppress(OSError):
                    used_s, at_s = cpu_s(capture.pid), elapsed_s
            time.sleep(0.2)
        results = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
        truths = [item.stop() for item in objects]
    dropped = sum(truth["device"]["samples_dropped"] for truth in truths)
    received = [result["losses"]["received"] for result in results]
    missing = sum(result["losses"]["missing"] for result in results)
    print(
        f"{len(results)} objects at 1 kHz for {args.seconds:g} s: {sum(received)} samples received, {missing} missing "
        f"({dropped} dropped by the objects), the capture took {100 * used_s / at_s:.0f} % of one core"
    )
    return int(missing > 0 or len(results) != OBJECTS)


if __name__ == "__main__":
    sys.exit(main())
