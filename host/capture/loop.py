"""One capture from open link to closed recording.

The order of things for every chunk: record it, decode it, answer it, look for cycles, show it. The reading thread only
reads; drawing has a process of its own; everything else happens here, in the thread that calls :meth:`Capture.run`.

A view never ends what it watches: screen, alarms, guide and what the trial shows are guarded, and go on or not one by
one. Where recording or decoding itself fails, the capture ends in order, and what is received is only recorded.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace

from analysis.scoring.recorded_parts import LiveClock
from host.capture.conversation import Conversation, Ending
from host.capture.goal import Goal
from host.capture.guide import TITLES, Guide
from host.capture.notes import Notes
from host.capture.operator_desk import OperatorDesk
from host.capture.settings import CaptureSettings
from host.capture.snapshot import Snapshots
from host.errors import HostError, InternalError
from host.links.transport import AnyChunk, Transport
from host.recording import format as fmt
from host.recording.views import add_views
from host.recording.writer import RecordingWriter
from host.screen.guarded_screen import guarded
from host.screen.keys import ScreenAction
from host.screen.screens import Screen
from host.trial.guarded import Guarded, cause
from host.trial.live import Trial, TrialUpdate
from host.trial.operator import GUIDE, OperatorAction
from host.trial.state import TargetView, TrialState

LOOP_S = 0.02
"""Longest wait for a chunk: how late a timeout or a flush may be."""
STATE_NS = 200_000_000
"""Between two states for the screen, where nothing happens that a person waits for: as often as it is drawn."""


@dataclass(frozen=True, slots=True)
class CaptureOutcome:
    """How a capture ended."""

    reason: str
    """In words."""
    error: HostError | None
    """What went wrong; None when it ended as asked."""
    warnings: tuple[str, ...]
    unwritten: bytes
    """Records that did not get to the disk; they continue the recording."""
    elapsed_s: float
    """From the first sample to the last."""
    clock: LiveClock | None
    """The live estimate of the object's clock at the end; the result's own is made from the recording."""
    last_state: TrialState
    """What the screen showed last."""


class Capture:
    """Captures one object, until the settings, an error or ``stop`` end it.

    The open transport is the capture's: its reading thread closes it; the new recording is closed at the end as well.
    ``now_ns`` is the monotonic clock that stamps chunks.
    """

    def __init__(
        self,
        transport: Transport,
        recording: RecordingWriter,
        trial: Trial,
        screen: Screen,
        settings: CaptureSettings,
        stop: threading.Event,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._recording = recording
        self._trial = trial
        self._screen = guarded(screen)
        self._stop = stop
        self._now_ns = now_ns
        failures, guide = trial.failures, None
        if settings.guide is not None:
            without = "the trial ends after its cycles, or by hand"
            guide = Guarded("the guide", Guide(settings.guide), failures, without)
        goal = Goal(settings, trial, guide)
        self._goal = Guarded("the watch on cycles and time", goal, failures, "end the capture by hand")
        self._link = Conversation(transport, recording, trial, settings, now_ns)
        self._notes = Notes(recording, self._screen, now_ns)
        desk = OperatorDesk(trial, self._add_action, self._link.mark)
        self._desk = Guarded("the operator's desk", desk, failures, "of the keys, only the one that ends works")
        target = TargetView(settings.cycles, settings.duration_s, settings.until_half_width_deg)
        snapshots, without = Snapshots(trial, desk, "rotdrift capture", target, guide), "end a guided trial by hand"
        self._snapshots = Guarded("the live view", snapshots, failures, f"the picture stands still, {without}")
        self._state = TrialState()
        self._published_ns = 0
        self._ending: Ending | None = None
        self._failure: BaseException | None = None  # the first one, of what is not guarded

    def run(self) -> CaptureOutcome:
        """Capture until the end; stops the object and closes link and recording whatever happens."""
        link = self._link
        at_end = self._stop_object, self._insist, link.reader.stop, self._take_rest, self._finish, self._close
        with ExitStack() as steps:  # each is taken, whatever became of those before it, and again where it failed
            steps.callback(self._recording.close)  # Ctrl-C as it is being closed
            for step in reversed(at_end):
                steps.callback(self._attempt, step, tries=2)
            self._attempt(self._until_end)
        clock, failures = self._trial.clock_values(), self._trial.failures
        kept = Guarded("what is only in memory", self._recording, failures, "the score is of what is on the disk")
        unwritten = kept.ask(lambda recording: recording.unwritten, b"")
        self._notes.warn_once(failures)
        reason, error = self._ending or ("the capture failed", None)
        if isinstance(self._failure, HostError):
            error = error or self._failure
        elif self._failure is not None:
            error = error or InternalError(self._failure)
        return CaptureOutcome(
            reason=reason,
            error=error or link.reader.error,
            warnings=tuple(self._notes.warnings),
            unwritten=unwritten,
            elapsed_s=link.elapsed_s(link.sample_ns),
            last_state=self._state,
            clock=clock,
        )

    def _attempt(self, step: Callable[[], object], tries: int = 1) -> None:
        """Take a step towards the end; keep what it raises, for the steps after it are to be taken as well."""
        for _ in range(tries):
            try:
                step()
                return
            except BaseException as error:
                self._failure = self._failure or error
                if not isinstance(error, Exception):  # Ctrl-C: it passes on once everything is closed
                    raise

    def _until_end(self) -> None:
        link = self._link
        link.reader.start()
        while self._ending is None and self._failure is None:
            self._turn()
            now_ns = link.time_ns
            if now_ns - self._published_ns >= STATE_NS:
                self._publish(now_ns)
            self._ending = self._ending or self._judge(now_ns)

    def _judge(self, now_ns: int) -> Ending | None:
        """Return why the capture ends now; None while it goes on."""
        link, elapsed_s = self._link, self._link.elapsed_s(now_ns)
        if self._stop.is_set():
            return "stopped by the operator", None
        ending = link.broken()
        if ending is None and (reached := self._goal.ask(lambda goal: goal.reached(now_ns, elapsed_s), "")):
            ending = reached, None
        return ending or link.silence()

    def _stop_object(self) -> None:
        while not self._link.stopped():  # the object may still have something to send
            self._turn()

    def _insist(self) -> None:
        """After a failure, have the object stop even if that was the session's, or the recording's."""
        if self._failure is not None:
            self._link.send_stop()

    def _take_rest(self) -> None:
        self._process_all(self._link.reader.take(0))

    def _finish(self) -> None:
        """Process what the link still holds, and report what failed meanwhile."""
        if self._failure is None:
            self._record(self._trial.finish(), self._link.chunk_ns)
        else:
            self._notes.warn(f"the capture failed ({cause(self._failure)}): what came after that is only recorded")
        self._notes.warn_once((*self._link.warnings, *self._screen.problems))

    def _close(self) -> None:
        self._recording.close(self._notes.warn)

    def _turn(self) -> None:
        """Process what came, send what is due, flush."""
        self._process_all(self._link.reader.take(LOOP_S))
        for action in self._screen.actions():
            self._process_key(action)
        self._link.send_due()
        now_ns = self._now_ns()
        self._recording.flush_if_due(now_ns)
        self._notes.watch_disk(now_ns)
        self._notes.warn_once((*self._link.warnings, *self._screen.problems))

    def _process_key(self, action: ScreenAction) -> None:
        if action.kind == "finish":  # not the desk's alone: it works whatever failed
            self._ending = self._ending or ("stopped by the operator", None)
        self._desk.ask(lambda desk: desk.process(action), None)
        self._published_ns = 0  # whoever pressed a key wants to see what it did

    def _process_all(self, chunks: list[AnyChunk]) -> None:
        waiting = deque(chunks)
        try:
            while waiting:
                self._process(waiting.popleft())
        finally:
            for chunk in waiting:  # where one of them failed
                self._recording.add_received(chunk)

    def _process(self, chunk: AnyChunk) -> None:
        self._recording.add_received(chunk)  # first of all: what follows may fail, and it is not lost
        if self._failure is not None:
            return
        if chunk.reopened:
            away_s = (chunk.host_time_ns - self._link.chunk_ns) / 1e9
            self._notes.warn(f"the link was lost and is open again; nothing came for {away_s:.1f} s")
        self._record(self._link.process(chunk), chunk.host_time_ns)

    def _record(self, update: TrialUpdate, host_time_ns: int) -> None:
        add_views(self._recording, update, host_time_ns)
        for row in update.cycles:
            self._screen.cycle(row)
            self._published_ns = 0

    def _add_action(self, action: OperatorAction) -> None:
        values, now_ns = action.values(), self._now_ns()
        # A failure to record is not the operator's desk's, which calls this.
        self._attempt(lambda: self._recording.add_values(fmt.ACTION, values, now_ns))

    def _publish(self, now_ns: int) -> None:
        """Put the state together and show it; record a new step of the guide."""
        self._published_ns = now_ns
        link, notes, before = self._link, self._notes, self._state.guide
        elapsed_s, warnings = link.elapsed_s(now_ns), tuple(notes.warnings[-3:])
        enough = self._goal.ask(lambda goal: goal.enough, False)
        self._state = self._snapshots.ask(
            lambda snapshots: snapshots.at(now_ns, elapsed_s, link.view, notes.recording, warnings, enough),
            replace(self._state, warnings=warnings),
        )
        step = self._state.guide
        if step is not None and step.title != (TITLES[0] if before is None else before.title):
            self._add_action(OperatorAction(GUIDE, self._trial.newest_s, step.title))
            self._screen.report(f"guide: {step.title}")
        self._screen.update(self._state)
