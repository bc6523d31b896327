"""One packet to and from its bytes (type byte first; no framing).

What an object sends again and again goes through :mod:`struct`, runs of samples through numpy; INFO and the commands
go through the schema, whose import is put off until then (construct takes 0.1 s to load). Tests hold all three equal,
field by field.
"""

from __future__ import annotations

import struct

import numpy as np

from firmware_protocol.errors import MalformedPacketError, UnknownPacketTypeError, UnsupportedVersionError
from firmware_protocol.packets import PROTOCOL_MAJOR, Packet, PacketType
from firmware_protocol.wire_values import FROM_WIRE, TO_WIRE

STREAMED: dict[PacketType, struct.Struct] = {
    PacketType.ORIENTATION: struct.Struct("<BHI4hB"),
    PacketType.STATUS: struct.Struct("<BQBQIHhhhhH"),
    PacketType.RAW_IMU: struct.Struct("<BHI6h"),
    PacketType.ACK: struct.Struct("<BBBB"),
    PacketType.TIME_REPLY: struct.Struct("<BBQQ"),
    PacketType.EVENT: struct.Struct("<BIBH"),
}
"""Layouts of the frequent packets, type byte first: the schema's, for speed."""
ORIENTATION_DTYPE = np.dtype(
    [("type", "u1"), ("sequence", "<u2"), ("device_time_us", "<u4"), ("q", "<i2", (4,)), ("flags", "u1")]
)
"""The layout of ORIENTATION once more, for runs of samples."""
FIELDS = {
    int(packet_type): struct.Struct("<" + layout.format[2:]).unpack_from for packet_type, layout in STREAMED.items()
}
"""By type byte, what unpacks the fields behind it: ``FIELDS[data[0]](data, 1)``."""

# By type byte, because making an enum member of it takes as long as the rest: size, fields of data[1:], meaning.
_STREAMED_BYTES = {
    int(packet_type): (layout.size, FIELDS[packet_type], FROM_WIRE[packet_type])
    for packet_type, layout in STREAMED.items()
}


def is_extended(data: bytes) -> bool:
    """Return whether a packet that :func:`decode_packet` accepts has fields of a newer minor version at its end."""
    if data[0] in _STREAMED_BYTES:
        return len(data) > _STREAMED_BYTES[data[0]][0]
    from firmware_protocol import schema

    return len(data) > schema.PACKET_BYTES[PacketType(data[0])]


def encode_packet(packet: Packet) -> bytes:
    """Return the bytes of a packet: type byte, then its fields.

    Raises
    ------
    PacketValueError
        A value does not fit its field; the message names it.
    """
    packet_type = packet.packet_type
    values = TO_WIRE[packet_type](packet)
    layout = STREAMED.get(packet_type)
    if layout is not None:
        return layout.pack(packet_type, *values)
    from firmware_protocol import schema

    return schema.build(packet_type, values)


def decode_packet(data: bytes) -> Packet:
    """Return the packet of its bytes. Bytes behind the last known field belong to a newer minor version: ignored.

    Control characters are removed from texts, bytes that are not UTF-8 become U+FFFD; quaternions come back unit.

    Raises
    ------
    UnknownPacketTypeError
        The first byte is not a packet type of this version.
    UnsupportedVersionError
        INFO of an object with another major version; only its version is read.
    MalformedPacketError
        Empty, too short, or a value outside its field's range or table.
    """
    if not data:
        raise MalformedPacketError("a packet has at least its type byte")
    streamed = _STREAMED_BYTES.get(data[0])
    if streamed is not None:
        size, unpack_from, packet_from = streamed
        if len(data) < size:
            raise MalformedPacketError(f"{PacketType(data[0]).name} packet of {len(data)} bytes is too short")
        return packet_from(unpack_from(data, 1))
    try:
        packet_type = PacketType(data[0])
    except ValueError:
        name = f"packet type 0x{data[0]:02X}"
        raise UnknownPacketTypeError(f"{name} is not known to this version of the protocol") from None
    if packet_type is PacketType.INFO and len(data) >= 3 and data[1] != PROTOCOL_MAJOR:
        raise UnsupportedVersionError(data[1], data[2])
    from firmware_protocol import schema

    return FROM_WIRE[packet_type](schema.parse(data))
