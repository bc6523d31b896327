"""Encoded packets in, CAN frames out: the object's end of the bus, and the host's commands."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from firmware_protocol.can.frames import CLASSIC_BYTES, FD_BYTES, CanFrame, FrameFlag, fd_padded
from firmware_protocol.can.iso_tp import LongPacketChannel
from firmware_protocol.can.mapping import (
    ALL_NODES,
    COUNTER_MODULUS,
    GRID_TOLERANCE_US,
    IMU_LAYOUT,
    NO_ORIENTATION,
    CanFunction,
    CanId,
    arbitration_id,
    boot_tag,
    orientation_data,
    reading_data,
    sample_state_data,
    split_id,
    status_pages,
    time_data,
    time_interval,
)
from firmware_protocol.codec import ORIENTATION_DTYPE, STREAMED
from firmware_protocol.errors import PacketValueError
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US, MAX_RATE_HZ, MIN_RATE_HZ, SEQUENCE_MODULUS, PacketType
from firmware_protocol.quantization import quats_from_q15, quats_to_smallest_three

_FD_FLAGS = FrameFlag.FD | FrameFlag.BITRATE_SWITCH
_WHOLE_FUNCTIONS = {
    PacketType.ORIENTATION: CanFunction.ORIENTATION,
    PacketType.STATUS: CanFunction.STATUS,
    PacketType.RAW_IMU: CanFunction.RAW_GYRO,
    PacketType.ACK: CanFunction.ACK,
    PacketType.TIME_REPLY: CanFunction.TIME_REPLY_RECEIVE,
    PacketType.EVENT: CanFunction.EVENT,
}
"""Functions of packets that travel whole in one CAN FD frame; others go by ISO-TP."""
_IDENTITY = struct.Struct("<BBBQI")
"""Start of INFO: type, protocol version, device id, boot id."""
_INFO_RATE_OFFSET = 18
_SAME_RATE = 0.02
"""An interval off by less than this is jitter, not another rate."""


def whole_frame(function: CanFunction, node: int, packet: bytes) -> CanFrame:
    """Return the CAN FD frame of a packet: length byte, packet, zeros.

    Raises
    ------
    PacketValueError
        More than 63 bytes.
    """
    return CanFrame(arbitration_id(function, node, True), fd_padded(bytes([len(packet)]) + packet), _FD_FLAGS)


def command_frame(packet: bytes, node: int, fd: bool = False) -> CanFrame:
    """Return the frame of an encoded command.

    Parameters
    ----------
    packet : bytes
        Type byte and fields.
    node : int
        Node id of the object, 0 for all.
    fd : bool
        Whether the bus is a CAN FD one.

    Raises
    ------
    PacketValueError
        The packet is longer than a frame: no command of this version is.
    """
    if fd:
        return whole_frame(CanFunction.COMMAND, node, packet)
    if not 0 < len(packet) <= CLASSIC_BYTES:
        raise PacketValueError(f"a command of {len(packet)} bytes does not fit a classic CAN frame")
    return CanFrame(arbitration_id(CanFunction.COMMAND, node), packet)


class CanObject:
    """The object's end: its packets as frames, and the commands in frames from the host.

    Parameters
    ----------
    node : int
        Node id, 1-31.
    fd : bool
        Send whole packets in CAN FD frames.
    """

    def __init__(self, node: int, fd: bool = False) -> None:
        if node == ALL_NODES:
            raise PacketValueError("node id 0 addresses all objects and belongs to none")
        arbitration_id(CanFunction.ORIENTATION, node)
        self.node = node
        self.fd = fd
        self._long_id = CanId(CanFunction.LONG_TO_OBJECT, node, fd)
        self._channel: LongPacketChannel | None = None
        self._tag = 0
        self._rate_hz = 100
        self._counter: int | None = None
        self._time_us = 0
        self._mark: tuple[int, int] | None = None  # counter and device time of the last TIME sent
        self._state: tuple[int, int, int] | None = None  # flags, rate and tag of the last SAMPLE_STATE sent

    def encode(self, packets: Sequence[bytes]) -> list[CanFrame]:
        """Return the frames of encoded packets, in order; long ones go on when the host answers :meth:`receive`.

        Parameters
        ----------
        packets : sequence of bytes
            Type byte and fields, as :func:`~firmware_protocol.codec.encode_packet` returns them.
        """
        samples = [packet for packet in packets if packet[0] == PacketType.ORIENTATION]
        codes = iter(()) if self.fd else iter(_smallest_three(samples))
        frames: list[CanFrame] = []
        for packet in packets:
            kind = packet[0]
            if kind == PacketType.ORIENTATION:
                frames += self._sample(packet, 0 if self.fd else next(codes))
            elif kind == PacketType.INFO:
                self._learn(packet)
                frames += self._long(packet)
            elif self.fd and kind in _WHOLE_FUNCTIONS and len(packet) < FD_BYTES:
                frames.append(whole_frame(_WHOLE_FUNCTIONS[PacketType(kind)], self.node, packet))
            elif not self.fd and kind in _CLASSIC:
                frames += self._classic(PacketType(kind), packet)
            else:
                frames += self._long(packet)
        return frames

    def receive(self, frame: CanFrame) -> tuple[list[bytes], list[CanFrame]]:
        """Process one frame from the bus.

        Returns
        -------
        packets : list of bytes
            Encoded commands it completes.
        frames : list of CanFrame
            To be sent: flow control, or the rest of a long packet.
        """
        identity = split_id(frame.arbitration_id)
        unfit = frame.flags & (FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR)
        if unfit or identity is None or identity.node not in (self.node, ALL_NODES) or not frame.data:
            return [], []
        if identity.function is CanFunction.COMMAND:
            if not identity.whole_packet:
                return [frame.data], []
            if 0 < frame.data[0] < len(frame.data):
                return [frame.data[1 : 1 + frame.data[0]]], []
        elif identity == self._long_id:
            channel = self._open_channel()
            return channel.feed(frame.data), channel.take_outgoing()
        return [], []

    def poll(self) -> list[CanFrame]:
        """Return frames of long packets that are due by now; lets their time-outs pass."""
        if self._channel is None:
            return []
        self._channel.poll()
        return self._channel.take_outgoing()

    def reset(self) -> None:
        """Forget everything, as power-up does; what a listener needs is sent again with the next sample."""
        self._channel = None
        self._counter = self._mark = self._state = None

    def _open_channel(self) -> LongPacketChannel:
        if self._channel is None:
            self._channel = LongPacketChannel(self.node, is_object=True, fd=self.fd)
        return self._channel

    def _long(self, packet: bytes) -> list[CanFrame]:
        channel = self._open_channel()
        channel.send(packet)
        return channel.take_outgoing()

    def _learn(self, info: bytes) -> None:
        _, _, _, device_id, boot_id = _IDENTITY.unpack_from(info)
        (self._rate_hz,) = struct.unpack_from("<H", info, _INFO_RATE_OFFSET)
        tag = boot_tag(device_id, boot_id)
        if tag != self._tag:
            self._tag = tag
            self._counter = self._mark = self._state = None

    def _sample(self, packet: bytes, code: int) -> list[CanFrame]:
        _, sequence, time_us, _, _, _, _, flags = STREAMED[PacketType.ORIENTATION].unpack(packet)
        counter = self._follow(sequence, time_us)
        sent, self._state = self._state, (flags, self._rate_hz, self._tag)
        due = self._mark is None or self._is_due(counter, self._mark[0])
        frames = []
        if sent != self._state or due:
            data = sample_state_data(counter, *self._state)
            frames.append(CanFrame(arbitration_id(CanFunction.SAMPLE_STATE, self.node), data))
        if due or self._off_grid(counter, time_us) or (sent is not None and sent[1] != self._rate_hz):
            self._mark = counter, time_us
            frames.append(CanFrame(arbitration_id(CanFunction.TIME, self.node), time_data(counter, time_us)))
        if self.fd:
            frames.append(whole_frame(CanFunction.ORIENTATION, self.node, packet))
        else:
            identifier = arbitration_id(CanFunction.ORIENTATION, self.node)
            frames.append(CanFrame(identifier, orientation_data(counter, code)))
        return frames

    def _follow(self, sequence: int, time_us: int) -> int:
        """Return the full counter of a sample, and keep the rate by the times of samples."""
        if self._counter is None:
            self._counter, self._time_us = sequence, time_us
            return sequence
        half = SEQUENCE_MODULUS // 2
        step = (sequence - self._counter + half) % SEQUENCE_MODULUS - half
        if step <= 0:  # a fault of the object: repeated or late
            return self._counter + step
        elapsed_us = (time_us - self._time_us) % DEVICE_CLOCK_MODULUS_US
        expected_us = step * 1_000_000 / self._rate_hz
        if elapsed_us and abs(elapsed_us - expected_us) > _SAME_RATE * expected_us:
            rate_hz = round(step * 1_000_000 / elapsed_us)
            if MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:  # else a pause or a jump of the clock
                self._rate_hz = rate_hz
        self._counter = (self._counter + step) % COUNTER_MODULUS
        self._time_us = time_us
        return self._counter

    def _is_due(self, counter: int, last: int) -> bool:
        interval = time_interval(self._rate_hz)
        return counter // interval != last // interval

    def _off_grid(self, counter: int, time_us: int) -> bool:
        assert self._mark is not None
        mark_counter, mark_time_us = self._mark
        steps = (counter - mark_counter) * 1_000_000
        expected_us = mark_time_us + (2 * steps + self._rate_hz) // (2 * self._rate_hz)  # as sample_times_us
        half = DEVICE_CLOCK_MODULUS_US // 2
        error_us = (time_us - expected_us + half) % DEVICE_CLOCK_MODULUS_US - half
        return abs(error_us) > GRID_TOLERANCE_US

    def _classic(self, packet_type: PacketType, packet: bytes) -> list[CanFrame]:
        values = STREAMED[packet_type].unpack(packet)[1:]
        node = self.node
        if packet_type is PacketType.STATUS:
            return [CanFrame(arbitration_id(CanFunction.STATUS, node), page) for page in status_pages(values)]
        if packet_type is PacketType.RAW_IMU:
            sequence, _, *axes = values
            gyro, acceleration = (IMU_LAYOUT.pack(sequence & 0xFF, *three) for three in (axes[:3], axes[3:]))
            return [
                CanFrame(arbitration_id(CanFunction.RAW_GYRO, node), gyro),
                CanFrame(arbitration_id(CanFunction.RAW_ACCELERATION, node), acceleration),
            ]
        if packet_type is PacketType.TIME_REPLY:
            command_id, receive, transmit = values
            return [
                CanFrame(arbitration_id(CanFunction.TIME_REPLY_RECEIVE, node), reading_data(command_id, receive)),
                CanFrame(arbitration_id(CanFunction.TIME_REPLY_TRANSMIT, node), reading_data(command_id, transmit)),
            ]
        function = CanFunction.ACK if packet_type is PacketType.ACK else CanFunction.EVENT
        return [CanFrame(arbitration_id(function, node), packet)]


_CLASSIC = frozenset(_WHOLE_FUNCTIONS) - {PacketType.ORIENTATION}


def _smallest_three(samples: Sequence[bytes]) -> list[int]:
    if not samples:
        return []
    quats, good = quats_from_q15(np.frombuffer(b"".join(samples), ORIENTATION_DTYPE)["q"])
    quats[~good] = (1.0, 0.0, 0.0, 0.0)
    codes = quats_to_smallest_three(quats)
    codes[~good] = NO_ORIENTATION
    listed: list[int] = codes.tolist()
    return listed
