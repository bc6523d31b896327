"""The link of a capture: a live one, whose object is talked with, or a recording, which is only listened to."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable

from firmware_protocol.packets import Stop
from host.capture.settings import CaptureSettings
from host.errors import HostError, LinkError, LinkLostError, NoAnswerError, WrongObjectError
from host.links.reader_thread import ReaderThread
from host.links.transport import AnyChunk, Transport
from host.recording.writer import RecordingWriter
from host.stream.blocks import RESET
from host.stream.session import Phase, Session
from host.trial.live import Trial, TrialUpdate
from host.trial.state import LinkView

MAX_RESETS = 5
RESETS_S = 30.0
"""So many resets within so long are a boot loop."""
Ending = tuple[str, HostError | None]
"""Why a capture ends, in words, and what went wrong; no error where it ends as asked."""


class Conversation:
    """Answers the object, and knows when it was last heard and whether object and link still go on.

    A recording has nobody to talk with, so there is no session; and its time is of another day, perhaps.
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
        self._session: Session | None = None
        if transport.is_live:
            self._session = Session(settings.session, transport.name, now_ns(), transport.encode_command)
            trial.assembler.on_segment.append(self._segment_starts)
        self.reader = ReaderThread(transport, pause_s=settings.read_pause_s if transport.is_live else 0.0)
        """Reads the link, and closes it."""
        self.chunk_ns = now_ns()
        """When the last chunk was received, or the capture started."""
        self.sample_ns = self.chunk_ns
        """The same of the last sample."""
        self._first_sample_ns: int | None = None
        self._quiet_since_ns = self.chunk_ns  # the last sample, or the link's first opening after it
        self._reopened = False  # since the last sample
        self._start_ns = self.chunk_ns
        self._handshake_s = settings.session.handshake_s
        self._resets_ns: deque[int] = deque(maxlen=MAX_RESETS)

    def _segment_starts(self, reason: str) -> None:
        """Inform the session; an object that is reset again and again is in a boot loop, and has no trial."""
        if self._session is None:
            return
        self._session.new_segment(reason)
        if reason != RESET:
            return
        self._resets_ns.append(self.chunk_ns)
        if len(self._resets_ns) == MAX_RESETS and self.chunk_ns - self._resets_ns[0] <= RESETS_S * 1e9:
            self._session.error = self._session.error or LinkError(
                f"the object was reset {MAX_RESETS} times within {RESETS_S:.0f} s",
                "check its power supply and battery; what came before is recorded",
            )

    @property
    def time_ns(self) -> int:
        """The time now; of a recording that is captured again, its own."""
        return self.chunk_ns if self._session is None else self._now_ns()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know of object and link, a sentence each."""
        session, trial = self._session, self._trial
        own = session.warnings if session else ()
        return (*own, *self._transport.problems, *trial.problems, *trial.refused, *trial.failures)

    @property
    def view(self) -> LinkView:
        """What a screen shows of the link."""
        session = self._session
        return LinkView(
            name=self._transport.name,
            connected=not self.reader.ended and self._transport.connected,
            one_way=session is not None and session.one_way,
            expected_rate_hz=None if session is None else session.expected_rate_hz,
            overflow_chunks=self.reader.overflow_chunks,
        )

    def elapsed_s(self, until_ns: int) -> float:
        """Return the time since the first sample, s; 0 before it."""
        return 0.0 if self._first_sample_ns is None else (until_ns - self._first_sample_ns) / 1e9

    def process(self, chunk: AnyChunk) -> TrialUpdate:
        """Have the trial decode a chunk, answer the object, and return what the trial found."""
        at_ns, session, trial = chunk.host_time_ns, self._session, self._trial
        self.chunk_ns = at_ns
        if chunk.reopened:  # the link is open again, and who is there now is to be asked before what comes is judged
            if not self._reopened:  # once only until a sample comes: one that opens again and again has no new time
                self._quiet_since_ns, self._reopened = at_ns, True
            if session is not None:
                session.reopened(at_ns)
        update = trial.feed(chunk)
        if session is not None:
            session.feed(update.items, len(chunk.data), at_ns)
            trial.feed_round_trips(session.take_round_trips())
            if trial.assembler.doubtful:  # its clock jumps: it may be another object
                session.ask_who(self._now_ns())
            for problem in trial.problems:  # two send at once
                remedy = "leave one object on the line; on CAN, give each a node id of its own"
                session.error = session.error or WrongObjectError(problem, remedy)
        if update.sampled:
            self.sample_ns = self._quiet_since_ns = at_ns
            self._reopened = False
            self._transport.proven()
            self._first_sample_ns = at_ns if self._first_sample_ns is None else self._first_sample_ns
        return update

    def send_due(self) -> None:
        """Send what is due; nobody hears it while the link is away."""
        session = self._session
        if session is None or not self._transport.connected:
            return
        for data in session.due(self._now_ns()):
            try:
                self._recording.add_sent(data, self._now_ns())
                self._transport.write(data)
            except LinkLostError as error:
                # What the link still delivers is read to its end; the reading thread notices when that is.
                session.error = session.error or error

    def send_stop(self) -> None:
        """Send STOP at once, past session and recording: after a failure of these, with no answer to wait for."""
        if self._session is not None:
            with contextlib.suppress(LinkLostError):
                self._transport.write(self._transport.encode_command(Stop(0)))

    def mark(self, number: int) -> None:
        """Have the object put a marker into its stream."""
        if self._session is not None:
            self._session.mark(number)

    def stopped(self) -> bool:
        """Ask the object to stop; return whether it has, or cannot be heard any more. Called until then."""
        if self._session is None:
            return True
        self._session.stop()
        return self._session.phase is Phase.STOPPED or self.reader.ended or not self._transport.connected

    def broken(self) -> Ending | None:
        """Return why link or object cannot go on; None while they do."""
        if self.reader.ended:
            return "the recording is over" if self.reader.error is None else "the link was lost", self.reader.error
        if self._session is None:
            return None
        error = self._session.error or self._never_heard()
        if error is None:
            return None
        if self._first_sample_ns is None:
            return "the object cannot be captured", error
        return "another object answers" if isinstance(error, WrongObjectError) else "the link was lost", error

    def _never_heard(self) -> HostError | None:
        """Return why an object is not waited for any longer whose link is lost before anything of it came."""
        assert self._session is not None
        heard = self._session.info is not None or self._first_sample_ns is not None
        if heard or self._transport.connected or self._now_ns() - self._start_ns < self._handshake_s * 1e9:
            return None
        why = self._transport.problems[-1].partition(";")[0]
        return NoAnswerError(
            f"{why}: no object was heard within {self._handshake_s:.0f} s",
            "check what is at the other end, and that no other program uses it",
        )

    def silence(self) -> Ending | None:
        """Return the end by an object that has sent nothing for too long; None before that.

        A recording ends by itself, whatever pauses it has; a link that is away has its own limit.
        """
        may_be_silent = self._session is None or not self._transport.connected
        if may_be_silent or self._now_ns() - self._quiet_since_ns < self._silence_limit_s * 1e9:
            return None
        before = "what came before is recorded" if self._first_sample_ns is not None else "nothing came at all"
        return "the object fell silent", LinkError(
            f"the object has sent no samples for {self._silence_limit_s:.0f} s",
            f"check its battery and cable; {before}",
        )
