"""Packets to and from the flat tuples of numbers and bytes that stand on the wire, in wire order.

No byte order here and no offsets: :mod:`firmware_protocol.schema` has those. Checked here, in both directions,
is that every value lies in its field's range and table. Measured values beyond a field's range are sent as the end of
that range, as a sensor's own register would be; everything else that does not fit is the caller's mistake.
"""

from __future__ import annotations

import enum
import math
import operator
import unicodedata
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeAlias, TypeVar, cast

from firmware_protocol import packets as p
from firmware_protocol.errors import MalformedPacketError, PacketValueError
from firmware_protocol.packets import PacketType
from firmware_protocol.quantization import NORM_TOLERANCE, quat_from_q15, quat_to_q15

WireValues: TypeAlias = tuple[Any, ...]
"""Integers, floats and bytes, as the schema has them."""

NAME_BYTES = 32
SURFACE_BYTES = 32
SENSOR_BYTES = 24
FILTER_BYTES = 24
MAX_WEIGHTS = 8
GYRO_LSB_DPS = 2000.0 / 32768
"""One step of RAW_IMU's rate of turn: full scale ±2000 deg/s."""
ACCELERATION_LSB_G = 16.0 / 32768
"""One step of RAW_IMU's specific force: full scale ±16 g."""
TEMPERATURE_UNKNOWN = -0x8000

_FLOAT32_MAX = 3.4028234663852886e38
# Control and format characters (bidirectional overrides among them) and line separators could deceive a terminal.
_UNPRINTABLE = frozenset({"Cc", "Cf", "Zl", "Zp"})
_Enum = TypeVar("_Enum", bound=enum.IntEnum)
# A table, because calling an enumeration is five times as slow.
_MEMBERS: dict[type[enum.IntEnum], dict[int, enum.IntEnum]] = {
    kind: {int(member): member for member in kind} for kind in (p.ObjectShape, p.DeviceState, p.AckCode, p.EventKind)
}


def _integer(name: str, value: object, bits: int, low: int = 0, high: int | None = None) -> int:
    high = (1 << bits) - 1 if high is None else high
    try:
        number = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise PacketValueError(f"{name} must be an integer, not {value!r}") from None
    if not low <= number <= high:
        raise PacketValueError(f"{name} must be {low} to {high}, not {number}")
    return number


def _member(kind: type[_Enum], name: str, value: int, error: type[Exception]) -> _Enum:
    try:
        return cast(_Enum, _MEMBERS[kind][value])
    except (KeyError, TypeError):
        table = ", ".join(f"{member.value} {member.name}" for member in kind)
        raise error(f"{name} {value} is not one of {table}") from None


def _measured(name: str, steps: float, low: int = -0x7FFF) -> int:
    if math.isnan(steps):
        raise PacketValueError(f"{name} must be a number, not NaN")
    return round(min(max(steps, low), 0x7FFF))


def _real(name: str, value: float, low: float, error: type[Exception]) -> float:
    """Pass a float32 field: NaN stands for unknown, infinities and values below ``low`` are refused."""
    number = float(value)
    if math.isnan(number) or low <= number <= _FLOAT32_MAX:
        return number
    raise error(f"{name} must be a finite number" + (" of at least 0" if low == 0 else "") + f", not {number}")


def _reals(name: str, values: Sequence[float], low: float, error: type[Exception]) -> tuple[float, float, float]:
    if len(values) != 3:
        raise error(f"{name} has 3 numbers, not {len(values)}")
    a, b, c = (_real(name, value, low, error) for value in values)
    return a, b, c


def _mounting(values: Sequence[float], error: type[Exception]) -> tuple[float, float, float, float]:
    norm = math.sqrt(math.fsum(value * value for value in values)) if len(values) == 4 else math.nan
    if not abs(norm - 1.0) <= NORM_TOLERANCE:
        raise error("mounting_q_body_sensor must be a unit quaternion")
    w, x, y, z = (float(value) / norm for value in values)
    return w, x, y, z


def clean_text(text: str) -> str:
    """Return the text without control, format and line-separating characters."""
    return "".join(char for char in text if unicodedata.category(char) not in _UNPRINTABLE)


def _text_to_wire(name: str, text: str, size: int) -> bytes:
    if clean_text(text) != text:
        raise PacketValueError(f"{name} must not hold control characters: {text!r}")
    try:
        data = text.encode()
    except UnicodeEncodeError:
        raise PacketValueError(f"{name} is not valid Unicode: {text!r}") from None
    if len(data) > size:
        raise PacketValueError(f"{name} must be at most {size} bytes of UTF-8, not {len(data)}: {text!r}")
    return data.ljust(size, b"\0")


def _text_from_wire(data: bytes) -> str:
    return clean_text(data.partition(b"\0")[0].decode(errors="replace"))


def _info_to_wire(info: p.Info) -> WireValues:
    card = info.card
    if len(card.weights) > MAX_WEIGHTS:
        raise PacketValueError(f"an object has at most {MAX_WEIGHTS} weights, not {len(card.weights)}")
    if len(info.firmware_version) != 3:
        raise PacketValueError("firmware_version has 3 numbers")
    weights: list[int] = []
    for weight in card.weights:
        if not 0.0 <= weight.mass_g <= 655.355:  # also true for NaN
            raise PacketValueError(f"mass_g of a weight must be 0 to 655.35, not {weight.mass_g}")
        weights += (_integer("slot", weight.slot, 8), min(round(weight.mass_g * 100), 0xFFFF))
    return (
        _integer("protocol_major", info.protocol_major, 8),
        _integer("protocol_minor", info.protocol_minor, 8),
        _integer("device_id", info.device_id, 64),
        _integer("boot_id", info.boot_id, 32),
        *(_integer("firmware_version", number, 8) for number in info.firmware_version),
        _integer("rate_hz", info.rate_hz, 16, p.MIN_RATE_HZ, p.MAX_RATE_HZ),
        _text_to_wire("name", info.name, NAME_BYTES),
        _text_to_wire("sensor", info.sensor, SENSOR_BYTES),
        _text_to_wire("filter", info.filter, FILTER_BYTES),
        int(_member(p.ObjectShape, "shape", card.shape, PacketValueError)),
        *_reals("size_mm", card.size_mm, 0.0, PacketValueError),
        _text_to_wire("surface", card.surface, SURFACE_BYTES),
        _real("mass_g", card.mass_g, 0.0, PacketValueError),
        *_reals("com_mm", card.com_mm, -_FLOAT32_MAX, PacketValueError),
        len(card.weights),
        *weights,
        *(0,) * (2 * (MAX_WEIGHTS - len(card.weights))),
        *_mounting(card.mounting_q_body_sensor, PacketValueError),
    )


def _info_from_wire(values: WireValues) -> p.Info:
    major, minor, device_id, boot_id, *version, rate_hz, name, sensor, filter_name, shape = values[:12]
    size, surface, mass, com, n_weights = values[12:15], values[15], values[16], values[17:20], values[20]
    weights, mounting = values[21 : 21 + 2 * MAX_WEIGHTS], values[21 + 2 * MAX_WEIGHTS :]
    if not p.MIN_RATE_HZ <= rate_hz <= p.MAX_RATE_HZ:
        raise MalformedPacketError(f"rate_hz {rate_hz} is not {p.MIN_RATE_HZ} to {p.MAX_RATE_HZ}")
    if n_weights > MAX_WEIGHTS:
        raise MalformedPacketError(f"weight_count {n_weights} is more than {MAX_WEIGHTS}")
    card = p.ObjectCard(
        shape=_member(p.ObjectShape, "shape", shape, MalformedPacketError),
        size_mm=_reals("size_mm", size, 0.0, MalformedPacketError),
        surface=_text_from_wire(surface),
        mass_g=_real("mass_g", mass, 0.0, MalformedPacketError),
        com_mm=_reals("com_mm", com, -_FLOAT32_MAX, MalformedPacketError),
        weights=tuple(p.InternalWeight(weights[2 * k], weights[2 * k + 1] / 100) for k in range(n_weights)),
        mounting_q_body_sensor=_mounting(mounting, MalformedPacketError),
    )
    return p.Info(
        device_id=device_id,
        boot_id=boot_id,
        firmware_version=(version[0], version[1], version[2]),
        rate_hz=rate_hz,
        name=_text_from_wire(name),
        sensor=_text_from_wire(sensor),
        filter=_text_from_wire(filter_name),
        card=card,
        protocol_major=major,
        protocol_minor=minor,
    )


def _orientation_to_wire(packet: p.Orientation) -> WireValues:
    return (
        _integer("sequence", packet.sequence, 16),
        _integer("device_time_us", packet.device_time_us, 32),
        *quat_to_q15(packet.q_wxyz),
        _integer("flags", packet.flags, 8),
    )


def _orientation_from_wire(values: WireValues) -> p.Orientation:
    return p.Orientation(values[0], values[1], quat_from_q15(*values[2:6]), p.OrientationFlag(values[6]))


def _status_to_wire(packet: p.Status) -> WireValues:
    unknown = math.isnan(packet.temperature_c)
    return (
        _integer("uptime_us", packet.uptime_us, 64),
        int(_member(p.DeviceState, "state", packet.state, PacketValueError)),
        _integer("samples_produced", packet.samples_produced, 64),
        _integer("samples_dropped", packet.samples_dropped, 32),
        _integer("battery_mv", packet.battery_mv, 16),
        # Multiplied by a power of ten, not divided by its inexact reciprocal: what was decoded encodes to itself.
        TEMPERATURE_UNKNOWN if unknown else _measured("temperature_c", 100 * packet.temperature_c),
        *(_measured("gyro_bias_dps", 1000 * bias) for bias in _three("gyro_bias_dps", packet.gyro_bias_dps)),
        _integer("errors", packet.errors, 16),
    )


def _status_from_wire(values: WireValues) -> p.Status:
    uptime_us, state, produced, dropped, battery_mv, temperature, x, y, z, errors = values
    return p.Status(
        uptime_us,
        _member(p.DeviceState, "state", state, MalformedPacketError),
        produced,
        dropped,
        battery_mv,
        math.nan if temperature == TEMPERATURE_UNKNOWN else temperature / 100,
        (x / 1000, y / 1000, z / 1000),
        p.DeviceError(errors),
    )


def _three(name: str, values: Sequence[float]) -> Sequence[float]:
    if len(values) != 3:
        raise PacketValueError(f"{name} has 3 numbers, not {len(values)}")
    return values


def _raw_imu_to_wire(packet: p.RawImu) -> WireValues:
    return (
        _integer("sequence", packet.sequence, 16),
        _integer("device_time_us", packet.device_time_us, 32),
        *(_measured("gyro_dps", rate / GYRO_LSB_DPS, -0x8000) for rate in _three("gyro_dps", packet.gyro_dps)),
        *(
            _measured("acceleration_g", force / ACCELERATION_LSB_G, -0x8000)
            for force in _three("acceleration_g", packet.acceleration_g)
        ),
    )


def _raw_imu_from_wire(values: WireValues) -> p.RawImu:
    sequence, device_time_us, gx, gy, gz, ax, ay, az = values
    return p.RawImu(
        sequence,
        device_time_us,
        (gx * GYRO_LSB_DPS, gy * GYRO_LSB_DPS, gz * GYRO_LSB_DPS),
        (ax * ACCELERATION_LSB_G, ay * ACCELERATION_LSB_G, az * ACCELERATION_LSB_G),
    )


def _start_from_wire(values: WireValues) -> p.Start:
    if values[1] > 1:
        raise MalformedPacketError(f"with_raw_imu {values[1]} is neither 0 nor 1")
    return p.Start(values[0], bool(values[1]))


def _as_they_stand(kind: Callable[..., p.Packet], values: WireValues) -> p.Packet:
    return kind(*values)


def _id(packet: p.Command | p.TimeReply | p.Ack) -> int:
    return _integer("command_id", packet.command_id, 8)


_PLAIN = (p.TimeReply, p.GetInfo, p.Stop, p.SetRate, p.Identify, p.Calibrate, p.TimeRequest, p.Mark)
"""Packets whose fields are their wire values: every value is allowed."""

TO_WIRE: dict[PacketType, Callable[[Any], WireValues]] = {
    PacketType.INFO: _info_to_wire,
    PacketType.ORIENTATION: _orientation_to_wire,
    PacketType.STATUS: _status_to_wire,
    PacketType.RAW_IMU: _raw_imu_to_wire,
    PacketType.ACK: lambda ack: (
        _integer("command_type", ack.command_type, 8),
        _id(ack),
        int(_member(p.AckCode, "code", ack.code, PacketValueError)),
    ),
    PacketType.TIME_REPLY: lambda reply: (
        _id(reply),
        _integer("receive_uptime_us", reply.receive_uptime_us, 64),
        _integer("transmit_uptime_us", reply.transmit_uptime_us, 64),
    ),
    PacketType.EVENT: lambda event: (
        _integer("device_time_us", event.device_time_us, 32),
        int(_member(p.EventKind, "kind", event.kind, PacketValueError)),
        _integer("value", event.value, 16),
    ),
    PacketType.START: lambda command: (_id(command), _integer("with_raw_imu", command.with_raw_imu, 8, 0, 1)),
    # Any rate can be asked for: the object refuses what it cannot do.
    PacketType.SET_RATE: lambda command: (_id(command), _integer("rate_hz", command.rate_hz, 16)),
    PacketType.IDENTIFY: lambda command: (_id(command), _integer("duration_s", command.duration_s, 8)),
    PacketType.MARK: lambda command: (_id(command), _integer("marker", command.marker, 16)),
    **{kind.packet_type: lambda command: (_id(command),) for kind in (p.GetInfo, p.Stop, p.Calibrate, p.TimeRequest)},
}
"""Flat wire values of a packet, by type. Raise :class:`PacketValueError`."""

FROM_WIRE: dict[PacketType, Callable[[WireValues], p.Packet]] = {
    PacketType.INFO: _info_from_wire,
    PacketType.ORIENTATION: _orientation_from_wire,
    PacketType.STATUS: _status_from_wire,
    PacketType.RAW_IMU: _raw_imu_from_wire,
    PacketType.ACK: lambda values: p.Ack(
        values[0], values[1], _member(p.AckCode, "code", values[2], MalformedPacketError)
    ),
    PacketType.EVENT: lambda values: p.Event(
        values[0], _member(p.EventKind, "kind", values[1], MalformedPacketError), values[2]
    ),
    PacketType.START: _start_from_wire,
    **{kind.packet_type: partial(_as_they_stand, kind) for kind in _PLAIN},
}
"""Packet of its flat wire values, by type. Raise :class:`MalformedPacketError`."""
