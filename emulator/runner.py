"""Runs a virtual object on a link: in real time, or in virtual time where the link has no live other end.

Real time keeps absolute deadlines: the loop sleeps in the link until the next sample is due or a command arrives, and
wakes at most once per ``GRANULARITY_S``. A run that falls behind (a busy machine, a suspended process) catches up at
once; what the link then cannot accept is dropped and counted by the object.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from emulator import EmulatorError
from emulator.faults.definitions import LiveFault
from emulator.injection import FaultInjector
from emulator.links import Link
from emulator.scenario import Scenario
from emulator.truth import write_truth
from emulator.virtual_object import VirtualObject

GRANULARITY_S = 0.0005
"""Samples leave at most this often, in groups if they are due more often."""
_LOOK_UP_S = 0.05
_RETRY_S = 0.004
_VIRTUAL_STEP_S = 0.05
_TRUTH_EVERY_S = 2.0
_VIRTUAL_LIMIT_S = 7 * 86_400.0


def run(
    scenario: Scenario,
    link: Link,
    duration_s: float | None = None,
    truth_path: str | Path | None = None,
    stop: threading.Event | None = None,
    on_ready: Callable[[str], None] | None = None,
    *,
    seed: int | None = None,
    live_faults: SimpleQueue[LiveFault] | None = None,
) -> dict[str, Any]:
    """Run a virtual object until its time is over, ``stop`` is set, or Ctrl-C; blocks.

    Parameters
    ----------
    scenario : Scenario
        What the object does.
    link : Link
        Where it is connected; opened here, closed at the end.
    duration_s : float, optional
        How long, s. None: until stopped, or in virtual time until the scenario is over.
    truth_path : str or Path, optional
        Where to write the truth: at the start, in real time while end points are passed, and at the end. Replaced if
        it exists.
    stop : Event, optional
        Ends the run within 50 ms.
    on_ready : callable
        Called once with the link as the host names it, when the object can be reached.
    seed : int, optional
        In place of the scenario's.
    live_faults : SimpleQueue of LiveFault, optional
        Faults put here happen at once, whatever their ``at_s``; see
        :func:`emulator.faults.definitions.parse_fault_command`.

    Returns
    -------
    dict
        The truth at the end.

    Raises
    ------
    LinkError
        The link cannot be opened.
    EmulatorError
        The truth cannot be written, or a run in virtual time would never end.
    """
    stop = stop or threading.Event()
    virtual_object = VirtualObject(scenario, seed)
    with link:
        injector = FaultInjector(virtual_object, link)
        truth = _TruthFile(virtual_object, injector, None if truth_path is None else Path(truth_path))
        truth.write(0.0)
        if on_ready is not None:
            on_ready(link.host_uri)
        bench = _Bench(virtual_object, injector, link, truth, stop, live_faults)
        with contextlib.suppress(KeyboardInterrupt):  # the ordinary way to end a run without a duration
            (bench.virtual_time if link.virtual_time else bench.real_time)(duration_s)
        end_s = bench.now_s
    return truth.write(end_s, complete=True)


class _TruthFile:
    """The truth, and the file it is kept in."""

    def __init__(self, virtual_object: VirtualObject, injector: FaultInjector, path: Path | None) -> None:
        self._object, self._injector, self._path = virtual_object, injector, path
        self._next_s = 0.0
        self._written: tuple[int, int] = (-1, -1)

    @property
    def _news(self) -> tuple[int, int]:
        return self._object.endpoints_met, self._injector.log.counts.total()

    def write(self, now_s: float, *, complete: bool = False) -> dict[str, Any]:
        started = time.monotonic()
        document = {**self._object.truth(), "complete": complete, "duration_s": now_s, **self._injector.truth()}
        if self._path is not None:
            try:
                write_truth(self._path, document)
            except OSError as error:
                raise EmulatorError(f"cannot write the truth to {self._path}: {error.strerror}") from error
        # Writing the truth of a long run is slow: never more than a twentieth of the time.
        self._next_s = now_s + max(_TRUTH_EVERY_S, 20.0 * (time.monotonic() - started))
        self._written = self._news
        return document

    def refresh(self, now_s: float) -> None:
        if self._path is not None and now_s >= self._next_s and self._news != self._written:
            self.write(now_s)


@dataclass
class _Bench:
    """A run under way."""

    virtual_object: VirtualObject
    injector: FaultInjector
    link: Link
    truth: _TruthFile
    stop: threading.Event
    live_faults: SimpleQueue[LiveFault] | None
    now_s: float = 0.0

    def _inject_live_faults(self) -> None:
        while self.live_faults is not None:
            try:
                self.injector.inject(self.live_faults.get_nowait())
            except Empty:
                return

    def real_time(self, duration_s: float | None) -> None:
        end_s = float("inf") if duration_s is None else duration_s
        started = time.monotonic()
        while not self.stop.is_set() and self.now_s < end_s:
            self._read_clock(started, end_s)
            self._inject_live_faults()
            self.injector.step(self.now_s)
            commands = self.injector.collect()
            if commands:
                # The clock is read again: a command must not seem to be received before it was sent.
                self._read_clock(started, end_s)
                self.injector.step(self.now_s)
                self.injector.obey(commands, self.now_s)
                self.injector.step(self.now_s)
            self.truth.refresh(self.now_s)
            self.virtual_object.firmware.prepare()
            longest_s = _RETRY_S if self.injector.backlog else _LOOK_UP_S
            wake_s = min(max(self.injector.next_due_s, self.now_s + GRANULARITY_S), self.now_s + longest_s, end_s)
            self.link.wait(wake_s - (time.monotonic() - started))

    def _read_clock(self, started: float, end_s: float) -> None:
        self.now_s = min(time.monotonic() - started, end_s)

    def virtual_time(self, duration_s: float | None) -> None:
        steps = 0
        while not self.stop.is_set():
            self._inject_live_faults()
            self.injector.receive(self.now_s)
            end_s = self.virtual_object.end_s if duration_s is None else duration_s
            if end_s > _VIRTUAL_LIMIT_S:
                raise EmulatorError("a run in virtual time needs a hand that starts, or a duration of at most 7 days")
            steps += 1
            self.now_s = min(steps * _VIRTUAL_STEP_S, end_s)
            self.injector.step(self.now_s)
            if self.now_s >= end_s:
                return
