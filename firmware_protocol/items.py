"""What both kinds of decoder deliver and count: packets in wire order, and what became of every byte and frame."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from firmware_protocol import codec
from firmware_protocol.errors import MalformedPacketError, UnknownPacketTypeError, UnsupportedVersionError
from firmware_protocol.packets import OrientationBatch, Packet, PacketType

Tally: TypeAlias = Counter[str]
"""Where decoders count, by the names of the counters below."""


@dataclass(frozen=True)
class FrameCounters:
    """What a frame decoder has met since it was made; a snapshot."""

    bytes: int = 0
    """Bytes received."""
    pending_bytes: int = 0
    """Of these, after the last delimiter: the start of a piece yet to end. At most ``MAX_PIECE_BYTES``."""
    delimiters: int = 0
    """0x00 bytes."""
    frames: int = 0
    """Frames with the right checksum."""
    frame_bytes: int = 0
    """Bytes inside these frames (COBS form, without delimiters)."""
    skipped_bytes: int = 0
    """Bytes that are neither frame nor delimiter: damaged pieces, text, noise."""
    cobs_errors: int = 0
    """Pieces that are not COBS."""
    crc_errors: int = 0
    """Pieces with a wrong checksum, or too short to have one."""
    oversize: int = 0
    """Pieces of more than ``MAX_PIECE_BYTES``."""
    partial_starts: int = 0
    """Pieces in front of the first delimiter that are not frames: the link was opened within one. No error."""


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
class StreamCounters(FrameCounters):
    """What a stream decoder has met since it was made; a snapshot."""

    packets: Mapping[PacketType, int] = field(default_factory=lambda: MappingProxyType({}))
    """Packets delivered, by type; types not met are absent."""
    malformed: int = 0
    """Frames whose packet cannot be that of its type byte: too short, a value outside its table, a norm off."""
    unknown_types: int = 0
    """Frames of a packet type of a newer minor version."""
    unsupported_versions: int = 0
    """INFO packets of another major version."""
    extended: int = 0
    """Of the packets delivered, those with fields of a newer minor version at their end."""


@dataclass(frozen=True, slots=True, eq=False)
class LocatedPackets:
    """The packets of many reads put end to end, and where in them each packet is complete."""

    samples: OrientationBatch
    """All n samples, in wire order."""
    ends: npt.NDArray[np.int64] | None
    """(n,) of bytes, the place of the delimiter behind each sample; of CAN frames, which frame it is. None where not
    wanted."""
    others: Sequence[tuple[int, Packet | ForeignInfo, int]]
    """Every other packet, in wire order: before which of the samples it came, the packet, and where it is complete."""

    def items(self) -> list[StreamItem]:
        """Return all packets in wire order; samples with nothing else between them come as one batch."""
        return in_wire_order(self.samples, ((position, packet) for position, packet, _ in self.others))


def in_wire_order(samples: OrientationBatch, others: Iterable[tuple[int, Packet | ForeignInfo]]) -> list[StreamItem]:
    """Return samples and other packets in wire order; samples with nothing else between them come as one batch.

    With each of the others, in order, stands before which of the samples it came.
    """
    items: list[StreamItem] = []
    delivered, n = 0, len(samples)
    for position, packet in others:
        if position > delivered:
            items.append(samples.part(slice(delivered, position)))
            delivered = position
        items.append(packet)
    if n > delivered:
        items.append(samples.part(slice(delivered, n)) if delivered else samples)
    return items


def decode_counted(data: bytes, tally: Tally) -> Packet | ForeignInfo | None:
    """Return the packet of its bytes; None where there is none. What is unusual about it is counted."""
    try:
        packet = codec.decode_packet(data)
    except MalformedPacketError:
        tally["malformed"] += 1
        return None
    except UnknownPacketTypeError:
        tally["unknown_types"] += 1
        return None
    except UnsupportedVersionError as error:
        tally["unsupported_versions"] += 1
        return ForeignInfo(error.protocol_major, error.protocol_minor)
    if codec.is_extended(data):
        tally["extended"] += 1
    return packet
