"""Ten hours at 200 Hz through one ``rotdrift score`` each, from a CSV, from parquet and from a recording of ours.

    python -m benchmarks.ten_hours             7.2 million samples; needs 1.5 GB of disk
    python -m benchmarks.ten_hours --hours 1

Wall time, CPU time and the peak memory are those of the whole process: start, reader, search, score and output. The
exit code is 1 where the wall time or the memory is above its limit. CPU time says what a quiet machine would take.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.sample_streams import FRAME_BYTES, frame_rows, turning
from host.links.transport import Chunk
from host.recording.writer import RecordingWriter

RATE_HZ = 200.0
PERIOD_S = 6.0
LIMIT_S = 60.0
LIMIT_BYTES = 2e9
"""For ten hours."""
_BLOCK = 1 << 17
_PER_READ = 10


@dataclass(frozen=True)
class Run:
    """One run of ``rotdrift score``."""

    what: str
    wall_s: float
    cpu_s: float
    peak_bytes: int
    n_samples: int
    n_endpoints: int

    @property
    def met(self) -> bool:
        """Whether it stays within the limits."""
        return self.wall_s <= LIMIT_S and self.peak_bytes <= LIMIT_BYTES


def write_csv(path: Path, n: int) -> None:
    """Write t,qw,qx,qy,qz with seven decimals."""
    quats = turning(n, RATE_HZ, PERIOD_S)
    with path.open("w") as file:
        file.write("t,qw,qx,qy,qz\n")
        for first in range(0, n, _BLOCK):
            rows = np.arange(first, min(first + _BLOCK, n))
            np.savetxt(file, np.column_stack((rows / RATE_HZ, quats[rows])), fmt="%.4f,%.7f,%.7f,%.7f,%.7f")


def write_parquet(path: Path, n: int) -> None:
    """Write the same columns."""
    import pyarrow  # type: ignore[import-untyped]
    import pyarrow.parquet  # type: ignore[import-untyped]

    columns = np.column_stack((np.arange(n) / RATE_HZ, turning(n, RATE_HZ, PERIOD_S)))
    names = ("t", "qw", "qx", "qy", "qz")
    pyarrow.parquet.write_table(pyarrow.table(dict(zip(names, columns.T, strict=True))), path)


def write_recording(path: Path, n: int) -> None:
    """Write what a capture writes, ten samples a read, the decoded channel with it."""
    period_us = round(1e6 / RATE_HZ)
    writer = RecordingWriter(path, "serial:/dev/ttyACM0", 1_700_000_000 * 10**9, 10**9)
    quats = turning(n, RATE_HZ, PERIOD_S)
    for first in range(0, n, _BLOCK):
        part = quats[first : first + _BLOCK]
        data = frame_rows(part, first, period_us).tobytes()
        for at in range(0, len(part), _PER_READ):
            end = min(at + _PER_READ, len(part))
            host_ns = 10**9 + (first + end) * period_us * 1000
            writer.add_received(Chunk(data[at * FRAME_BYTES : end * FRAME_BYTES], host_ns))
            stamps = host_ns - np.arange(end - at)[::-1] * period_us * 1000
            writer.add_orientations(stamps, part[at:end], host_ns)
    writer.close()


WRITERS: dict[str, Callable[[Path, int], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "mcap": write_recording,
}


def score(path: Path) -> Run:
    """Run ``rotdrift score FILE --json`` and watch it."""
    command = [sys.executable, "-m", "rotdrift", "score", str(path), "--json"]
    started = time.perf_counter()
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen(command, stdout=out)
        _, status, used = os.wait4(process.pid, 0)
        wall_s = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        result = json.load(out)
    assert result["valid"], result["reasons"]
    return Run(
        what=path.suffix.removeprefix("."),
        wall_s=wall_s,
        cpu_s=used.ru_utime + used.ru_stime,
        peak_bytes=used.ru_maxrss * 1024,
        n_samples=result["recording"]["n_samples"],
        n_endpoints=result["n_endpoints"],
    )


def main(hours: float = 10.0, formats: tuple[str, ...] = tuple(WRITERS)) -> int:
    """Measure each format and print one line for it."""
    n, met = int(hours * 3600 * RATE_HZ), True
    print(f"{'format':10}{'samples':>12}{'end points':>12}{'wall':>10}{'CPU':>10}{'peak memory':>14}")
    for name in formats:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"ten_hours.{name}"
            # In a process of its own: a child's peak memory is at least that of its parent when it was started.
            writer = get_context("spawn").Process(target=WRITERS[name], args=(path, n))
            writer.start()
            writer.join()
            assert writer.exitcode == 0
            run = score(path)
        assert run.n_samples == n
        assert abs(run.n_endpoints - n / RATE_HZ / PERIOD_S) <= 2
        met = met and run.met
        print(
            f"{run.what:10}{run.n_samples:>12}{run.n_endpoints:>12}{run.wall_s:>8.1f} s{run.cpu_s:>8.1f} s"
            f"{run.peak_bytes / 1e9:>11.2f} GB{'' if run.met else '   MISS'}",
            flush=True,
        )
    print(f"limits: {LIMIT_S:g} s of wall time, {LIMIT_BYTES / 1e9:g} GB")
    return 0 if met else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Ten hours at 200 Hz through one rotdrift score per format.")
    parser.add_argument("--hours", type=float, default=10.0)
    parser.add_argument("formats", nargs="*", choices=[*WRITERS, []], default=[])
    given = parser.parse_args()
    sys.exit(main(given.hours, tuple(given.formats) or tuple(WRITERS)))
