"""The link of a capture: a live one, whose object is talked with, or a recording, which is only listened to."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from host.errors import HostError, LinkLostError, WrongObjectError
from host.links.reader_thread import ReaderThread
from host.links.transport import AnyChunk, Transport
from host.recording.writer import RecordingWriter
from host.stream.session import Phase, RoundTrip, Session, SessionSettings
from host.trial.live import TrialUpdate
from host.trial.state import LinkView


class Conversation:
    """Reads a link, answers the object, and knows whether both still go on.

    Parameters
    ----------
    transport : Transport
        Open; closed by the reading thread.
    recording : RecordingWriter
        Gets everything that is sent.
    settings : SessionSettings
        How to talk.
    read_pause_s : float
        Rest of a live link's reading thread.
    now_ns : callable
        Monotonic clock, the one that stamps chunks.
    """

    def __init__(
        self,
        transport: Transport,
        recording: RecordingWriter,
        settings: SessionSettings,
        read_pause_s: float = 0.0,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._transport = transport
        self._recording = recording
        self._now_ns = now_ns
        live = transport.is_live
        self._reader = ReaderThread(transport, pause_s=read_pause_s if live else 0.0)
        self._session = Session(settings, transport.name, now_ns(), transport.encode_command) if live else None

    @property
    def is_live(self) -> bool:
        """Whether somebody may answer; a recording that is captured again has its own time, of another day perhaps."""
        return self._session is not None

    @property
    def connected(self) -> bool:
        """Whether the link is there; one that cannot be lost and come back always is."""
        return bool(getattr(self._transport, "connected", True))

    @property
    def ended(self) -> bool:
        """Whether the link is over and all of it was received."""
        return self._reader.ended

    @property
    def link_error(self) -> HostError | None:
        """Why the link ended; None while it goes on and after an orderly end."""
        return self._reader.error

    @property
    def error(self) -> HostError | None:
        """Why the conversation cannot go on."""
        return None if self._session is None else self._session.error

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know of object and link, a sentence each."""
        return (*(() if self._session is None else self._session.warnings), *self._transport.problems)

    @property
    def view(self) -> LinkView:
        """What a screen shows of the link."""
        session = self._session
        return LinkView(
            name=self._transport.name,
            connected=not self.ended and self.connected,
            one_way=session is not None and session.one_way,
            expected_rate_hz=None if session is None else session.expected_rate_hz,
            overflow_chunks=self._reader.overflow_chunks,
        )

    def start(self) -> None:
        """Start to read."""
        self._reader.start()

    def receive(self, timeout_s: float) -> list[AnyChunk]:
        """Return what was read since the last call; wait for it at most ``timeout_s``."""
        return self._reader.take(timeout_s)

    def process(self, update: TrialUpdate, chunk: AnyChunk) -> list[RoundTrip]:
        """Process what a chunk contained; return the answers to TIME_REQUEST in it."""
        if self._session is None:
            return []
        self._session.feed(update.items, len(chunk.data), chunk.host_time_ns)
        return self._session.take_round_trips()

    def doubt(self, problems: Iterable[str], ask: bool) -> None:
        """Ask an object whose clock jumps who it is (``ask``); give up where two send at once (``problems``)."""
        session = self._session
        if session is None:
            return
        if ask:
            session.ask_who(self._now_ns())
        for problem in problems:
            session.error = session.error or WrongObjectError(
                problem, "leave one object on the line; on CAN, give each a node id of its own"
            )

    def send_due(self) -> None:
        """Send what is due; nobody hears it while the link is away."""
        session = self._session
        if session is None or not self.connected:
            return
        for data in session.due(self._now_ns()):
            try:
                self._recording.add_sent(data, self._now_ns())
                self._transport.write(data)
            except LinkLostError as error:
                # What the link still delivers is read to its end; the reading thread notices when that is.
                session.error = session.error or error

    def mark(self, number: int) -> None:
        """Have the object put a marker into its stream."""
        if self._session is not None:
            self._session.mark(number)

    def reopened(self, now_ns: int) -> None:
        """Ask again who is there: the link was lost and opened again."""
        if self._session is not None:
            self._session.reopened(now_ns)

    def say_goodbye(self) -> None:
        """Ask the object to stop."""
        if self._session is not None:
            self._session.stop()

    @property
    def is_over(self) -> bool:
        """Whether the object has stopped, or cannot answer any more."""
        over = self._session is None or self._session.phase is Phase.STOPPED
        return over or self.ended or not self.connected

    def close(self) -> list[AnyChunk]:
        """Close the link; return what was still to be received."""
        self._reader.stop()
        return self._reader.take(0)
