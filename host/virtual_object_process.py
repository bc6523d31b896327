"""The emulator as a second process: a device for the demo and for tests."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from host.errors import LinkError
from host.text import plain

READY_S = 30.0
STOP_S = 20.0


class VirtualObjectProcess:
    """A virtual object in a process of its own, on a pty (on Windows, which has none, on a TCP port).

    Entering waits until it can be reached. It has a process group of its own, so that Ctrl-C reaches only us and a
    capture can end in order before its object does. It ends when its input ends, so also when we are killed.

    Parameters
    ----------
    scenario : str
        Name or file.
    seed : int, optional
        Replaces the scenario's.
    """

    def __init__(self, scenario: str, seed: int | None = None) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="rotdrift-")
        self._truth_path = Path(self._folder.name) / "truth.json"
        address = "tcp:0" if sys.platform == "win32" else f"pty:{Path(self._folder.name) / 'object'}"
        self._command = [sys.executable, "-P", "-m", "rotdrift", "emulate", "--scenario", scenario]
        self._command += ["--link", address, "--truth", str(self._truth_path), "--until-stdin-ends"]
        if seed is not None:
            self._command += ["--seed", str(seed)]
        self._process: subprocess.Popen[str] | None = None
        self.link = ""
        """The link to the object, once entered."""

    def __enter__(self) -> Self:
        new_group = {"start_new_session": True}
        if sys.platform == "win32":
            new_group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
        self._process = subprocess.Popen(  # noqa: S603 - our own program
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            **new_group,  # type: ignore[call-overload]
        )
        try:
            self.link = self._wait_ready()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def stop(self) -> dict[str, Any]:
        """End the object and return its account of what really happened; empty if it could not write one."""
        self._end_process()
        try:
            truth: dict[str, Any] = json.loads(self._truth_path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return truth

    def close(self) -> None:
        """End the object and remove its files."""
        self._end_process()
        self._folder.cleanup()

    def _wait_ready(self) -> str:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        assert process.stderr is not None
        lines: list[str] = []
        stdout = process.stdout
        reading = threading.Thread(target=lambda: lines.append(stdout.readline()), daemon=True)
        reading.start()
        reading.join(READY_S)
        line = lines[0].strip() if lines else ""
        if line.startswith("ready: "):
            return line.removeprefix("ready: ")
        process.kill()
        process.wait()
        reason = plain(process.stderr.read(), 300).removeprefix("rotdrift: ")
        reason = reason or "it printed nothing"
        raise LinkError(f"the virtual object did not start ({reason})", "try another --scenario")

    def _end_process(self) -> None:
        process = self._process
        if process is None:
            return
        assert process.stdin is not None
        process.stdin.close()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for stream in (process.stdout, process.stderr):
            if stream is not None:
                stream.close()
