"""The ``rotdrift`` command and virtual objects as real processes, for tests."""

import io
import os
import subprocess
import sys
import threading
from contextlib import ExitStack, chdir, contextmanager, redirect_stderr, redirect_stdout, suppress
from unittest.mock import patch

from host.cli import main
from tests.waiting import HANG_S, wait_for, wait_for_thread

BASE = (sys.executable, "-P", "-m", "rotdrift")

QUICK = """
purpose = "A short trial for tests."
seed = {seed}
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
        "seed": 1,
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


def rotdrift(*arguments, cwd=None, **extra):
    """Run the command to its end."""
    return subprocess.run(
        [*BASE, *map(str, arguments)],
        cwd=cwd,
        env=environment(**extra),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=HANG_S,
        check=False,
    )


def rotdrift_here(*arguments, cwd=".", **extra):
    """Run the command to its end in this process: for tests of what it does, not of how it starts and ends."""
    output, errors = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, environment(**extra), clear=True))
        stack.enter_context(chdir(cwd))
        stack.enter_context(redirect_stdout(output))
        stack.enter_context(redirect_stderr(errors))
        code = main([*map(str, arguments)])
    texts = (stream.buffer.getvalue().decode() for stream in (output, errors))
    return subprocess.CompletedProcess(arguments, code, *texts)


class Lines:
    """Lines that a process writes to a pipe.

    A thread reads them: the process is never held up by a full pipe, and whoever waits for a line is never stuck in a
    read that does not return.
    """

    def __init__(self, pipe):
        self._pipe, self._lines = pipe, []
        self._reading = threading.Thread(target=self._read, name="the output of a process", daemon=True)
        self._reading.start()

    def _read(self):
        with self._pipe:
            self._lines.extend(self._pipe)

    def up_to(self, text):
        """Wait for a line that holds a text; return all lines up to it."""

        def count():
            was_ended = not self._reading.is_alive()
            found = next((n for n, line in enumerate(self._lines, 1) if text in line), None)
            assert found or not was_ended, f"no line with {text!r} in {self._lines!r}"
            return found

        return self._lines[: wait_for(count, lambda: f"a line with {text!r}; there is {self._lines!r}")]

    def all(self):
        """Wait for the end; return all that was written."""
        wait_for_thread(self._reading)
        return "".join(self._lines)


class Program:
    """A program that was started, and what it writes."""

    def __init__(self, words, cwd=None, stdin=subprocess.DEVNULL):
        self.process = subprocess.Popen(
            list(map(str, words)),
            cwd=cwd,
            env=environment(),
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
        )
        self.pid = self.process.pid
        self.stdout, self.stderr = Lines(self.process.stdout), Lines(self.process.stderr)

    def send_signal(self, number):
        self.process.send_signal(number)

    def exit_code(self):
        """Wait for its end; return its exit code."""
        return self.process.wait(HANG_S)

    def finish(self):
        """Wait for its end; return its exit code and all of its output, as `subprocess.run` does."""
        return subprocess.CompletedProcess(self.process.args, self.exit_code(), self.stdout.all(), self.stderr.all())


@contextmanager
def running(program):
    """Kill a program when the block is left, unless it has ended."""
    try:
        yield program
    finally:
        program.process.kill()
        program.finish()
        if program.process.stdin is not None:
            with suppress(BrokenPipeError):
                program.process.stdin.close()


def started(*arguments, cwd=None):
    """Start the command; killed when the block is left."""
    return running(Program([*BASE, *arguments], cwd))


def wait_for_line(program, text):
    """Wait for a line on standard output; return the lines up to it."""
    return program.stdout.up_to(text)


def one_sentence(result, code):
    """Check that a command failed as agreed: code, one line on stderr, no traceback; return the line."""
    assert result.returncode == code, (result.returncode, result.stdout, result.stderr)
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("rotdrift: ")
    assert "Traceback" not in result.stderr
    return lines[0]
