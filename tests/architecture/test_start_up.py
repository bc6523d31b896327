"""What a start may import: `rotdrift --help` nothing but the standard library, `score` no drawing and no driver."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from tests.waiting import HANG_S

ROOT = Path(__file__).parents[2]
HELP_MAY_IMPORT = {"analysis", "emulator", "host", "rotdrift"}
"""Top-level modules outside the standard library; of these packages only what names the commands and their options."""
_SCRIPT = """
import json, sys
before = set(sys.modules)
import rotdrift
code = rotdrift.main(sys.argv[1:])
print("\\n" + json.dumps([code, sorted(set(sys.modules) - before)]))
"""


def imported_by(*arguments: str) -> set[str]:
    command = [sys.executable, "-c", _SCRIPT, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=HANG_S, check=True)
    code, modules = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, done.stdout + done.stderr
    return set(modules)


def outside(modules: set[str]) -> set[str]:
    """Top-level names that are not of the standard library."""
    return {name.partition(".")[0] for name in modules} - set(sys.stdlib_module_names)


def test_help_imports_nothing_but_our_own_commands():
    modules = imported_by("--help")
    assert outside(modules) <= HELP_MAY_IMPORT
    assert "host.cli" in modules, "the list of modules is wrong if it lacks this one"
    ours = {name for name in modules if name.partition(".")[0] in HELP_MAY_IMPORT}
    allowed = {"rotdrift", "host", "host.cli", "host.errors", "host.version", "host.commands", "analysis", "emulator"}
    allowed |= {"host.command_line", "host.command_line.parser"}
    allowed |= {"host.output", "host.output.lines", "host.output.streams", "host.text"}  # help is printed, too
    extra = {name for name in ours - allowed if not name.startswith("host.commands.")}
    assert extra <= {"host.links.uri", "host.results", "host.results.arguments"}, (
        f"--help pays for these: {sorted(extra)}"
    )


def test_score_of_a_small_file_imports_no_drawing_and_no_driver(tmp_path):
    time_s = np.arange(3000) / 100.0
    half = np.radians(15.0) * (1.0 - np.cos(np.pi * time_s)) + np.radians(0.05) * time_s
    rows = np.stack([time_s, np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    path = tmp_path / "small.csv"
    np.savetxt(path, rows, delimiter=",", header="time,qw,qx,qy,qz", comments="", fmt="%.9g")
    modules = imported_by("score", str(path))
    assert "numpy" in modules
    heavy = {"matplotlib", "plotly", "jinja2", "can", "cantools", "serial", "isotp", "pyarrow", "rosbags", "construct"}
    assert not outside(modules) & heavy
    assert not {name for name in modules if name.startswith(("scipy.signal", "scipy.optimize", "scipy.stats"))}
