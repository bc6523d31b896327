"""The conversation with one object: who it is, start, keep on, stop.

Packets go in, bytes to send come out. There is no I/O and no clock in here: every timeout is tested without waiting::

    handshake ──INFO──► starting ──ACK──► streaming ──► stopping ──► stopped
        └──────data, but no answer──────► streaming (one way)

A reset leads from streaming back to starting, a link that was opened again to handshake. Whether the object was reset
is not judged here: see :meth:`Session.new_segment`.
"""

from __future__ import annotations

import enum
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
from host.stream.blocks import RESET
from host.stream.command_queue import CommandQueue
from host.stream.handshake import Found, Handshake
from host.stream.round_trips import ClockRequests, RoundTrip
from host.text import plain


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """How long to wait for what."""

    rate_hz: int | None = None
    """Orientation rate to ask for; None leaves it as it is."""
    handshake_s: float = 6.0
    """How long an object may take to send anything: boards that reset when their port is opened need 2 s."""
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


SILENT_NS = 10**9
"""An object streams if its last sample is younger; and one that was started longer ago has no reason to be idle."""


class Session:
    """Talks with one object; ``encode`` makes the bytes that the link takes of a command, errors name the link."""

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
        self._handshake = Handshake(link_name, now_ns, settings.handshake_s, settings.answer_s, settings.mute_s)
        self._commands = CommandQueue()
        self._clock_requests = ClockRequests(settings.time_request_s, now_ns)
        self._last_sample_ns: int | None = None
        self._started_ns = 0
        self._was_reopened = False  # since the object last introduced itself
        self._who_asked_ns = now_ns

    @property
    def expected_rate_hz(self) -> float | None:
        """Rate the object was asked for or reports; None where it does not."""
        if self.info is None:
            return None
        return float(self.settings.rate_hz or self.info.rate_hz)

    @property
    def _listens(self) -> bool:
        """Whether the object streams and answers."""
        return self.phase is Phase.STREAMING and not self.one_way

    def take_round_trips(self) -> list[RoundTrip]:
        """Return the TIME_REQUEST round trips since the last call, and forget them."""
        return self._clock_requests.take()

    def feed(self, items: Iterable[StreamItem], n_bytes: int, host_time_ns: int) -> None:
        """Process the packets of one chunk (``n_bytes`` long, received at ``host_time_ns``)."""
        self._handshake.heard(n_bytes)
        for item in items:
            if isinstance(item, OrientationBatch):
                self._handshake.sampled(host_time_ns)
                self._last_sample_ns = host_time_ns
            elif isinstance(item, Info):
                self._feed_info(item)
            elif isinstance(item, ForeignInfo):
                self._feed_foreign(item)
            elif isinstance(item, Ack):
                self._feed_ack(item, host_time_ns)
            elif isinstance(item, TimeReply):
                self._feed_reply(item, host_time_ns)
            elif isinstance(item, Status):
                # A reset whose INFO was lost, or a START that went astray, leaves the object idle.
                idle = item.state is DeviceState.IDLE and host_time_ns - self._started_ns > SILENT_NS
                if idle and self._listens:
                    self._start()

    def new_segment(self, reason: str) -> None:
        """Learn that a new segment of samples starts, and why: an object that was reset must be started again."""
        if reason == RESET:
            self.warnings.append("the object was reset during the capture")
            if self.phase in {Phase.STREAMING, Phase.STARTING}:
                self._start()

    def due(self, now_ns: int) -> list[bytes]:
        """Return what is to be sent now, and let timeouts take effect; to be called every few tens of milliseconds."""
        if self.error is None:
            if self.phase is Phase.HANDSHAKE:
                self._due_handshake(now_ns)
            elif self.phase in {Phase.STARTING, Phase.STOPPING}:
                self._due_command(now_ns)
            elif self._listens and self._clock_requests.due(now_ns):
                self._commands.post(TimeRequest)
        commands = self._commands.take()
        for command in commands:
            if isinstance(command, TimeRequest):
                self._clock_requests.sent(command.command_id, now_ns)
        return [self._encode(command) for command in commands]

    def reopened(self, now_ns: int) -> None:
        """Start again after the link was lost and opened again: ask who is there, then start it.

        An object that answers with another device id is refused; one that never answers is captured on.
        """
        if self.error is not None or self.phase in {Phase.STOPPING, Phase.STOPPED}:
            return
        self._commands.forget()
        self._clock_requests.forget()
        self._handshake.restart(now_ns, patient=self._last_sample_ns is not None)
        self._was_reopened = True
        if not self.one_way:
            self.phase = Phase.HANDSHAKE

    def ask_who(self, now_ns: int) -> None:
        """Ask who is there, because what comes may be another's; not more often than an answer may take."""
        if self._listens and now_ns - self._who_asked_ns >= self.settings.answer_s * 1e9:
            self._who_asked_ns = now_ns
            self._commands.post(GetInfo)

    def mark(self, marker: int) -> None:
        """Put a marker into the stream of an object that listens; it comes back as EVENT."""
        if self._listens:
            self._commands.post(lambda command_id: Mark(command_id, marker))

    def stop(self) -> None:
        """Ask the object to stop streaming; :attr:`phase` becomes STOPPED when it did or does not answer."""
        if self.phase in {Phase.STARTING, Phase.STREAMING} and not self.one_way and self.error is None:
            self.phase = Phase.STOPPING
            self._commands.start([Stop])
        elif self.phase is not Phase.STOPPING:
            self.phase = Phase.STOPPED

    def _feed_info(self, info: Info) -> None:
        if self.info is not None and info.device_id != self.info.device_id:
            self.error = _another(info, self.info, self._was_reopened)
            return
        self.info = info
        self.one_way = self._was_reopened = False
        if self.phase is Phase.HANDSHAKE:
            self._start()

    def _feed_reply(self, reply: TimeReply, host_time_ns: int) -> None:
        requests, before = self._clock_requests, self._clock_requests.refused
        requests.receive(reply, host_time_ns)
        if requests.refused > before == 0:
            self.warnings.append("the object answered with clock readings that cannot be: they are left out")

    def _feed_foreign(self, info: ForeignInfo) -> None:
        newer = info.protocol_major > PROTOCOL_MAJOR
        self.error = WrongObjectError(
            f"the object at {self._link_name} speaks protocol version {info.protocol_major}.{info.protocol_minor}, "
            f"this program version {PROTOCOL_MAJOR}",
            "update rotdrift" if newer else "update the object's firmware",
        )

    def _start(self) -> None:
        self.phase = Phase.STARTING
        rate_hz = self.settings.rate_hz
        set_rate = [lambda command_id: SetRate(command_id, rate_hz)] if rate_hz else []
        self._commands.start([*set_rate, Start])

    def _feed_ack(self, ack: Ack, host_time_ns: int) -> None:
        command = self._commands.acknowledged(ack)
        if command is None:
            return
        # START again, after an acknowledgement was lost, finds an object that streams already.
        streams_already = isinstance(command, Start) and ack.code is AckCode.WRONG_STATE and self._last_sample_ns
        if ack.code is AckCode.OK or isinstance(command, Stop) or streams_already:
            self._advance(host_time_ns)
            return
        problem, remedy = "does not start to stream", "restart it, or wait until it is ready"
        if isinstance(command, SetRate):
            problem, remedy = f"refuses {command.rate_hz} Hz", "give another --rate, or leave it out"
        self.error = WrongObjectError(f"the object {problem} ({ack.code.name.lower().replace('_', ' ')})", remedy)

    def _advance(self, now_ns: int) -> None:
        """Enter the next phase, once no command of this one is left."""
        if not self._commands.all_done:
            return
        if self.phase is Phase.STARTING:
            self.phase = Phase.STREAMING
            self._started_ns = now_ns
        elif self.phase is Phase.STOPPING:
            self.phase = Phase.STOPPED

    def _due_handshake(self, now_ns: int) -> None:
        found = self._handshake.judge(now_ns)
        if found is Found.ASK:
            self._commands.post(GetInfo)
        elif found is Found.NOBODY:
            self.error = self._handshake.error()
        elif found is Found.MUTE:
            self.one_way = True
            self.phase = Phase.STREAMING
            self.warnings.append(
                "the object streams but does not answer: it is captured without identity, card and start/stop"
            )

    def _due_command(self, now_ns: int) -> None:
        settings = self.settings
        stopping = self.phase is Phase.STOPPING
        answer_s, tries = (settings.stop_s, 2) if stopping else (settings.answer_s, settings.tries)
        given_up = self._commands.advance(now_ns, answer_s, tries)
        if given_up is None:
            return
        if stopping:
            self.phase = Phase.STOPPED
        elif self._last_sample_ns is not None and now_ns - self._last_sample_ns < SILENT_NS:
            self.warnings.append(f"the object did not acknowledge {given_up.packet_type.name}, but it streams")
            self._advance(now_ns)
        else:
            self.error = NoAnswerError(
                f"the object introduced itself, but did not answer {given_up.packet_type.name}",
                "restart it; if it happens again, its firmware does not follow the protocol",
            )


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
