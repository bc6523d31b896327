"""CPU of a fresh process: ``rotdrift --help``, and ``rotdrift score`` of a small file."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.measurement import COST, Topic, figure
from benchmarks.sample_streams import turning

HELP_GOAL_S = 0.25
SCORE_GOAL_S = 0.8
_CHILD = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
usage = resource.getrusage(resource.RUSAGE_CHILDREN)
print(done.returncode, usage.ru_utime + usage.ru_stime)
"""


def child_cpu_s(command: list[str]) -> float:
    """CPU seconds of a process and what it starts."""
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, *command], capture_output=True, text=True, check=True, timeout=120
    )
    code, used = done.stdout.split()
    assert code == "0", (command, done.stderr)
    return float(used)


def small_file(folder: Path) -> Path:
    """One minute at 100 Hz, as a CSV with named columns."""
    path = folder / "small.csv"
    quats = turning(6000, 100.0)
    rows = np.concatenate([np.arange(6000)[:, None] / 100.0, quats], axis=1)
    np.savetxt(path, rows, delimiter=",", header="time,qw,qx,qy,qz", comments="", fmt="%.9g")
    return path


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic("Start-up: CPU of a fresh process")
    with tempfile.TemporaryDirectory() as name:
        path = str(small_file(Path(name)))
        rotdrift = [sys.executable, "-m", "rotdrift"]
        commands = {
            "python -c pass": [sys.executable, "-c", "pass"],
            "import numpy": [sys.executable, "-c", "import numpy"],
            "rotdrift --help": [*rotdrift, "--help"],
            "rotdrift score, one minute at 100 Hz": [*rotdrift, "score", path],
        }
        times: dict[str, list[float]] = {label: [] for label in commands}
        for _ in range(3 if quick else 9):
            for label, command in commands.items():
                times[label].append(child_cpu_s(command))
    goals = {"rotdrift --help": HELP_GOAL_S, "rotdrift score, one minute at 100 Hz": SCORE_GOAL_S}
    for label, values in times.items():
        topic.rows.append(figure(label, values, "s CPU", goal=goals.get(label), sense=COST))
    return topic
