"""The field table of every packet, as the schema defines it: for the pages, the DBC file and what compares them."""

from __future__ import annotations

from dataclasses import dataclass

from construct import Array, Const, Construct, FormatField, Renamed, Struct

from firmware_protocol.packets import PacketType
from firmware_protocol.schema import SCHEMA


@dataclass(frozen=True, slots=True)
class FieldRow:
    """One row of a packet's field table."""

    offset: int
    """Bytes from the start of the packet; the type byte is at 0."""
    wire_type: str
    """``u8 u16 u32 u64 i16 f32 char``, with ``[n]`` where there are n of them; ``{u8, u16}[n]`` for records."""
    size: int
    """Bytes."""
    name: str
    """Field name, as in the packet's dataclass."""


_NUMBER_NAMES = {"<B": "u8", "<H": "u16", "<L": "u32", "<Q": "u64", "<h": "i16", "<f": "f32"}


def _wire_type(field: Construct) -> str:
    if isinstance(field, Renamed | Const):
        return _wire_type(field.subcon)
    if isinstance(field, Array):
        return f"{_wire_type(field.subcon)}[{field.count}]"
    if isinstance(field, Struct):
        return "{" + ", ".join(_wire_type(part) for part in field.subcons) + "}"
    if isinstance(field, FormatField):
        # construct writes the one-byte number big endian, where order means nothing.
        return _NUMBER_NAMES["<" + field.fmtstr[1:]]
    return f"char[{field.sizeof()}]"


def field_rows(packet_type: PacketType) -> tuple[FieldRow, ...]:
    """Return the field table of a packet as the schema defines it, type byte first."""
    rows = []
    offset = 0
    for field in SCHEMA[packet_type].subcons:
        rows.append(FieldRow(offset, _wire_type(field), field.sizeof(), field.name))
        offset += field.sizeof()
    return tuple(rows)
