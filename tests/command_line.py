"""The ``rotdrift`` command and virtual objects as real processes, for tests."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager

BASE = (sys.executable, "-P", "-m", "rotdrift")

QUICK = """
purpose = "A short trial for tests."
[motion]
period_s = {period_s}
swing_deg = 30.0
cycles = {cycles}
lead_in_s = {lead_in_s}
begins = "{begins}"
[drift]
angle_deg = 0.4
[imu]
{imu}
[clock]
{clock}
[device]
rate_hz = 200
transmit_queue_bytes = 500000
{device}
"""

PERFECT_IMU = """
noise_deg = 0.0
correlated_noise_deg = 0.0
heading_drift_deg_per_min = 0.0
gyro_bias_dps = [0.0, 0.0, 0.0]
gyro_noise_dps = 0.0
acceleration_noise_g = 0.0
"""


def quick_scenario(folder, name="quick", **values):
    """Write a scenario of half-second cycles; return its path as text.

    The object's queue holds what a capture that gets no processor for a while leaves in it: no sample is dropped.
    """
    keys = {
        "period_s": 0.5,
        "cycles": 60,
        "lead_in_s": 0.3,
        "begins": "on-start",
        "imu": PERFECT_IMU,
        "clock": "",
        "device": "",
    }
    path = folder / f"{name}.toml"
    path.write_text(QUICK.format(**(keys | values)))
    return str(path)


def environment(**extra):
    """The environment of a headless machine."""
    kept = {key: value for key, value in os.environ.items() if key not in {"NO_COLOR", "FORCE_COLOR", "COLUMNS"}}
    return {**kept, "TERM": "dumb", "PYTHONUTF8": "1", **extra}


def rotdrift(*arguments, cwd=None, timeout_s=60, **extra):
    """Run the command to its end."""
    return subprocess.run(
        [*BASE, *map(str, arguments)],
        cwd=cwd,
        env=environment(**extra),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=timeout_s,
        check=False,
    )


@contextmanager
def started(*arguments, cwd=None):
    """Start the command; ended when the block is left."""
    process = subprocess.Popen(
        [*BASE, *map(str, arguments)],
        cwd=cwd,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for(condition, within_s=30.0, what="condition"):
    """Wait for a condition, bounded."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"{what} did not come within {within_s} s")


def wait_for_line(process, text, within_s=30.0):
    """Read a process's standard output up to a line that holds a text; return the lines."""
    lines = []
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        line = process.stdout.readline()
        lines.append(line)
        if text in line:
            return lines
        if not line:
            break
    raise AssertionError(f"no line with {text!r} in {lines!r}")


def one_sentence(result, code):
    """Check that a command failed as agreed: code, one line on stderr, no traceback; return the line."""
    assert result.returncode == code, (result.returncode, result.stdout, result.stderr)
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("rotdrift: ")
    assert "Traceback" not in result.stderr
    return lines[0]
