"""Runs a virtual object on a link: in real time, or in virtual time where the link has no live other end.

Real time keeps absolute deadlines: the loop sleeps in the link until the next sample is due or a command arrives, and
wakes at most once per ``GRANULARITY_S``. A run that falls behind (a busy machine, a suspended process) catches up at
once; what the link then cannot take is dropped and counted by the object.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from emulator import EmulatorError, ScenarioError
from emulator.links import Link
from emulator.scenario import Scenario
from emulator.truth import write_truth
from emulator.virtual_object import VirtualObject

__all__ = ["GRANULARITY_S", "RunResult", "VirtualObject", "run"]

GRANULARITY_S = 0.0005
"""Samples leave at most this often, in groups if they are due more often."""
_LOOK_UP_S = 0.05
_RETRY_S = 0.004
_VIRTUAL_STEP_S = 0.05
_TRUTH_EVERY_S = 2.0
_VIRTUAL_LIMIT_S = 7 * 86_400.0


@dataclass(frozen=True)
class RunResult:
    """What a run came to."""

    duration_s: float
    """How long the object was powered, in its own world's true time, s."""
    truth: dict[str, Any]
    """The truth at the end."""


def run(
    scenario: Scenario,
    link: Link,
    duration_s: float | None = None,
    truth_path: str | Path | None = None,
    stop: threading.Event | None = None,
    on_ready: Callable[[str], None] | None = None,
    *,
    seed: int | None = None,
) -> RunResult:
    """Run a virtual object until its time is over, ``stop`` is set, or Ctrl-C; blocks.

    Parameters
    ----------
    scenario
        What the object does.
    link
        Where it is connected; opened here, closed at the end.
    duration_s
        How long, s. None: until stopped, or in virtual time until the scenario is over.
    truth_path
        Where to write the truth: at the start, while end points are passed, and at the end. Replaced if it exists.
    stop
        Ends the run within 50 ms.
    on_ready
        Called once with the link as the host names it, when the object can be reached.
    seed
        In place of the scenario's.

    Returns
    -------
    RunResult

    Raises
    ------
    LinkError
        The link cannot be opened.
    EmulatorError
        The truth cannot be written, or a run in virtual time would never end.
    """
    stop = stop or threading.Event()
    run_object = VirtualObject(scenario, seed)
    truth = _TruthFile(run_object, None if truth_path is None else Path(truth_path))
    with link:
        truth.write(0.0)
        if on_ready is not None:
            on_ready(link.host_uri)
        loop = _virtual_time if link.virtual_time else _real_time
        end_s = loop(run_object, link, duration_s, stop, truth)
    document = truth.write(end_s, complete=True)
    return RunResult(end_s, document)


class _TruthFile:
    """The truth, and the file it is kept in."""

    def __init__(self, run_object: VirtualObject, path: Path | None) -> None:
        self._object, self._path = run_object, path
        self._next_s, self._endpoints_met = 0.0, -1

    def write(self, now_s: float, *, complete: bool = False) -> dict[str, Any]:
        document = {**self._object.truth(), "complete": complete, "duration_s": now_s}
        if self._path is not None:
            try:
                write_truth(self._path, document)
            except OSError as error:
                raise EmulatorError(f"cannot write the truth to {self._path}: {error.strerror}") from error
        self._next_s = now_s + _TRUTH_EVERY_S
        self._endpoints_met = self._object.endpoints_met
        return document

    def refresh(self, now_s: float) -> None:
        if self._path is not None and now_s >= self._next_s and self._object.endpoints_met != self._endpoints_met:
            self.write(now_s)


def _real_time(
    run_object: VirtualObject, link: Link, duration_s: float | None, stop: threading.Event, truth: _TruthFile
) -> float:
    end_s = float("inf") if duration_s is None else duration_s
    started = time.monotonic()
    now_s = 0.0
    try:
        while not stop.is_set() and now_s < end_s:
            now_s = min(time.monotonic() - started, end_s)
            run_object.step(now_s, link.send)
            commands = link.receive()
            if commands:
                for command in commands:
                    run_object.receive(command, now_s)
                run_object.step(now_s, link.send)
            truth.refresh(now_s)
            run_object.firmware.prepare()
            longest_s = _RETRY_S if run_object.firmware.backlog else _LOOK_UP_S
            wake_s = min(max(run_object.next_due_s, now_s + GRANULARITY_S), now_s + longest_s, end_s)
            link.wait(wake_s - (time.monotonic() - started))
    except KeyboardInterrupt:
        pass  # Ctrl-C is the ordinary way to end a run without a duration
    return now_s


def _virtual_time(
    run_object: VirtualObject, link: Link, duration_s: float | None, stop: threading.Event, truth: _TruthFile
) -> float:
    now_s = 0.0
    step = 0
    try:
        while not stop.is_set():
            for command in link.receive():
                run_object.receive(command, now_s)
            end_s = run_object.end_s if duration_s is None else duration_s
            if end_s > _VIRTUAL_LIMIT_S:
                raise ScenarioError(
                    "in virtual time a run without a hand that starts needs a duration of at most 7 days"
                )
            step += 1
            now_s = min(step * _VIRTUAL_STEP_S, end_s)
            run_object.step(now_s, link.send)
            if now_s >= end_s:
                break
            truth.refresh(now_s)
    except KeyboardInterrupt:
        pass
    return now_s
