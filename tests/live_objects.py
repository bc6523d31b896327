"""The emulator as a process whose faults are typed in while it runs."""

import json
import subprocess
from contextlib import contextmanager

from tests.command_line import BASE, environment, wait_for, wait_for_line


class LiveObject:
    """A running emulator."""

    def __init__(self, process, truth_path):
        self.process = process
        self._truth_path = truth_path
        self.link = wait_for_line(process, "ready: ")[-1].split("ready: ")[1].strip()

    def fault(self, command):
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()

    def truth(self):
        """What it says so far; written anew every 2 s at most."""
        return json.loads(self._truth_path.read_text())

    def wait_for_fault(self, kind):
        wait_for(lambda: self.truth()["fault_counts"].get(kind), within_s=90.0, what=f"fault {kind}")

    def stop(self):
        self.process.terminate()
        assert self.process.wait(10) == 0
        return self.truth()


@contextmanager
def live_object(folder, scenario, address):
    """Start an emulator that takes faults."""
    truth = folder / "truth.json"
    command = [*BASE, "emulate", "--scenario", str(scenario), "--link", address, "--truth", str(truth)]
    process = subprocess.Popen(
        [*command, "--faults-from-stdin"],
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield LiveObject(process, truth)
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()
