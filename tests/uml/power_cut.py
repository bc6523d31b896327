"""Runs inside the user-mode kernel: a capture to a disk whose cache loses what is not flushed.

Meanwhile the wall clock of that kernel is set forward and back by an hour.

``/dev/ubda`` holds an empty file system, ``/dev/ubdb`` takes the journal of what has lasted, ``/dev/ubdc`` the log of
the link, which is the account of what was received. The test outside puts them together.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import environment, quick_scenario
from tests.uml.kernel_modules import insert
from tests.uml.volatile_disk import attach, serve
from tests.waiting import HANG_S, wait_for

CAPTURE_S = float(os.environ.get("POWER_CUT_S", "3"))
LEAST_SYNCS = 5
WORK = Path("/dev/shm")
SYNCED = WORK / "synced"
"""Eight bytes for each sync that the capture was told is done: how long the file was when it asked for it."""
CAPTURE = f"""
import os, sys
import rotdrift
sync, done = os.fdatasync, open({str(SYNCED)!r}, "ab", buffering=0)
def noted(descriptor):
    size = os.fstat(descriptor).st_size
    sync(descriptor)
    done.write(size.to_bytes(8, "little"))
os.fdatasync = noted
sys.exit(rotdrift.main())
"""


def size_of(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def synced() -> int:
    """How much of the recording the capture may count on."""
    return int.from_bytes(SYNCED.read_bytes()[-8:], "little") if SYNCED.exists() else 0


def step_wall_clock(by_s: float) -> None:
    time.clock_settime(time.CLOCK_REALTIME, time.time() + by_s)
    print(f"CHECK wall clock stepped by {by_s:g} s", flush=True)


def main() -> int:
    insert("nbd")
    image, log = bytearray(Path("/dev/ubda").read_bytes()), WORK / "link.txt"
    journal = os.open("/dev/ubdb", os.O_WRONLY)
    end = attach("/dev/nbd0", len(image))
    disk = WORK / "disk"
    disk.mkdir()
    recording = disk / "trial.mcap"
    serving = (end, image, journal, lambda: (synced(), size_of(log)))
    threading.Thread(target=serve, args=serving, daemon=True).start()
    wait_for(lambda: int(Path("/sys/block/nbd0/size").read_text()) * 512 == len(image), "the disk")
    subprocess.run(["mount", "-t", "ext4", "/dev/nbd0", str(disk)], check=True, timeout=HANG_S)
    with VirtualObjectProcess(quick_scenario(WORK)) as virtual:
        capture = subprocess.Popen(
            [sys.executable, "-c", CAPTURE, "capture", virtual.link, "--out", str(recording), "--debug-link", str(log)],
            env=environment(),
            stdout=subprocess.DEVNULL,
        )
        wait_for(lambda: size_of(log) > 10_000, "data")
        for by_s in (3600.0, -7200.0, 3600.0):
            time.sleep(CAPTURE_S / 4)
            step_wall_clock(by_s)
        time.sleep(CAPTURE_S / 4)
        wait_for(lambda: size_of(SYNCED) >= 8 * LEAST_SYNCS, "that the recording is synchronised")
        capture.send_signal(signal.SIGINT)  # the end is a moment at which power may fail, too
        code = capture.wait(HANG_S)
    # At once, before the system writes by itself what the program has left in its memory.
    with Path("/dev/ubdc").open("r+b") as file:
        file.write(log.read_bytes() + b"\n# END\n")
        file.flush()
        os.fsync(file.fileno())
    print(f"CHECK captured {code}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
