"""What can go wrong at the wire.

ProtocolError                   base of everything this package raises on purpose
├── MalformedPacketError        bytes that cannot be the packet of their type byte: too short, a value outside its table
├── UnknownPacketTypeError      a first byte that is not a packet type of this version: the object has a newer minor one
├── UnsupportedVersionError     INFO of an object that speaks another major version
└── PacketValueError            our own caller's mistake: a value that the wire cannot carry

Only the one-packet functions of :mod:`firmware_protocol.codec` raise the first three. The stream decoders turn them
into counters: bytes from a wire never raise.
"""

from __future__ import annotations


class ProtocolError(Exception):
    """Base of everything this package raises on purpose."""


class MalformedPacketError(ProtocolError):
    """Bytes that cannot be the packet their first byte announces; the message names the field."""


class UnknownPacketTypeError(ProtocolError):
    """A packet type that this version does not know; the message names it."""


class UnsupportedVersionError(ProtocolError):
    """INFO of an object that speaks another major version; nothing but that version can be trusted."""

    def __init__(self, protocol_major: int, protocol_minor: int) -> None:
        super().__init__(f"the object speaks protocol version {protocol_major}.{protocol_minor}")
        self.protocol_major = protocol_major
        self.protocol_minor = protocol_minor


class PacketValueError(ProtocolError, ValueError):
    """A value that the wire cannot carry; the message names the field and its range."""
