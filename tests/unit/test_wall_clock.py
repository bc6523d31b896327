"""Steps of the wall clock (NTP, daylight saving, a person) change nothing of a trial but dates.

Real steps of a real kernel's clock, during a real capture: tests/integration/test_power_cut.py.
"""

import ast
import itertools
import json
import time
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest

from host.capture import run as capture_run
from tests.command_line import rotdrift_here
from tests.recorded_trials import MONOTONIC_NS, WALL_NS
from tests.virtual_capture import VirtualObjectLink, virtual_links

ROOT = Path(__file__).resolve().parents[2]
HOUR_NS = 3600 * 10**9
WALL_CLOCK = {
    *("time.time", "time.time_ns", "time.localtime", "time.gmtime", "time.ctime", "time.strftime"),
    *("datetime.now", "datetime.today", "datetime.utcnow", "date.today", "CLOCK_REALTIME"),
}
ONLY_FOR_DATES = {
    "host/capture/run.py": 1,  # when a capture starts: its recording has dates, made of this and the monotonic clock
    "host/links/link_log.py": 1,  # the date in the first line of a log
    "host/commands/capture.py": 1,  # the name of a recording
    "host/commands/demo.py": 1,
    "host/doctor/link_check.py": 1,  # its recording is deleted at the end
    "host/recording/check/mcap_file.py": 1,  # a recording of tomorrow is odd
}


def uses(source):
    """How often a source asks for the time of the day."""
    last = {name.rpartition(".")[2] for name in WALL_CLOCK}
    if not any(name in source for name in last):
        return 0
    n = 0
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and node.attr in last:
            n += any(f".{ast.unparse(node)}".endswith(f".{name}") for name in WALL_CLOCK)
        elif isinstance(node, ast.ImportFrom):
            n += sum(f"{node.module}.{alias.name}" in WALL_CLOCK for alias in node.names)
    return n


def test_the_wall_clock_is_asked_once_and_for_dates_only():
    found = {
        path.relative_to(ROOT).as_posix(): n
        for package in ("analysis", "emulator", "firmware_protocol", "host")
        for path in sorted((ROOT / package).rglob("*.py"))
        if (n := uses(path.read_text(encoding="utf-8")))
    }
    assert found == ONLY_FOR_DATES


@pytest.mark.parametrize(
    ("source", "n"),
    [
        ("time.time()", 1),
        ("time.monotonic()", 0),
        ("datetime.datetime.now()", 1),
        ("f(time.time_ns)", 1),
        ("from time import time", 1),
    ],
)
def test_questions_for_the_time_of_the_day_are_found(source, n):
    assert uses(source) == n


def captured(folder, steps_ns):
    """Capture in virtual time while the wall clock stands at another hour each time it is asked."""
    folder.mkdir()
    hours = itertools.chain([0], itertools.cycle(steps_ns))

    def wall_ns():
        return WALL_NS + next(hours)

    clocks = SimpleNamespace(time_ns=wall_ns, monotonic_ns=lambda: MONOTONIC_NS, monotonic=time.monotonic)
    with (
        virtual_links(VirtualObjectLink()),
        patch.object(capture_run, "time", clocks),
        patch("time.time_ns", wall_ns),
        patch("time.time", lambda: wall_ns() / 1e9),
    ):
        done = rotdrift_here("capture", "memory:", "--out", "trial.mcap", "--cycles", 3, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), (folder / "trial.mcap").read_bytes()


@pytest.mark.parametrize("steps_ns", [[HOUR_NS], [-HOUR_NS], [HOUR_NS, -HOUR_NS, 0]])
def test_steps_of_the_wall_clock_change_neither_result_nor_recording(tmp_path, steps_ns):
    steady, stepped = captured(tmp_path / "steady", [0]), captured(tmp_path / "stepped", steps_ns)
    assert steady[0]["theta_bar_deg"] is not None
    assert stepped == steady
