"""Everything an object sends on CAN but samples: short packets, STATUS pages, readings, long packets."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from firmware_protocol.can.iso_tp import LongPacketChannel
from firmware_protocol.can.mapping import (
    FUNCTION_MASK,
    HOST_FUNCTIONS,
    IMU_LAYOUT,
    NODE_MASK,
    SEQUENCE_MODULUS,
    STATUS_PAGES,
    WHOLE,
    CanFunction,
    status_values,
)
from firmware_protocol.can.timeline import Timeline
from firmware_protocol.errors import MalformedPacketError
from firmware_protocol.items import ForeignInfo, Tally, decode_counted
from firmware_protocol.packets import Packet, PacketType
from firmware_protocol.wire_values import FROM_WIRE

_ORIENTATION = bytes([PacketType.ORIENTATION])


class RareFrames:
    """The rare packets of one object; what is not delivered is counted in the tally."""

    def __init__(self, tally: Tally) -> None:
        self._tally = tally
        self._channels: dict[bool, LongPacketChannel] = {}
        self._pages: list[bytes] = []
        self._reading: tuple[int, int] | None = None
        self._gyro: tuple[int, ...] | None = None
        self.packets: Counter[PacketType] = Counter()
        """Packets delivered, by type."""

    def restart(self) -> None:
        """Forget packets of which a part has come."""
        self._channels.clear()
        self._pages = []
        self._reading = self._gyro = None

    def feed(
        self,
        function: int,
        record: Any,  # noqa: ANN401 (a numpy record)
        reference: int | None,
        timeline: Timeline,
    ) -> list[Packet | ForeignInfo]:
        """Process one record of a frame array, whose length is right for its function; return what it completes.

        Parameters
        ----------
        function : int
            Bits 5-10 of the arbitration id.
        record : numpy.void
            The frame.
        reference, timeline : int or None, Timeline
            Counter of the sample before it, and the object's times: for RAW_IMU.
        """
        data = record["data"].tobytes()[: int(record["length"])]
        kind = function & FUNCTION_MASK
        is_whole = function >= WHOLE
        if kind in HOST_FUNCTIONS:
            self._tally["host_frames"] += 1
            return []
        if kind == CanFunction.LONG_FROM_OBJECT:
            packets = self._channel(int(record["arbitration_id"]) & NODE_MASK, is_whole).feed(data)
            return [item for packet in packets if (item := self._decode(packet)) is not None]
        item = self._decode(data[1 : 1 + data[0]]) if is_whole else self._classic(kind, data, reference, timeline)
        return [] if item is None else [item]

    def _channel(self, node: int, fd: bool) -> LongPacketChannel:
        if fd not in self._channels:
            self._channels[fd] = LongPacketChannel(node, is_object=False, fd=fd, listens_only=True, tally=self._tally)
        return self._channels[fd]

    def _classic(
        self, kind: int, data: bytes, reference: int | None, timeline: Timeline
    ) -> Packet | ForeignInfo | None:
        if kind == CanFunction.STATUS:
            return self._status_page(data)
        if kind == CanFunction.TIME_REPLY_RECEIVE:
            self._reading = data[0], int.from_bytes(data[1:], "little")
            return None
        if kind == CanFunction.TIME_REPLY_TRANSMIT:
            reading, self._reading = self._reading, None
            if reading is None or reading[0] != data[0]:
                self._tally["malformed"] += 1
                return None
            return self._known(PacketType.TIME_REPLY, (*reading, int.from_bytes(data[1:], "little")))
        if kind == CanFunction.RAW_GYRO:
            self._gyro = IMU_LAYOUT.unpack(data)
            return None
        if kind == CanFunction.RAW_ACCELERATION:
            return self._raw_imu(IMU_LAYOUT.unpack(data), reference, timeline)
        return self._decode(data)

    def _status_page(self, data: bytes) -> Packet | None:
        page = data[0]
        if page != len(self._pages):
            # That a listener comes in the middle is not a fault; that a page is missing after others is.
            self._tally["malformed"] += bool(self._pages)
            self._pages = [] if page else [data]
            return None
        self._pages.append(data)
        if len(self._pages) < STATUS_PAGES:
            return None
        pages, self._pages = tuple(self._pages), []
        return self._known(PacketType.STATUS, status_values(pages))

    def _raw_imu(self, acceleration: tuple[int, ...], reference: int | None, timeline: Timeline) -> Packet | None:
        gyro, self._gyro = self._gyro, None
        if gyro is None or gyro[0] != acceleration[0]:
            self._tally["malformed"] += 1
            return None
        if reference is None or not timeline.is_known:
            return None
        half = SEQUENCE_MODULUS // 2
        counter = reference + (gyro[0] - reference + half) % SEQUENCE_MODULUS - half
        time_us = int(timeline.device_times_us(np.array([counter]))[0])
        return self._known(PacketType.RAW_IMU, (counter & 0xFFFF, time_us, *gyro[1:], *acceleration[1:]))

    def _known(self, packet_type: PacketType, values: tuple[int, ...]) -> Packet | None:
        try:
            packet = FROM_WIRE[packet_type](values)
        except MalformedPacketError:
            self._tally["malformed"] += 1
            return None
        self.packets[packet_type] += 1
        return packet

    def _decode(self, data: bytes) -> Packet | ForeignInfo | None:
        if data[:1] == _ORIENTATION:  # has frames of its own
            self._tally["malformed"] += 1
            return None
        item = decode_counted(data, self._tally)
        if item is not None and not isinstance(item, ForeignInfo):
            self.packets[item.packet_type] += 1
        return item
