"""The emulator as a second process: a device for the demo and for tests."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any, Self

from host.errors import LinkError
from host.text import plain

READY_S = 30.0
STOP_S = 20.0


class VirtualObjectProcess:
    """A virtual object in a process of its own, on a pty (on Windows, which has none, on a TCP port).

    Entering waits until it can be reached. It has a process group of its own, so that Ctrl-C reaches only us and a
    capture can end in order before its object does. It ends when its input ends, so also when we are killed. The
    scenario is a name or a file.
    """

    def __init__(self, scenario: str) -> None:
        self._scenario = scenario
        self._folder = tempfile.TemporaryDirectory(prefix="rotdrift-")
        self._truth_path = Path(self._folder.name) / "truth.json"
        self.link = ""
        """The link to the object, once entered."""

    def __enter__(self) -> Self:
        address = "tcp:0" if sys.platform == "win32" else f"pty:{Path(self._folder.name) / 'object'}"
        command = [sys.executable, "-P", "-m", "rotdrift", "emulate", "--scenario", self._scenario]
        command += ["--link", address, "--truth", str(self._truth_path), "--until-stdin-ends"]
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # Windows, which has no sessions
        )
        try:
            self.link = self._wait_ready()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._folder.cleanup()

    def stop(self) -> dict[str, Any]:
        """End the object and return its account of what really happened; empty if it could not write one."""
        try:
            self._process.communicate(timeout=STOP_S)  # closes its input
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
        try:
            truth: dict[str, Any] = json.loads(self._truth_path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return truth

    def _wait_ready(self) -> str:
        """Return the link that the object prints once it can be reached."""
        assert self._process.stdout is not None
        too_late = threading.Timer(READY_S, self._process.kill)
        too_late.start()
        try:
            line = self._process.stdout.readline().strip()
        finally:
            too_late.cancel()
        if line.startswith("ready: "):
            return line.removeprefix("ready: ")
        self._process.kill()
        _, printed = self._process.communicate()
        reason = plain(printed, 300).removeprefix("rotdrift: ") or "it printed nothing"
        raise LinkError(f"the virtual object did not start ({reason})", "try another --scenario")
