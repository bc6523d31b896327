"""The link of a capture: a live one, whose object is talked with, or a recording, which is only listened to."""

from __future__ import annotations

from collections.abc import Callable

from host.capture.settings import CaptureSettings
from host.errors import HostError, LinkError, LinkLostError, WrongObjectError
from host.links.reader_thread import ReaderThread
from host.links.transport import AnyChunk, Transport
from host.recording.writer import RecordingWriter
from host.stream.session import Phase, Session
from host.trial.live import Trial, TrialUpdate
from host.trial.state import LinkView

Ending = tuple[str, HostError | None]
"""Why a capture ends, in words, and what went wrong; no error where it ends as asked."""


class Conversation:
    """Reads a link, answers the object, and knows when it was last heard and whether both still go on.

    Parameters
    ----------
    transport : Transport
        Open; closed by the reading thread.
    recording : RecordingWriter
        Gets everything that is sent.
    trial : Trial
        Gets the answers to TIME_REQUEST.
    settings : CaptureSettings
        How to talk, and how long to wait.
    now_ns : callable
        Monotonic clock, the one that stamps chunks.
    """

    def __init__(
        self,
        transport: Transport,
        recording: RecordingWriter,
        trial: Trial,
        settings: CaptureSettings,
        now_ns: Callable[[], int],
    ) -> None:
        self._transport = transport
        self._recording = recording
        self._trial = trial
        self._now_ns = now_ns
        self._silence_limit_s = settings.silence_limit_s
        live = transport.is_live
        self._reader = ReaderThread(transport, pause_s=settings.read_pause_s if live else 0.0)
        self._session = Session(settings.session, transport.name, now_ns(), transport.encode_command) if live else None
        if self._session is not None:
            trial.assembler.on_segment.append(self._session.new_segment)
        self.n_chunks = 0
        """Chunks received."""
        self.chunk_ns = now_ns()
        """When the last chunk was received, or the capture started."""
        self._first_sample_ns: int | None = None
        self._sample_ns = self.chunk_ns
        self._quiet_since_ns = self.chunk_ns  # the last sample, or the link's opening after it

    @property
    def time_ns(self) -> int:
        """The time now; a recording that is captured again has its own, of another day perhaps."""
        return self.chunk_ns if self._session is None else self._now_ns()

    @property
    def error(self) -> HostError | None:
        """Why the link ended; None while it goes on and after an orderly end."""
        return self._reader.error

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
            connected=not self._reader.ended and self._connected,
            one_way=session is not None and session.one_way,
            expected_rate_hz=None if session is None else session.expected_rate_hz,
            overflow_chunks=self._reader.overflow_chunks,
        )

    def lasted_ns(self, until_ns: int | None = None) -> int | None:
        """Return the time from the first sample, to the last one by default; None before it."""
        until_ns = self._sample_ns if until_ns is None else until_ns
        return None if self._first_sample_ns is None else until_ns - self._first_sample_ns

    def start(self) -> None:
        """Start to read."""
        self._reader.start()

    def receive(self, timeout_s: float) -> list[AnyChunk]:
        """Return what was read since the last call; wait for it at most ``timeout_s``."""
        return self._reader.take(timeout_s)

    def hear(self, chunk: AnyChunk) -> float | None:
        """Note that a chunk was received.

        Where it marks that the link was lost and is open again, ask again who is there, and return for how long nothing
        came, s; None elsewhere.
        """
        before_ns, self.chunk_ns = self.chunk_ns, chunk.host_time_ns
        self.n_chunks += 1
        if chunk.data:
            return None
        self._quiet_since_ns = chunk.host_time_ns
        if self._session is not None:
            self._session.reopened(chunk.host_time_ns)
        return (chunk.host_time_ns - before_ns) / 1e9

    def process(self, chunk: AnyChunk, update: TrialUpdate) -> None:
        """Process what the trial found in a chunk."""
        at_ns, session, trial = chunk.host_time_ns, self._session, self._trial
        if session is not None:
            session.feed(update.items, len(chunk.data), at_ns)
            trial.feed_round_trips(session.take_round_trips())
            if trial.assembler.doubtful:  # its clock jumps: it may be another object
                session.ask_who(self._now_ns())
            for problem in trial.problems:  # two send at once
                remedy = "leave one object on the line; on CAN, give each a node id of its own"
                session.error = session.error or WrongObjectError(problem, remedy)
        if update.sampled:
            self._sample_ns = self._quiet_since_ns = at_ns
            self._first_sample_ns = at_ns if self._first_sample_ns is None else self._first_sample_ns

    def send_due(self) -> None:
        """Send what is due; nobody hears it while the link is away."""
        session = self._session
        if session is None or not self._connected:
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

    def ending(self) -> Ending | None:
        """Return why link or object cannot go on; None while they do."""
        error = self._reader.error
        if self._reader.ended:
            return "the recording is over" if error is None else "the link was lost", error
        error = None if self._session is None else self._session.error
        if error is None:
            return None
        if self._first_sample_ns is None:
            return "the object cannot be captured", error
        return "another object answers" if isinstance(error, WrongObjectError) else "the link was lost", error

    def silence(self) -> Ending | None:
        """Return the end by an object that has sent nothing for too long; None before that.

        A recording ends by itself, whatever pauses it has; a link that is away has its own limit.
        """
        may_be_silent = self._session is None or not self._connected
        if may_be_silent or self._now_ns() - self._quiet_since_ns < self._silence_limit_s * 1e9:
            return None
        before = "what came before is recorded" if self._first_sample_ns is not None else "nothing came at all"
        return "the object fell silent", LinkError(
            f"the object has sent no samples for {self._silence_limit_s:.0f} s",
            f"check its battery and cable; {before}",
        )

    def say_goodbye(self) -> None:
        """Ask the object to stop."""
        if self._session is not None:
            self._session.stop()

    @property
    def is_over(self) -> bool:
        """Whether the object has stopped, or cannot be heard any more."""
        stopped = self._session is None or self._session.phase is Phase.STOPPED
        return stopped or self._reader.ended or not self._connected

    def close(self) -> list[AnyChunk]:
        """Close the link; return what was still to be received."""
        self._reader.stop()
        return self._reader.take(0)

    @property
    def _connected(self) -> bool:
        """Whether the link is there; one that cannot be lost and come back always is."""
        return bool(getattr(self._transport, "connected", True))
