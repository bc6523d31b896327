"""One capture from open link to closed recording.

The order of things for every chunk: record it, decode it, answer it, look for cycles, show it. The reading thread only
reads; drawing has a process of its own; everything else happens here, in the thread that calls :meth:`Capture.run`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from host.capture.conversation import Conversation
from host.capture.goal import Goal
from host.capture.notes import Notes
from host.capture.operator_desk import OperatorDesk
from host.capture.settings import CaptureSettings
from host.capture.snapshot import Snapshots
from host.errors import HostError, LinkError, WrongObjectError
from host.links.transport import AnyChunk, Transport
from host.recording import format as fmt
from host.recording.views import add_views
from host.recording.writer import RecordingWriter
from host.screen.screens import Screen
from host.trial.live import Trial, TrialUpdate
from host.trial.operator import GUIDE, OperatorAction
from host.trial.state import TrialState

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
    n_chunks: int
    """Chunks received; 0 means that there is nothing to score."""
    unwritten: bytes
    """Records the disk did not take; they continue the recording."""
    elapsed_s: float
    """From the first sample to the end."""
    clock: dict[str, Any] | None = None
    """The live estimate of the object's clock at the end; the result's own is made from the recording."""
    last_state: TrialState = field(default_factory=TrialState)
    """What the screen showed last."""


@dataclass(slots=True)
class _Heard:
    """When the object was heard, monotonic, ns."""

    chunk_ns: int
    """Last chunk; the start of the capture before it."""
    sample_ns: int
    """Last sample; the start of the capture before it."""
    quiet_since_ns: int
    """Last sample, or since when the link is open again."""
    first_sample_ns: int | None = None
    n_chunks: int = 0

    def since_first_ns(self, now_ns: int) -> int | None:
        """Return the time since the first sample, ns; None before it."""
        return None if self.first_sample_ns is None else now_ns - self.first_sample_ns


class Capture:
    """Captures one object.

    Parameters
    ----------
    transport : Transport
        Open; closed by the reading thread.
    recording : RecordingWriter
        New; closed at the end.
    trial : Trial
        Finds cycles.
    screen : Screen
        Who watches.
    settings : CaptureSettings
        When to end.
    stop : threading.Event
        Set by whoever wants it to end.
    now_ns : callable
        Monotonic clock, the one that stamps chunks.
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
        self._silence_limit_s = settings.silence_limit_s
        self._link = Conversation(transport, recording, settings.session, settings.read_pause_s, now_ns)
        self._notes = Notes(recording, screen, now_ns)
        self._goal = Goal(settings, trial)
        self._desk = OperatorDesk(trial, self._add_action, self._link.mark)
        self._snapshots = Snapshots(trial, self._desk, "rotdrift capture", settings.target, self._goal.guide)
        start_ns = now_ns()
        self._heard = _Heard(start_ns, start_ns, start_ns)
        self._error: HostError | None = None
        self._state = TrialState()
        self._published_ns = 0

    def run(self) -> CaptureOutcome:
        """Capture until the end; closes link and recording whatever happens."""
        self._link.start()
        try:
            reason = self._until_end()
            self._link.say_goodbye()
            while not self._link.is_over:  # the object may still have something to send
                self._turn()
        finally:
            for chunk in self._link.close():
                self._process(chunk)
            self._record(self._trial.finish(), self._heard.chunk_ns)
            self._error = self._error or self._link.link_error
            self._recording.close(self._notes.warn)
        heard = self._heard
        return CaptureOutcome(
            reason=reason,
            error=self._error,
            warnings=self._notes.warnings,
            n_chunks=heard.n_chunks,
            unwritten=self._recording.unwritten,
            elapsed_s=(heard.since_first_ns(heard.sample_ns) or 0) / 1e9,
            last_state=self._state,
            clock=self._trial.clock_values(),
        )

    def _until_end(self) -> str:
        while True:
            self._turn()
            # A recording that is captured again has its own time, of another day perhaps.
            now_ns = self._now_ns() if self._link.is_live else self._heard.chunk_ns
            if now_ns - self._published_ns >= STATE_NS:
                self._publish(now_ns)
            reason = self._end_reason(now_ns)
            if reason is not None:
                return reason

    def _turn(self) -> None:
        """Process what came, send what is due, flush."""
        for chunk in self._link.receive(LOOP_S):
            self._process(chunk)
        for action in self._screen.actions():
            self._desk.process(action)
            self._published_ns = 0  # whoever pressed a key wants to see what it did
        self._link.send_due()
        now_ns = self._now_ns()
        self._recording.flush_if_due(now_ns)
        self._notes.watch_disk(now_ns)
        self._notes.warn_once((*self._link.warnings, *self._trial.problems))

    def _process(self, chunk: AnyChunk) -> None:
        self._recording.add_received(chunk)  # first of all, so that no fault further on can lose it
        heard, at_ns = self._heard, chunk.host_time_ns
        heard.n_chunks += 1
        if not chunk.data:  # the link was lost and opened again: the same recording and trial, a new handshake
            away_s = (at_ns - heard.chunk_ns) / 1e9
            self._notes.warn(f"the link was lost and is open again; nothing came for {away_s:.1f} s")
            self._link.reopened(at_ns)
            heard.quiet_since_ns = at_ns
        heard.chunk_ns = at_ns
        update = self._trial.feed(chunk)
        self._trial.feed_round_trips(self._link.process(update, chunk))
        self._link.doubt(self._trial.problems, ask=self._trial.assembler.doubtful)
        self._record(update, at_ns)
        if update.decoded:
            heard.sample_ns = heard.quiet_since_ns = at_ns
            if heard.first_sample_ns is None:
                heard.first_sample_ns = at_ns

    def _record(self, update: TrialUpdate, host_time_ns: int) -> None:
        add_views(self._recording, update, host_time_ns)
        for row in update.cycles:
            self._screen.cycle(row)
            self._published_ns = 0

    def _add_action(self, action: OperatorAction) -> None:
        self._recording.add_values(fmt.ACTION, action.values(), self._now_ns())

    def _publish(self, now_ns: int) -> None:
        self._published_ns = now_ns
        guide = self._goal.guide
        step = None if guide is None else guide.title
        self._state = self._snapshots.at(
            now_ns,
            (self._heard.since_first_ns(now_ns) or 0) / 1e9,
            self._link.view,
            self._notes.recording,
            self._notes.warnings[-3:],
            self._goal.enough,
        )
        if guide is not None and guide.title != step:
            self._add_action(OperatorAction(GUIDE, self._trial.newest_s, guide.title))
            self._screen.report(f"guide: {guide.title}")
        self._screen.update(self._state)

    def _end_reason(self, now_ns: int) -> str | None:
        """Return in words why the capture ends now, and keep what went wrong; None while it goes on."""
        if self._stop.is_set() or self._desk.finished:
            return "stopped by the operator"
        heard = self._heard
        if self._link.ended:
            self._error = self._link.link_error
            return "the recording is over" if self._error is None else "the link was lost"
        if self._link.error is not None:
            self._error = self._link.error
            if heard.first_sample_ns is None:
                return "the object cannot be captured"
            return "another object answers" if isinstance(self._error, WrongObjectError) else "the link was lost"
        reason = self._goal.reached(now_ns, heard.since_first_ns(now_ns))
        if reason is not None:
            return reason
        # A recording ends by itself, whatever pauses it has; a link that is away has its own limit.
        may_be_silent = not self._link.is_live or not self._link.connected
        if may_be_silent or now_ns - heard.quiet_since_ns < self._silence_limit_s * 1e9:
            return None
        before = "what came before is recorded" if heard.first_sample_ns is not None else "nothing came at all"
        self._error = LinkError(
            f"the object has sent no samples for {self._silence_limit_s:.0f} s",
            f"check its battery and cable; {before}",
        )
        return "the object fell silent"
