"""What both kinds of decoder give and count: packets in wire order, and what became of every byte and frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from firmware_protocol.packets import OrientationBatch, Packet, PacketType
from firmware_protocol.sequence import SequenceCounters


@dataclass(frozen=True)
class PieceCounters:
    """What became of pieces: the part of the counters that can be added up from anywhere."""

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


@dataclass(frozen=True)
class FrameCounters(PieceCounters):
    """What a :class:`FrameDecoder` has met since it was made."""

    bytes: int = 0
    """Bytes fed."""
    pending_bytes: int = 0
    """Of these, after the last delimiter: the start of a piece yet to end. At most ``MAX_PIECE_BYTES``."""
    oversize: int = 0
    """Pieces of more than ``MAX_PIECE_BYTES``."""
    partial_starts: int = 0
    """Pieces in front of the first delimiter that are no frame: the link was opened in the middle of one. No error."""


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
