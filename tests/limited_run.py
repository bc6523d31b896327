"""Commands under a limit of memory: each in a process forked from one that has imported everything.

``python -m tests.limited_run BYTES`` reads lists of arguments as JSON, one a line, runs each under that limit of
address space, and prints what came of it, one line of JSON each. Linux only.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.waiting import HANG_S

ROOT = Path(__file__).parents[1]
MOST_S = int(HANG_S)
"""Longest wait for one command."""


@dataclass(frozen=True)
class LimitedRun:
    """What came of a command."""

    code: int
    out: str
    err: str
    peak_bytes: int
    """Largest resident memory of the process or of one that it started."""
    cpu_s: float
    wall_s: float


def limited_runs(commands: Sequence[Sequence[object]], memory_bytes: int = 2**30) -> list[LimitedRun]:
    """Run commands of rotdrift, one after the other, under a limit of address space."""
    lines = "".join(json.dumps([str(word) for word in words]) + "\n" for words in commands)
    done = subprocess.run(
        [sys.executable, "-m", "tests.limited_run", str(memory_bytes)],
        cwd=ROOT,
        input=lines,
        capture_output=True,
        text=True,
        timeout=MOST_S * len(commands),
        check=True,
    )
    return [LimitedRun(**json.loads(line)) for line in done.stdout.splitlines()]


def _run(words: list[str], memory_bytes: int) -> LimitedRun:
    from host.cli import main

    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        started = time.monotonic()
        pid = os.fork()
        if pid == 0:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
            signal.alarm(MOST_S)
            try:
                code = main(words)
            except BaseException as error:  # noqa: BLE001 - whatever it is, the test reports it
                os.write(2, f"NOT CAUGHT {error!r}".encode())
                code = 99
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        _, status, used = os.wait4(pid, 0)
        wall_s = time.monotonic() - started
        out.seek(0)
        err.seek(0)
        return LimitedRun(
            os.waitstatus_to_exitcode(status),
            out.read().decode(errors="replace"),
            err.read().decode(errors="replace"),
            used.ru_maxrss * 1024,
            used.ru_utime + used.ru_stime,
            wall_s,
        )


def main() -> None:
    """Answer the requests on standard input."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    import scipy.ndimage
    import scipy.signal  # noqa: F401

    for line in sys.stdin:
        print(json.dumps(asdict(_run(json.loads(line), int(sys.argv[1])))), flush=True)


if __name__ == "__main__":
    main()
