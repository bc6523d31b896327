"""The normative description of the bytes, in construct: every packet, field by field, little endian.

Nothing else imports construct. The names are those of :mod:`firmware_protocol.packets`; units and scales stand in
``docs/protocol.md``, whose tables a test compares with :data:`SCHEMA`. A packet is its type byte and its fields, with
no padding; a newer minor version may add bytes behind the last field, so parsing ignores what follows.

Other modules see a packet's fields as one flat tuple of numbers and bytes, in wire order (:func:`parse`,
:func:`build`).
"""
# mypy: allow-untyped-calls

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

from construct import (
    Array,
    Bytes,
    Const,
    Construct,
    ConstructError,
    Float32l,
    Int8ul,
    Int16sl,
    Int16ul,
    Int32ul,
    Int64ul,
    Renamed,
    Struct,
)

from firmware_protocol.errors import MalformedPacketError, PacketValueError
from firmware_protocol.packets import PacketType
from firmware_protocol.wire_values import FILTER_BYTES, MAX_WEIGHTS, NAME_BYTES, SENSOR_BYTES, SURFACE_BYTES

WireValue: TypeAlias = int | float | bytes
"""One field, or one element of an array field, as it stands on the wire."""


_WEIGHT = Struct("slot" / Int8ul, "mass_cg" / Int16ul)
_COMMAND_ID = "command_id" / Int8ul

_FIELDS: dict[PacketType, tuple[Construct, ...]] = {
    PacketType.INFO: (
        "protocol_major" / Int8ul,
        "protocol_minor" / Int8ul,
        "device_id" / Int64ul,
        "boot_id" / Int32ul,
        "firmware_version" / Int8ul[3],
        "rate_hz" / Int16ul,
        "name" / Bytes(NAME_BYTES),
        "sensor" / Bytes(SENSOR_BYTES),
        "filter" / Bytes(FILTER_BYTES),
        "shape" / Int8ul,
        "size_mm" / Float32l[3],
        "surface" / Bytes(SURFACE_BYTES),
        "mass_g" / Float32l,
        "com_mm" / Float32l[3],
        "weight_count" / Int8ul,
        "weights" / _WEIGHT[MAX_WEIGHTS],
        "mounting_q_body_sensor" / Float32l[4],
    ),
    PacketType.ORIENTATION: (
        "sequence" / Int16ul,
        "device_time_us" / Int32ul,
        "q_wxyz" / Int16sl[4],
        "flags" / Int8ul,
    ),
    PacketType.STATUS: (
        "uptime_us" / Int64ul,
        "state" / Int8ul,
        "samples_produced" / Int64ul,
        "samples_dropped" / Int32ul,
        "battery_mv" / Int16ul,
        "temperature_c" / Int16sl,
        "gyro_bias_dps" / Int16sl[3],
        "errors" / Int16ul,
    ),
    PacketType.RAW_IMU: (
        "sequence" / Int16ul,
        "device_time_us" / Int32ul,
        "gyro_dps" / Int16sl[3],
        "acceleration_g" / Int16sl[3],
    ),
    PacketType.ACK: ("command_type" / Int8ul, _COMMAND_ID, "code" / Int8ul),
    PacketType.TIME_REPLY: (_COMMAND_ID, "receive_uptime_us" / Int64ul, "transmit_uptime_us" / Int64ul),
    PacketType.EVENT: ("device_time_us" / Int32ul, "kind" / Int8ul, "value" / Int16ul),
    PacketType.GET_INFO: (_COMMAND_ID,),
    PacketType.START: (_COMMAND_ID, "with_raw_imu" / Int8ul),
    PacketType.STOP: (_COMMAND_ID,),
    PacketType.SET_RATE: (_COMMAND_ID, "rate_hz" / Int16ul),
    PacketType.IDENTIFY: (_COMMAND_ID, "duration_s" / Int8ul),
    PacketType.CALIBRATE: (_COMMAND_ID,),
    PacketType.TIME_REQUEST: (_COMMAND_ID,),
    PacketType.MARK: (_COMMAND_ID, "marker" / Int16ul),
}
SCHEMA: dict[PacketType, Struct] = {
    packet_type: Struct("packet_type" / Const(int(packet_type), Int8ul), *fields)
    for packet_type, fields in _FIELDS.items()
}
"""Every packet of this version."""

PACKET_BYTES: dict[PacketType, int] = {packet_type: struct.sizeof() for packet_type, struct in SCHEMA.items()}
"""Size of each packet with its type byte; in this version every packet has a fixed size."""


def _flatten(value: Any) -> Iterator[WireValue]:  # noqa: ANN401 (construct's own containers)
    if isinstance(value, dict):
        for name, part in value.items():
            if name != "_io":
                yield from _flatten(part)
    elif isinstance(value, list):
        for part in value:
            yield from _flatten(part)
    else:
        yield value


def _unflatten(field: Construct, values: Iterator[WireValue]) -> Any:  # noqa: ANN401
    if isinstance(field, Renamed):
        return _unflatten(field.subcon, values)
    if isinstance(field, Array):
        return [_unflatten(field.subcon, values) for _ in range(field.count)]
    if isinstance(field, Struct):
        return {part.name: _unflatten(part, values) for part in field.subcons}
    return next(values)


def parse(data: bytes) -> tuple[WireValue, ...]:
    """Return the fields behind the type byte, flat and in wire order; bytes behind the last field are ignored.

    Raises
    ------
    MalformedPacketError
        The packet is too short.
    KeyError
        The first byte is not a :class:`PacketType`.
    """
    try:
        container = SCHEMA[PacketType(data[0])].parse(data)
    except ConstructError as error:
        raise MalformedPacketError(f"{PacketType(data[0]).name} packet of {len(data)} bytes is too short") from error
    return tuple(_flatten(container))[1:]


def build(packet_type: PacketType, values: Sequence[WireValue]) -> bytes:
    """Return the bytes of a packet, type byte first, from its flat fields.

    Raises
    ------
    PacketValueError
        A value does not fit its field.
    """
    flat = iter((int(packet_type), *values))
    try:
        built: bytes = SCHEMA[packet_type].build(_unflatten(SCHEMA[packet_type], flat))
    except ConstructError as error:
        raise PacketValueError(f"{packet_type.name}: a value does not fit its field") from error
    return built
