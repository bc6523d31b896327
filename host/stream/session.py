"""The conversation with one object: who it is, start, keep going, stop.

Packets go in, bytes to send come out; there is no I/O and no clock in here, so every timeout is tested without waiting.

handshake ──INFO──► starting ──ACK──► streaming ──► stopping ──► stopped
    └──────data, but no answer──────► streaming (one way)
"""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from firmware_protocol.items import ForeignInfo, StreamItem
from firmware_protocol.packets import (
    PROTOCOL_MAJOR,
    Ack,
    AckCode,
    Command,
    DeviceState,
    GetInfo,
    Info,
    Mark,
    OrientationBatch,
    SetRate,
    Start,
    Status,
    Stop,
    TimeReply,
    TimeRequest,
)
from firmware_protocol.serial.decoder import encode_command
from host.errors import HostError, NoAnswerError, WrongObjectError
from host.text import plain


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """How long to wait for what."""

    rate_hz: int | None = None
    """Orientation rate to ask for; None leaves it as it is."""
    handshake_s: float = 6.0
    """How long an object may take to say anything: boards that reset when their port is opened need 2 s."""
    answer_s: float = 0.5
    """How long an answer may take before the command is sent again."""
    tries: int = 4
    """How often a command is sent."""
    mute_s: float = 1.5
    """An object that streams but did not answer for so long is taken as one that never answers."""
    time_request_s: float = 1.0
    """Between two requests for the device clock."""
    stop_s: float = 0.15
    """How long the answer to STOP may take; it is sent twice."""


class Phase(enum.Enum):
    """How far the conversation is."""

    HANDSHAKE = "handshake"
    STARTING = "starting"
    STREAMING = "streaming"
    STOPPING = "stopping"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """One TIME_REQUEST and its answer."""

    sent_ns: int
    """Host monotonic time just before the request was written."""
    receive_us: int
    """Device clock at its reception, u64."""
    transmit_us: int
    """Device clock when the reply left, u64."""
    received_ns: int
    """Host monotonic time of the chunk with the reply."""


@dataclass(slots=True)
class _Open:
    """A command that waits for its acknowledgement."""

    command: Command
    sent_ns: int
    tries: int


class Session:
    """Talks with one object.

    Parameters
    ----------
    settings : SessionSettings
        Rate and timeouts.
    link_name : str
        For error messages.
    now_ns : int
        Monotonic time at the start.
    encode : callable
        Command to bytes as the link takes them.
    """

    def __init__(
        self,
        settings: SessionSettings,
        link_name: str,
        now_ns: int,
        encode: Callable[[Command], bytes] = encode_command,
    ) -> None:
        self.settings = settings
        self.phase = Phase.HANDSHAKE
        self.info: Info | None = None
        """The object as it last introduced itself."""
        self.one_way = False
        """Whether the object streams but never answers."""
        self.error: HostError | None = None
        """Why the conversation cannot go on."""
        self.warnings: list[str] = []
        """What a person should know."""
        self._link_name = link_name
        self._encode = encode
        self._start_ns = now_ns
        self._first_sample_ns: int | None = None
        self._last_sample_ns: int | None = None
        self._started_ns = 0
        self._asked_ns: int | None = None
        self._command_id = 0
        self._open: _Open | None = None
        self._todo: deque[Callable[[int], Command]] = deque()
        self._outbox: list[Command] = []
        self._time_sent: dict[int, int] = {}
        self._time_asked_ns = now_ns
        self._round_trips: list[RoundTrip] = []
        self._bytes_received = 0
        self._was_reopened = False  # since the object last introduced itself
        self._who_asked_ns = now_ns
        self._was_there = False  # it has been captured before: how long it may be silent is not for us to say

    @property
    def expected_rate_hz(self) -> float | None:
        """Rate the object was asked for or says it has; None where it does not tell."""
        if self.info is None:
            return None
        return float(self.settings.rate_hz or self.info.rate_hz)

    def take_round_trips(self) -> list[RoundTrip]:
        """Return the TIME_REQUEST round trips since the last call, and forget them."""
        trips, self._round_trips = self._round_trips, []
        return trips

    def feed(self, items: Iterable[StreamItem], n_bytes: int, host_time_ns: int) -> None:
        """Take the packets of one chunk (``n_bytes`` long, received at ``host_time_ns``)."""
        self._bytes_received += n_bytes
        for item in items:
            if isinstance(item, OrientationBatch):
                if self._first_sample_ns is None:
                    self._first_sample_ns = host_time_ns
                self._last_sample_ns = host_time_ns
            elif isinstance(item, Info):
                self._feed_info(item)
            elif isinstance(item, ForeignInfo):
                self._feed_foreign(item)
            elif isinstance(item, Ack):
                self._feed_ack(item, host_time_ns)
            elif isinstance(item, TimeReply):
                sent_ns = self._time_sent.pop(item.command_id, None)
                if sent_ns is not None:
                    self._round_trips.append(
                        RoundTrip(sent_ns, item.receive_uptime_us, item.transmit_uptime_us, host_time_ns)
                    )
            elif isinstance(item, Status):
                self._feed_status(item, host_time_ns)

    def due(self, now_ns: int) -> list[bytes]:
        """Say what is to be sent now, and let timeouts take effect; to be called every few tens of milliseconds."""
        if self.error is None:
            if self.phase is Phase.HANDSHAKE:
                self._due_handshake(now_ns)
            elif self.phase in {Phase.STARTING, Phase.STOPPING}:
                self._due_command(now_ns)
            elif self.phase is Phase.STREAMING and not self.one_way:
                self._due_time_request(now_ns)
        commands, self._outbox = self._outbox, []
        for command in commands:
            if isinstance(command, TimeRequest):
                self._time_sent[command.command_id] = now_ns
        return [self._encode(command) for command in commands]

    def reopened(self, now_ns: int) -> None:
        """Begin anew after the link was lost and opened again: ask who is there, then start it.

        An object that answers with another device id is refused; one that never answers is captured on.
        """
        if self.error is not None or self.phase in {Phase.STOPPING, Phase.STOPPED}:
            return
        self._open = None
        self._todo.clear()
        self._outbox.clear()
        self._time_sent.clear()
        self._first_sample_ns = self._asked_ns = None
        self._start_ns = now_ns
        self._was_there = self._last_sample_ns is not None
        self._was_reopened = True
        if not self.one_way:
            self.phase = Phase.HANDSHAKE

    def ask_who(self, now_ns: int) -> None:
        """Ask who is there, because what comes may be another's; not more often than an answer may take."""
        streams = self.phase is Phase.STREAMING and not self.one_way
        if streams and now_ns - self._who_asked_ns >= self.settings.answer_s * 1e9:
            self._who_asked_ns = now_ns
            self._outbox.append(GetInfo(self._next_id()))

    def mark(self, marker: int) -> None:
        """Put a marker into the stream of an object that listens; it comes back as EVENT."""
        if self.phase is Phase.STREAMING and not self.one_way:
            self._outbox.append(Mark(self._next_id(), marker))

    def stop(self) -> None:
        """Ask the object to stop streaming; :attr:`phase` becomes STOPPED when it did or does not answer."""
        if self.phase in {Phase.STARTING, Phase.STREAMING} and not self.one_way and self.error is None:
            self.phase = Phase.STOPPING
            self._open = None
            self._todo = deque([Stop])
        elif self.phase is not Phase.STOPPING:
            self.phase = Phase.STOPPED

    def _next_id(self) -> int:
        self._command_id = (self._command_id + 1) % 256
        return self._command_id

    def _feed_info(self, info: Info) -> None:
        known = self.info
        if known is not None and info.device_id != known.device_id:
            self.error = _another(info, known, self._was_reopened)
            return
        self.info = info
        self._was_reopened = False
        self.one_way = False
        was_reset = known is not None and info.boot_id != known.boot_id
        if was_reset:
            self.warnings.append("the object was reset during the capture")
        under_way = self.phase in {Phase.STREAMING, Phase.STARTING}
        if self.phase is Phase.HANDSHAKE or (was_reset and under_way):
            self._begin_start()

    def _feed_foreign(self, info: ForeignInfo) -> None:
        newer = info.protocol_major > PROTOCOL_MAJOR
        self.error = WrongObjectError(
            f"the object at {self._link_name} speaks protocol version {info.protocol_major}.{info.protocol_minor}, "
            f"this program version {PROTOCOL_MAJOR}",
            "update rotdrift" if newer else "update the object's firmware",
        )

    def _feed_status(self, status: Status, host_time_ns: int) -> None:
        # A reset whose INFO was lost, or a START that went astray, leaves the object idle.
        idle = status.state is DeviceState.IDLE
        if self.phase is Phase.STREAMING and not self.one_way and idle and host_time_ns - self._started_ns > 1e9:
            self._begin_start()

    def _begin_start(self) -> None:
        self.phase = Phase.STARTING
        self._open = None
        self._todo = deque([self._set_rate, Start] if self.settings.rate_hz else [Start])

    def _feed_ack(self, ack: Ack, host_time_ns: int) -> None:
        waiting = self._open
        if waiting is None or ack.command_id != waiting.command.command_id:
            return
        if ack.command_type != waiting.command.packet_type:
            return
        self._open = None
        streams_already = isinstance(waiting.command, Start) and ack.code is AckCode.WRONG_STATE
        if ack.code is AckCode.OK or isinstance(waiting.command, Stop) or (streams_already and self._last_sample_ns):
            self._advance(host_time_ns)
        elif isinstance(waiting.command, SetRate):
            self.error = WrongObjectError(
                f"the object refuses {waiting.command.rate_hz} Hz ({_words(ack.code)})",
                "give another --rate, or leave it out",
            )
        else:
            self.error = WrongObjectError(
                f"the object does not start to stream ({_words(ack.code)})", "restart it, or wait until it is ready"
            )

    def _advance(self, now_ns: int) -> None:
        if self._todo:
            return
        if self.phase is Phase.STARTING:
            self.phase = Phase.STREAMING
            self._started_ns = now_ns
        elif self.phase is Phase.STOPPING:
            self.phase = Phase.STOPPED

    def _due_handshake(self, now_ns: int) -> None:
        settings = self.settings
        if self._first_sample_ns is not None and now_ns - self._first_sample_ns > settings.mute_s * 1e9:
            self.one_way = True
            self.phase = Phase.STREAMING
            self.warnings.append(
                "the object streams but does not answer: it is captured without identity, card and start/stop"
            )
        elif not self._was_there and self._first_sample_ns is None and self._late(now_ns):
            self.error = self._no_answer()
        elif self._asked_ns is None or now_ns - self._asked_ns >= settings.answer_s * 1e9:
            self._asked_ns = now_ns
            self._outbox.append(GetInfo(self._next_id()))

    def _late(self, now_ns: int) -> bool:
        return now_ns - self._start_ns > self.settings.handshake_s * 1e9

    def _no_answer(self) -> NoAnswerError:
        seconds = f"{self.settings.handshake_s:.0f} s"
        if self._link_name.startswith("can:"):
            heard = "frames came, but no sample and no answer" if self._bytes_received else "no frame came"
            return NoAnswerError(
                f"nothing answers at {self._link_name}: {heard} within {seconds}",
                "check node id, bit rate and fd in the link, and that the object is switched on; "
                "`rotdrift ports --probe` lists the objects on a bus",
            )
        if self._bytes_received:
            return NoAnswerError(
                f"{self._link_name} sends bytes ({self._bytes_received} in {seconds}), but nothing an object would say",
                "check the baud rate (?baud=) and whether another device is at this port",
            )
        return NoAnswerError(
            f"nothing answers at {self._link_name} and no data came within {seconds}",
            "check that the object is switched on and that this is its port (`rotdrift ports`)",
        )

    def _due_command(self, now_ns: int) -> None:
        settings = self.settings
        answer_s, tries = (settings.stop_s, 2) if self.phase is Phase.STOPPING else (settings.answer_s, settings.tries)
        if self._open is None:
            if not self._todo:
                return
            self._open = _Open(self._todo.popleft()(self._next_id()), now_ns, 1)
            self._outbox.append(self._open.command)
        elif now_ns - self._open.sent_ns >= answer_s * 1e9:
            if self._open.tries < tries:
                self._open.sent_ns = now_ns
                self._open.tries += 1
                self._outbox.append(self._open.command)
            else:
                self._give_up(now_ns)

    def _give_up(self, now_ns: int) -> None:
        assert self._open is not None
        command, self._open = self._open.command, None
        streams = self._last_sample_ns is not None and now_ns - self._last_sample_ns < 1e9
        if self.phase is Phase.STOPPING:
            self.phase = Phase.STOPPED
        elif streams:
            self.warnings.append(f"the object did not acknowledge {command.packet_type.name}, but it streams")
            self._advance(now_ns)
        else:
            self.error = NoAnswerError(
                f"the object said who it is, but did not answer {command.packet_type.name}",
                "restart it; if it happens again, its firmware does not follow the protocol",
            )

    def _set_rate(self, command_id: int) -> SetRate:
        return SetRate(command_id, self.settings.rate_hz or 0)

    def _due_time_request(self, now_ns: int) -> None:
        if now_ns - self._time_asked_ns >= self.settings.time_request_s * 1e9:
            self._time_asked_ns = now_ns
            self._time_sent.clear()  # one at a time: a late answer is worth nothing
            self._outbox.append(TimeRequest(self._next_id()))


def _another(info: Info, known: Info, was_reopened: bool) -> WrongObjectError:
    there, before = (f"{plain(each.name) or 'unnamed'} ({each.device_id:016x})" for each in (info, known))
    if was_reopened:
        return WrongObjectError(
            f"another object answers now: {there} in place of {before}", "capture each object in a trial of its own"
        )
    return WrongObjectError(
        f"a second object answers on this line: {there} beside or in place of {before}",
        "leave one object on the line, and capture each in a trial of its own",
    )


def _words(code: AckCode) -> str:
    return code.name.lower().replace("_", " ")
