"""The object's firmware: a state machine of given time, without I/O and without a clock of its own.

``receive(packet, now_s)`` processes one encoded command, ``step(now_s, sink)`` does what is due by then and hands
encoded packets to the link in the order in which a real object would. Times never decrease. The same seed and the same
commands at the same times make the same bytes, however the time between is stepped.

Refusals: ``UNKNOWN_COMMAND`` for a host packet of unknown type, ``INVALID_ARGUMENT`` for one that is malformed or out
of range, ``WRONG_STATE`` for CALIBRATE while streaming and START, STOP or SET_RATE while calibrating, ``BUSY`` for
CALIBRATE while calibrating, ``NOT_STILL`` for CALIBRATE while the object turns. A CALIBRATE or MARK that is repeated
with the same ``command_id`` within 5 s is a retry: it is answered again but not done again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from emulator.device.clock import DeviceClock
from emulator.device.conversation import Conversation, StatusTimer
from emulator.device.imu_model import ImuModel, TrueMotion
from emulator.device.sample_stream import SampleBlock, SampleStream
from emulator.device.settings import DeviceSettings
from emulator.device.transmit_queue import Sink, TransmitQueue
from firmware_protocol import packets as p
from firmware_protocol.codec import decode_packet, encode_packet
from firmware_protocol.errors import ProtocolError, UnknownPacketTypeError

_BOOT_ID_STREAM = 41
_FIRST_HOST_TYPE = 0x80


@dataclass(frozen=True)
class FirmwareCounters:
    """What the object did in all its boots together."""

    samples_produced: int
    """On the sampling timer."""
    samples_dropped: int
    """Of these, because the link was full or nobody there."""
    commands: int
    """Packets from the host that were answered."""
    refusals: int
    """Of these, those not done."""


class Firmware:
    """One object's firmware. Powered up by :meth:`power_up`.

    Parameters
    ----------
    settings, imu, clock, true_motion : DeviceSettings, ImuModel, DeviceClock, callable
        The object, its sensor, its clock and the world.
    seed : int
        Seed of its boot ids.
    on_start : callable
        Called with the time of every START that streams, s, before the first sample is made.
    on_samples : callable
        Called with each run of samples produced and the number of the boot.
    """

    def __init__(
        self,
        settings: DeviceSettings,
        imu: ImuModel,
        clock: DeviceClock,
        true_motion: TrueMotion,
        seed: int,
        on_start: Callable[[float], None] = lambda now_s: None,  # noqa: ARG005
        on_samples: Callable[[SampleBlock, int], None] = lambda block, boot: None,  # noqa: ARG005
    ) -> None:
        self.settings = settings
        self.state = p.DeviceState.IDLE
        self.rate_hz = settings.rate_hz
        """The rate that INFO claims, Hz."""
        self._imu, self._clock, self._seed = imu, clock, seed
        self._on_start, self._on_samples = on_start, on_samples
        self._stream = SampleStream(imu, clock, true_motion)
        self._queue = TransmitQueue(settings.transmit_queue_bytes)
        self._status = StatusTimer(settings.status_interval_s)
        self._conversation = Conversation()
        self._boot = -1
        self._on_from_s = np.inf  # powered off until then
        self._calibrated_at_s = np.inf

    @property
    def boot_ids(self) -> tuple[int, ...]:
        """Boot ids so far; the last one is the present."""
        return tuple(self._boot_id(boot) for boot in range(self._boot + 1))

    def _boot_id(self, boot: int) -> int:
        return int(np.random.default_rng([self._seed, _BOOT_ID_STREAM, boot]).integers(1, 2**32))

    @property
    def counters(self) -> FirmwareCounters:
        """What the object did so far."""
        return FirmwareCounters(
            samples_produced=self._stream.produced_before + self._stream.produced,
            samples_dropped=self._queue.dropped_before + self._queue.samples_dropped,
            commands=self._conversation.commands,
            refusals=self._conversation.refusals,
        )

    # --- power ---------------------------------------------------------------------------------------------------

    def power_up(self, now_s: float) -> None:
        """Power up: INFO, then STATUS for ever; streams at once if it is that kind of object."""
        self._boot += 1
        self._on_from_s = now_s
        self.rate_hz = self.settings.rate_hz
        self._stream.boot(self._boot, self.rate_hz, now_s)
        self.state = p.DeviceState.IDLE
        self._status.power_up(now_s)
        self._calibrated_at_s = np.inf
        self._put(self._info())
        if self.settings.streams_from_power_up:
            self._start(now_s, with_raw_imu=False)

    def reset(self, now_s: float, off_s: float) -> None:
        """Lose power now and have it again after ``off_s``.

        What was queued is lost; boot id, clock and sequence are new.
        """
        self._queue.reset()
        self._stream.boot(self._boot, self.rate_hz, now_s)
        self._status.power_off()
        self._conversation.forget()
        self._on_from_s = now_s + off_s
        self._calibrated_at_s = np.inf

    def become_another(self, now_s: float, off_s: float) -> None:
        """Be replaced by another object of the same make, powered up after ``off_s``."""
        self.settings = replace(self.settings, device_id=self.settings.device_id ^ 1)
        self.reset(now_s, off_s)

    def speak_version(self, major: int, now_s: float, off_s: float) -> None:
        """Be reset, and come back after ``off_s`` with a firmware that claims another major version."""
        self.settings = replace(self.settings, protocol_major=major)
        self.reset(now_s, off_s)

    def step_clock(self, now_s: float, by_us: int) -> None:
        """Let the object's clock jump; samples go on at the same pace with the new time."""
        before = self._clock.read_us(now_s)
        self._clock.step(now_s, by_us)
        self._stream.shift(self._clock.read_us(now_s) - before)

    def set_true_rate(self, rate_hz: int, now_s: float) -> None:
        """Sample at another rate than INFO claims: a fault."""
        self._stream.set_rate(rate_hz, now_s)

    # --- time ----------------------------------------------------------------------------------------------------

    @property
    def next_due_s(self) -> float:
        """When :meth:`step` has something to do next, if no command comes, s."""
        if not self._status.is_on and self._on_from_s < np.inf:
            return self._on_from_s  # reset, waiting for power
        return min(self._stream.next_due_s, self._status.next_s, self._calibrated_at_s)

    @property
    def backlog(self) -> int:
        """Packets that wait for the link."""
        return len(self._queue)

    def prepare(self) -> None:
        """Work ahead while there is time; changes nothing that can be seen."""
        self._stream.prepare()

    def step(self, now_s: float, sink: Sink) -> None:
        """Do all that is due by now, in order of time, and hand packets to the link."""
        while True:
            if not self._status.is_on:
                if now_s < self._on_from_s:
                    return
                self._clock.restart(self._on_from_s)
                self.power_up(self._on_from_s)
            event_s = min(self._status.next_s, self._calibrated_at_s)
            block = self._stream.take(min(now_s, event_s))
            if block is not None:
                self._on_samples(block, self._boot)
                self._queue.put_samples(block.samples, min(now_s, event_s), sink)
            elif event_s <= now_s:
                if self._calibrated_at_s <= self._status.next_s:
                    self._end_calibration(event_s)
                self._queue.drain(event_s, sink)
                self._report(event_s)
            else:
                break
        self._queue.drain(now_s, sink)

    def _put(self, packet: p.DevicePacket) -> bool:
        return self._queue.put(encode_packet(packet))

    def _report(self, now_s: float) -> None:
        """Queue a STATUS; with a full queue it is left out, and what it had to report waits for the next."""
        self._status.wait(now_s)
        if self._queue.is_full:
            return
        dropped, battery_mv = self._queue.samples_dropped, self.settings.battery_at(now_s)
        bias = self._imu.settings.gyro_bias_dps if self._stream.calibrated else (0.0, 0.0, 0.0)
        status = p.Status(
            uptime_us=self._clock.read_us(now_s),
            state=self.state,
            samples_produced=self._stream.produced,
            samples_dropped=dropped,
            battery_mv=battery_mv,
            temperature_c=self._imu.settings.temperature_c,
            gyro_bias_dps=bias,
            errors=self._status.errors_with(dropped, battery_mv),
        )
        if self._put(status):
            self._status.reported(dropped)

    def _info(self) -> p.Info:
        major, minor, patch = (int(part) for part in self.settings.firmware_version)
        return p.Info(
            device_id=self.settings.device_id,
            boot_id=self._boot_id(self._boot),
            firmware_version=(major, minor, patch),
            rate_hz=self.rate_hz,
            name=self.settings.name,
            sensor=self._imu.settings.sensor,
            filter=self._imu.settings.filter,
            card=self.settings.card.card(),
            protocol_major=self.settings.protocol_major,
        )

    # --- commands ------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_s: float) -> None:
        """Process one packet from the host, without framing, after :meth:`step` up to now; any bytes are accepted."""
        if not self.settings.answers or not self._status.is_on or len(data) < 2 or data[0] < _FIRST_HOST_TYPE:
            return
        self._conversation.commands += 1
        try:
            command = decode_packet(data)
        except UnknownPacketTypeError:
            self._ack(data[0], data[1], p.AckCode.UNKNOWN_COMMAND)
            return
        except ProtocolError:
            self._ack(data[0], data[1], p.AckCode.INVALID_ARGUMENT)
            return
        if isinstance(command, p.TimeRequest):
            self._reply_with_time(command.command_id, self._clock.read_us(now_s))
        elif isinstance(command, p.Calibrate | p.Mark):
            self._do_once(command, now_s)
        elif isinstance(command, p.GetInfo):
            self._ack(data[0], command.command_id, p.AckCode.OK)
            self._put(self._info())
        elif isinstance(command, p.Start | p.Stop | p.SetRate | p.Identify):
            self._ack(data[0], command.command_id, self._do(command, now_s))

    def _ack(self, command_type: int, command_id: int, code: p.AckCode) -> None:
        self._conversation.refusals += code is not p.AckCode.OK
        self._put(p.Ack(command_type, command_id, code))

    def _reply_with_time(self, command_id: int, receive_uptime_us: int) -> None:
        def reply(now_s: float) -> bytes:
            transmit_uptime_us = max(self._clock.read_us(now_s), receive_uptime_us)
            return encode_packet(p.TimeReply(command_id, receive_uptime_us, transmit_uptime_us))

        self._queue.put(reply)

    def _do(self, command: p.Start | p.Stop | p.SetRate | p.Identify, now_s: float) -> p.AckCode:
        if isinstance(command, p.Identify):
            return p.AckCode.OK
        if self.state is p.DeviceState.CALIBRATING:
            return p.AckCode.WRONG_STATE
        if isinstance(command, p.SetRate):
            if not p.MIN_RATE_HZ <= command.rate_hz <= p.MAX_RATE_HZ:
                return p.AckCode.INVALID_ARGUMENT
            if command.rate_hz != self.rate_hz:
                self.rate_hz = command.rate_hz
                self._stream.set_rate(command.rate_hz, now_s)
        elif isinstance(command, p.Start):
            self._start(now_s, command.with_raw_imu)
        else:
            self._stream.stop()
            self.state = p.DeviceState.IDLE
        return p.AckCode.OK

    def _start(self, now_s: float, with_raw_imu: bool) -> None:
        self._on_start(now_s)
        self._stream.start(now_s, with_raw_imu)
        self.state = p.DeviceState.STREAMING

    def _do_once(self, command: p.Calibrate | p.Mark, now_s: float) -> None:
        """Do a command that must not be done twice, or repeat the answer to its retry."""
        answered = self._conversation.answer_to_retry(command, now_s)
        if answered is not None:
            self._ack(command.packet_type, command.command_id, answered)
            return
        code = self._calibrate(now_s) if isinstance(command, p.Calibrate) else p.AckCode.OK
        self._conversation.remember(command, code, now_s)
        self._ack(command.packet_type, command.command_id, code)
        if isinstance(command, p.Mark):
            device_time_us = self._clock.read_us(now_s) % p.DEVICE_CLOCK_MODULUS_US
            self._put(p.Event(device_time_us, p.EventKind.MARKER, command.marker))

    def _calibrate(self, now_s: float) -> p.AckCode:
        if self.state is p.DeviceState.STREAMING:
            return p.AckCode.WRONG_STATE
        if self.state is p.DeviceState.CALIBRATING:
            return p.AckCode.BUSY
        if not self._stream.is_still(now_s):
            return p.AckCode.NOT_STILL
        self.state = p.DeviceState.CALIBRATING
        self._calibrated_at_s = now_s + self.settings.calibration_s
        return p.AckCode.OK

    def _end_calibration(self, now_s: float) -> None:
        self._calibrated_at_s = np.inf
        self.state = p.DeviceState.IDLE
        if self._stream.is_still(now_s):
            self._stream.calibrated = True
        else:
            self._status.errors |= p.DeviceError.CALIBRATION
