"""Bytes of a serial link in, packets out: the way every host reads.

``StreamDecoder`` joins framing, packet codec and sequence numbers. Every frame counts once::

    frames = sum of packets + malformed + unknown_types + unsupported_versions
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from firmware_protocol import codec
from firmware_protocol.errors import MalformedPacketError, UnknownPacketTypeError, UnsupportedVersionError
from firmware_protocol.packets import Command, Info, Orientation, OrientationBatch, Packet, PacketType
from firmware_protocol.sequence import SequenceCounters, SequenceTracker
from firmware_protocol.serial_framing import FrameCounters, FrameDecoder, encode_frame


@dataclass(frozen=True, slots=True)
class ForeignInfo:
    """INFO of an object that speaks another major version; nothing but the version can be read."""

    protocol_major: int
    """u8."""
    protocol_minor: int
    """u8."""


StreamItem: TypeAlias = OrientationBatch | Packet | ForeignInfo
"""What a stream is made of; single ORIENTATION packets come as batches only."""


@dataclass(frozen=True)
class StreamCounters(FrameCounters, SequenceCounters):
    """What a :class:`StreamDecoder` has met since it was made; a frozen snapshot."""

    packets: Mapping[PacketType, int] = field(default_factory=lambda: MappingProxyType({}))
    """Packets delivered, by type; types not met are absent."""
    malformed: int = 0
    """Frames whose packet cannot be what its type byte says: too short, a value outside its table, a norm off."""
    unknown_types: int = 0
    """Frames of a packet type of a newer minor version."""
    unsupported_versions: int = 0
    """INFO packets of another major version."""
    extended: int = 0
    """Of the packets delivered, those with fields of a newer minor version at their end."""


def encode_command(command: Command) -> bytes:
    """Return the frame of a command.

    Raises
    ------
    PacketValueError
        A value does not fit its field.
    """
    return encode_frame(codec.encode_packet(command))


class StreamDecoder:
    """Turn the bytes of one link into packets, in wire order, however they are cut into chunks.

    ``feed`` never blocks and never raises on bytes from the wire. The packets and counters after n bytes depend on
    these bytes alone; only where one :class:`OrientationBatch` ends and the next begins depends on the chunks.
    Duplicates and late samples are delivered as they came: the counters tell how many there are.
    """

    def __init__(self) -> None:
        self._frames = FrameDecoder()
        self._sequence = SequenceTracker()
        self._boot_id: int | None = None
        self._packets: dict[PacketType, int] = {}
        self._malformed = 0
        self._unknown_types = 0
        self._unsupported_versions = 0
        self._extended = 0

    @property
    def counters(self) -> StreamCounters:
        """Snapshot of the counters."""
        return StreamCounters(
            **asdict(self._frames.counters),
            **asdict(self._sequence.counters),
            packets=MappingProxyType(dict(self._packets)),
            malformed=self._malformed,
            unknown_types=self._unknown_types,
            unsupported_versions=self._unsupported_versions,
            extended=self._extended,
        )

    def restart(self) -> None:
        """Begin anew after the link was cut: bytes pending are skipped, the next sequence number is not compared.

        The counters go on.
        """
        self._frames.restart()
        self._sequence.restart()

    def feed(self, data: bytes) -> list[StreamItem]:
        """Take what one read returned; return what it completed, in wire order.

        ORIENTATION packets with nothing else between them come as one :class:`OrientationBatch`.
        """
        items: list[StreamItem] = []
        samples: list[Orientation] = []
        for packet_bytes in self._frames.feed(data):
            item = self._decode(packet_bytes)
            if isinstance(item, Orientation):
                samples.append(item)
            elif item is not None:
                if samples:
                    items.append(self._batch(samples))
                    samples = []
                if isinstance(item, Info):
                    self._meet(item)
                items.append(item)
        if samples:
            items.append(self._batch(samples))
        return items

    def _decode(self, data: bytes) -> Packet | ForeignInfo | None:
        try:
            packet = codec.decode_packet(data)
        except MalformedPacketError:
            self._malformed += 1
            return None
        except UnknownPacketTypeError:
            self._unknown_types += 1
            return None
        except UnsupportedVersionError as error:
            self._unsupported_versions += 1
            return ForeignInfo(error.protocol_major, error.protocol_minor)
        self._packets[packet.packet_type] = self._packets.get(packet.packet_type, 0) + 1
        self._extended += codec.is_extended(data)
        return packet

    def _meet(self, info: Info) -> None:
        if self._boot_id is not None and info.boot_id != self._boot_id:
            self._sequence.restart()  # the object was reset: its numbers begin anew, and nothing is lost
        self._boot_id = info.boot_id

    def _batch(self, samples: list[Orientation]) -> OrientationBatch:
        self._sequence.feed(sample.sequence for sample in samples)
        return OrientationBatch(
            sequence=np.array([sample.sequence for sample in samples], dtype=np.uint16),
            device_time_us=np.array([sample.device_time_us for sample in samples], dtype=np.uint32),
            quats_wxyz=np.array([sample.q_wxyz for sample in samples], dtype=np.float64),
            flags=np.array([sample.flags for sample in samples], dtype=np.uint8),
        )
