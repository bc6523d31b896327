"""The emulator as a process whose faults are typed in while it runs."""

import json
import subprocess
from contextlib import contextmanager

from tests.command_line import BASE, Program, running, wait_for_line
from tests.waiting import wait_for


class LiveObject:
    """A running emulator."""

    def __init__(self, program, truth_path):
        self.program = program
        self._truth_path = truth_path
        self.link = wait_for_line(program, "ready: ")[-1].split("ready: ")[1].strip()

    def fault(self, command):
        self.program.process.stdin.write(command + "\n")
        self.program.process.stdin.flush()

    def truth(self):
        """What it reports so far; written again every 2 s at most."""
        return json.loads(self._truth_path.read_text())

    def wait_for_fault(self, kind):
        wait_for(lambda: self.truth()["fault_counts"].get(kind), f"fault {kind}")

    def stop(self):
        self.program.process.terminate()
        assert self.program.exit_code() == 0
        return self.truth()


@contextmanager
def live_object(folder, scenario, address):
    """Start an emulator that takes faults."""
    truth = folder / "truth.json"
    command = [*BASE, "emulate", "--scenario", scenario, "--link", address, "--truth", truth, "--faults-from-stdin"]
    with running(Program(command, stdin=subprocess.PIPE)) as program:
        yield LiveObject(program, truth)
