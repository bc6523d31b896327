"""One capture from open link to closed recording.

The order of things for every chunk: record it, decode it, answer it, look for cycles, show it. The reading thread only
reads; drawing has a process of its own; everything else happens here, in the thread that calls :meth:`Capture.run`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from analysis.scoring.recorded_parts import LiveClock
from host.capture.conversation import Conversation, Ending
from host.capture.goal import Goal
from host.capture.guide import Guide
from host.capture.notes import Notes
from host.capture.operator_desk import OperatorDesk
from host.capture.settings import CaptureSettings
from host.capture.snapshot import Snapshots
from host.errors import HostError
from host.links.transport import AnyChunk, Transport
from host.recording import format as fmt
from host.recording.views import add_views
from host.recording.writer import RecordingWriter
from host.screen.screens import Screen
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
        self._screen = screen
        self._stop = stop
        self._now_ns = now_ns
        self._guide = None if settings.guide is None else Guide(settings.guide)
        self._goal = Goal(settings, trial, self._guide)
        self._link = Conversation(transport, recording, trial, settings, now_ns)
        self._notes = Notes(recording, screen, now_ns)
        self._desk = OperatorDesk(trial, self._add_action, self._link.mark)
        target = TargetView(settings.cycles, settings.duration_s, settings.until_half_width_deg)
        self._snapshots = Snapshots(trial, self._desk, "rotdrift capture", target, self._guide)
        self._state = TrialState()
        self._published_ns = 0

    def run(self) -> CaptureOutcome:
        """Capture until the end; closes link and recording whatever happens."""
        link = self._link
        link.reader.start()
        try:
            reason, error = self._until_end()
            while not link.stopped():  # the object may still have something to send
                self._turn()
        finally:
            link.reader.stop()
            for chunk in link.reader.take(0):
                self._process(chunk)
            self._record(self._trial.finish(), link.chunk_ns)
            self._recording.close(self._notes.warn)
        return CaptureOutcome(
            reason=reason,
            error=error or link.reader.error,
            warnings=tuple(self._notes.warnings),
            unwritten=self._recording.unwritten,
            elapsed_s=link.elapsed_s(link.sample_ns),
            last_state=self._state,
            clock=self._trial.clock_values(),
        )

    def _until_end(self) -> Ending:
        while True:
            self._turn()
            now_ns = self._link.time_ns
            if now_ns - self._published_ns >= STATE_NS:
                self._publish(now_ns)
            if self._stop.is_set() or self._desk.finished:
                return "stopped by the operator", None
            ending = self._link.broken()
            if ending is None and (reached := self._goal.reached(now_ns, self._link.elapsed_s(now_ns))):
                ending = reached, None
            ending = ending or self._link.silence()
            if ending is not None:
                return ending

    def _turn(self) -> None:
        """Process what came, send what is due, flush."""
        for chunk in self._link.reader.take(LOOP_S):
            self._process(chunk)
        for action in self._screen.actions():
            self._desk.process(action)
            self._published_ns = 0  # whoever pressed a key wants to see what it did
        self._link.send_due()
        now_ns = self._now_ns()
        self._recording.flush_if_due(now_ns)
        self._notes.watch_disk(now_ns)
        self._notes.warn_once(self._link.warnings)

    def _process(self, chunk: AnyChunk) -> None:
        self._recording.add_received(chunk)  # first of all: what follows may fail, and it is not lost
        if not chunk.data:
            away_s = (chunk.host_time_ns - self._link.chunk_ns) / 1e9
            self._notes.warn(f"the link was lost and is open again; nothing came for {away_s:.1f} s")
        self._record(self._link.process(chunk), chunk.host_time_ns)

    def _record(self, update: TrialUpdate, host_time_ns: int) -> None:
        add_views(self._recording, update, host_time_ns)
        for row in update.cycles:
            self._screen.cycle(row)
            self._published_ns = 0

    def _add_action(self, action: OperatorAction) -> None:
        self._recording.add_values(fmt.ACTION, action.values(), self._now_ns())

    def _publish(self, now_ns: int) -> None:
        """Put the state together and show it; record a new step of the guide."""
        self._published_ns = now_ns
        link, notes, guide = self._link, self._notes, self._guide
        step = None if guide is None else guide.title
        warnings = tuple(notes.warnings[-3:])
        self._state = self._snapshots.at(
            now_ns, link.elapsed_s(now_ns), link.view, notes.recording, warnings, self._goal.enough
        )
        if guide is not None and guide.title != step:
            self._add_action(OperatorAction(GUIDE, self._trial.newest_s, guide.title))
            self._screen.report(f"guide: {guide.title}")
        self._screen.update(self._state)
