"""One capture from open link to closed recording.

The order of things for every chunk: record it, decode it, answer it, look for cycles, show it. The reading thread only
reads; drawing has a thread of its own; everything else happens here, in the thread that calls :meth:`Capture.run`.
"""

from __future__ import annotations

import re
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from host.capture.alarms import AlarmWatch
from host.capture.guide import Guide, GuideSettings
from host.capture.operator_desk import OperatorDesk
from host.errors import HostError, LinkError, LinkLostError, WrongObjectError
from host.links.reader_thread import ReaderThread
from host.links.transport import AnyChunk, Transport
from host.recording import format as fmt
from host.recording.views import add_views
from host.recording.writer import RecordingWriter
from host.screen.screens import Screen
from host.stream.session import Phase, Session, SessionSettings
from host.trial.live import Trial, TrialUpdate
from host.trial.operator import GUIDE, OperatorAction
from host.trial.state import LinkView, RecordingView, TrialState

LOOP_S = 0.02
"""Longest wait for a chunk: how late a timeout or a flush may be."""
STATE_NS = 200_000_000
"""Between two states for the screen, where nothing happens that a person waits for: as often as it is drawn."""
DISK_NS = 2_000_000_000


@dataclass(frozen=True, slots=True)
class CaptureSettings:
    """When a capture ends, and how it talks."""

    cycles: int | None = None
    """End after so many cycles."""
    duration_s: float | None = None
    """End so long after the first sample."""
    session: SessionSettings = SessionSettings()
    silence_limit_s: float = 30.0
    """End when the object sent nothing for so long."""
    reconnect_s: float = 30.0
    """How long a lost link may take to come back; 0 ends the capture at once."""
    debug_link: Path | None = None
    """File for everything that crosses the link, in hexadecimal; see :mod:`host.links.link_log`."""
    until_half_width_deg: float | None = None
    """End when the confidence interval of θ̄ is so narrow: half its width, deg."""
    guide: GuideSettings | None = None
    """Lead through the trial step by step; None for no guide."""
    read_pause_s: float = 0.0
    """Rest of a live link's reading thread, for other links; see :class:`host.links.reader_thread.ReaderThread`."""
    linger_periods: float = 0.35
    """How long to go on after the last cycle: the offline search wants to see the way back from it."""


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
        self._transport = transport
        self._recording = recording
        self._trial = trial
        self._screen = screen
        self._settings = settings
        self._stop = stop
        self._now_ns = now_ns
        self._reader = ReaderThread(transport, pause_s=settings.read_pause_s if transport.is_live else 0.0)
        self._session = (
            Session(settings.session, transport.name, now_ns(), transport.encode_command) if transport.is_live else None
        )
        if self._session is not None:
            trial.assembler.on_segment.append(self._session.new_segment)
        self._warnings: list[str] = []
        self._error: HostError | None = None
        self._n_chunks = 0
        self._told: set[str] = set()
        self._first_sample_ns: int | None = None
        self._last_sample_ns = self._last_chunk_ns = now_ns()
        self._silent_since_ns = self._last_sample_ns
        self._reached_ns: int | None = None
        self._told_ns = 0
        self._disk_ns = 0
        self._free_bytes: int | None = None
        self._problem: str | None = None
        self._desk = OperatorDesk(trial, self._add_action, None if self._session is None else self._session.mark)
        self._alarms = AlarmWatch()
        self._guide = None if settings.guide is None else Guide(settings.guide)
        self._state = TrialState()

    @property
    def _connected(self) -> bool:
        """Whether the link is there; one that cannot be lost and come back always is."""
        return bool(getattr(self._transport, "connected", True))

    def run(self) -> CaptureOutcome:
        """Capture until the end; closes link and recording whatever happens."""
        self._reader.start()
        try:
            reason = self._until_end()
            self._say_goodbye()
        finally:
            self._reader.stop()
            for chunk in self._reader.take(0):
                self._take(chunk)
            self._record(self._trial.finish(), self._last_chunk_ns)
            self._error = self._error or self._reader.error
            self._recording.close(self._warn)
        elapsed_ns = 0 if self._first_sample_ns is None else self._last_sample_ns - self._first_sample_ns
        return CaptureOutcome(
            reason=reason,
            error=self._error,
            warnings=tuple(self._warnings),
            n_chunks=self._n_chunks,
            unwritten=self._recording.unwritten,
            elapsed_s=elapsed_ns / 1e9,
            last_state=self._state,
            clock=self._trial.clock_values(),
        )

    def _until_end(self) -> str:
        while True:
            self._turn()
            # A recording that is captured again has its own time, of another day perhaps.
            now_ns = self._last_chunk_ns if self._session is None else self._now_ns()
            self._tell(now_ns)
            reason = self._end_reason(now_ns)
            if reason is not None:
                return reason

    def _turn(self) -> None:
        """Take what came, send what is due, flush."""
        for chunk in self._reader.take(LOOP_S):
            self._take(chunk)
        for action in self._screen.actions():
            self._desk.take(action)
            self._told_ns = 0  # whoever pressed a key wants to see what it did
        now_ns = self._now_ns()
        if self._session is not None and self._connected:  # nobody hears while the link is away
            for data in self._session.due(now_ns):
                self._send(data)
        self._recording.flush_if_due(now_ns)
        self._watch_disk(now_ns)
        told_by_session = () if self._session is None else self._session.warnings
        told_by_trial = (*self._trial.link.problems, *self._trial.assembler.problems)
        for sentence in (*told_by_session, *self._transport.problems, *told_by_trial):
            gist = re.sub(r"\d+", "#", sentence)  # a count that grows is no news
            if gist not in self._told:
                self._told.add(gist)
                self._warn(sentence)

    def _take(self, chunk: AnyChunk) -> None:
        self._n_chunks += 1
        self._recording.add_received(chunk)
        if not chunk.data:
            self._reopened(chunk.host_time_ns)
            self._silent_since_ns = chunk.host_time_ns
        self._last_chunk_ns = chunk.host_time_ns
        update = self._trial.feed(chunk)
        if self._session is not None:
            self._session.feed(update.items, len(chunk.data), chunk.host_time_ns)
            self._trial.feed_round_trips(self._session.take_round_trips())
            self._watch_who_sends(self._session)
        self._record(update, chunk.host_time_ns)
        if update.sampled:
            self._last_sample_ns = self._silent_since_ns = chunk.host_time_ns
            if self._first_sample_ns is None:
                self._first_sample_ns = chunk.host_time_ns

    def _watch_who_sends(self, session: Session) -> None:
        """Ask an object whose clock jumps who it is; give up where two send at once."""
        assembler = self._trial.assembler
        if assembler.doubtful:
            session.ask_who(self._now_ns())
        for problem in (*self._trial.link.problems, *assembler.problems):
            if session.error is None:
                session.error = WrongObjectError(
                    problem, "leave one object on the line; on CAN, give each a node id of its own"
                )

    def _reopened(self, now_ns: int) -> None:
        """Go on after the link was lost and opened again: the same recording, the same trial, a new handshake."""
        away_s = (now_ns - self._last_chunk_ns) / 1e9
        self._warn(f"the link was lost and is open again; nothing came for {away_s:.1f} s")
        if self._session is not None:
            self._session.reopened(now_ns)

    def _record(self, update: TrialUpdate, host_time_ns: int) -> None:
        add_views(self._recording, update, host_time_ns)
        for row in update.cycles:
            self._screen.cycle(row)
            self._told_ns = 0

    def _send(self, data: bytes) -> None:
        try:
            self._recording.add_sent(data, self._now_ns())
            self._transport.write(data)
        except LinkLostError as error:
            # What it still delivers is read to the end: the reading thread says when it is over.
            if self._session is not None and self._session.error is None:
                self._session.error = error

    def _add_action(self, action: OperatorAction) -> None:
        self._recording.add_values(fmt.ACTION, action.values(), self._now_ns())

    def _warn(self, sentence: str) -> None:
        self._warnings.append(sentence)
        self._recording.add_note("warning", sentence, self._now_ns())
        self._screen.say(f"note: {sentence}")

    def _watch_disk(self, now_ns: int) -> None:
        problem = self._recording.problem
        if (problem is None) != (self._problem is None):
            self._warn(problem if problem is not None else "the recording is on disk again")
        self._problem = problem
        if now_ns - self._disk_ns >= DISK_NS:
            self._disk_ns = now_ns
            try:
                self._free_bytes = shutil.disk_usage(self._recording.path.parent).free
            except OSError:
                self._free_bytes = None

    def _tell(self, now_ns: int) -> None:
        if now_ns - self._told_ns < STATE_NS:
            return
        self._told_ns = now_ns
        session = self._session
        link = LinkView(
            name=self._transport.name,
            connected=not self._reader.ended and self._connected,
            one_way=session is not None and session.one_way,
            expected_rate_hz=None if session is None else session.expected_rate_hz,
            overflow_chunks=self._reader.overflow_chunks,
        )
        elapsed_s = 0.0 if self._first_sample_ns is None else (now_ns - self._first_sample_ns) / 1e9
        state = self._trial.state(now_ns, elapsed_s, link, tuple(self._warnings[-3:]))
        recording = RecordingView(
            str(self._recording.path), self._recording.n_bytes, self._recording.problem, self._free_bytes
        )
        state = replace(state, recording=recording, marks=self._desk.marks)
        state = replace(state, alarms=self._alarms.update(state))
        if self._guide is not None:
            title = self._guide.title
            state = replace(state, guide=self._guide.update(state, self._enough_cycles()))
            if self._guide.title != title:
                self._add_action(OperatorAction(GUIDE, self._trial.newest_s, self._guide.title))
                self._screen.say(f"guide: {self._guide.title}")
        self._state = state
        self._screen.update(state)

    def _enough_cycles(self) -> bool:
        """Whether there are as many cycles, or as narrow an interval, as asked for."""
        settings, trial = self._settings, self._trial
        interval = trial.score.interval
        target_deg = settings.until_half_width_deg
        if target_deg is not None and interval is not None and interval.half_width_deg <= target_deg:
            return True
        cycles = settings.cycles
        if cycles is None and settings.guide is not None and settings.until_half_width_deg is None:
            cycles = settings.guide.cycles
        return cycles is not None and trial.n_endpoints > cycles

    def _end_reason(self, now_ns: int) -> str | None:
        settings = self._settings
        if self._stop.is_set() or self._desk.finished:
            return "stopped by the operator"
        if self._reader.ended:
            self._error = self._reader.error
            return "the recording is over" if self._error is None else "the link was lost"
        if self._session is not None and self._session.error is not None:
            self._error = self._session.error
            if self._first_sample_ns is None:
                return "the object cannot be captured"
            return "another object answers" if isinstance(self._error, WrongObjectError) else "the link was lost"
        if self._guide is not None:
            if self._guide.done:
                return "the guided trial is complete"
        elif settings.until_half_width_deg is not None and self._enough_cycles():
            return f"the interval is within ±{settings.until_half_width_deg:g}°"
        elif settings.cycles is not None and self._trial.n_endpoints >= settings.cycles:
            # The last end point of a motion of just so many cycles closes one less: then the pause after it decides.
            if self._trial.n_endpoints > settings.cycles:
                self._reached_ns = self._reached_ns or now_ns
                linger_s = min(10.0, settings.linger_periods * (self._trial.period_s or 1.0))
                if now_ns - self._reached_ns >= linger_s * 1e9:
                    return f"{settings.cycles} cycles are done"
            elif self._trial.paused:
                return "the hand rests"
        over_ns = None if settings.duration_s is None else settings.duration_s * 1e9
        if self._first_sample_ns is not None and over_ns is not None and now_ns - self._first_sample_ns >= over_ns:
            return f"{settings.duration_s:g} s are over"
        # A recording ends by itself, whatever pauses it has; a link that is away has its own limit.
        waits = self._session is not None and self._connected
        if waits and now_ns - self._silent_since_ns >= settings.silence_limit_s * 1e9:
            before = "what came before is recorded" if self._first_sample_ns is not None else "nothing came at all"
            self._error = LinkError(
                f"the object has sent no samples for {settings.silence_limit_s:.0f} s",
                f"check its battery and cable; {before}",
            )
            return "the object fell silent"
        return None

    def _say_goodbye(self) -> None:
        """Stop the object, and take what it still has to say."""
        if self._session is None:
            return
        self._session.stop()
        while self._session.phase is not Phase.STOPPED and not self._reader.ended and self._connected:
            self._turn()
