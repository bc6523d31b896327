"""How much of a trial a power cut costs, on a disk that loses what was not flushed: ``python -m benchmarks.power_cut``.

A real capture in a user-mode kernel writes to a block device with a volatile cache (``tests/uml/volatile_disk.py``).
Power is cut just before each batch of writes lasts, with nothing of it, and several times with some of it in any order.
Needs Linux on x86-64 and what ``tests/system-packages.sh`` installs.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

from tests.uml.boot import missing
from tests.uml.cut_disk import PROGRAMS, CutDisk


def main() -> int:
    """Capture, cut, and print what was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the capture")
    parser.add_argument("--torn", type=int, default=3, help="how often some of a batch lasts")
    options = parser.parse_args()
    reason = missing(PROGRAMS, "nbd")
    if reason:
        print(f"not measured: {reason}")
        return 1
    with tempfile.TemporaryDirectory(prefix="power-") as folder:
        disk = CutDisk(Path(folder))
        disk.run(options.seconds, 120 + 10 * options.seconds)
        if "CHECK captured 0" not in disk.printed:
            print(f"not measured: {disk.printed[-1000:]}")
            return 1
        lost_s, wrong = [], 0
        for seed in (None, *range(options.torn)):
            for cut in disk.cuts(seed):
                size = 0 if cut.recording is None else cut.recording.stat().st_size
                wrong += size < cut.certain
                recorded = b"".join(chunk.data for chunk in cut.recorded)
                received = b"".join(chunk.data for chunk in cut.received)
                wrong += not (received.startswith(recorded) or recorded.startswith(received))
                if cut.received:
                    lost_s.append(cut.lost_s)
        print(
            f"{len(lost_s)} cuts in {options.seconds:g} s: lost {statistics.median(lost_s):.2f} s in the median, ",
            end="",
        )
        print(f"{max(lost_s):.2f} s at most; {wrong} with anything missing or wrong that was synchronised")
    return 0


if __name__ == "__main__":
    sys.exit(main())
