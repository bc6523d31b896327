"""The shipped DBC file, made from the tables that the code itself uses: ``python -m docs.can_dbc`` writes it.

A test compares the file with what this makes, for every node id.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from docs.field_tables import field_rows
from firmware_protocol import schema
from firmware_protocol.can.frames import FD_BYTES, FD_LENGTHS
from firmware_protocol.can.mapping import EXACT_LENGTHS, CanFunction, arbitration_id
from firmware_protocol.packets import AckCode, DeviceState, EventKind, PacketType
from firmware_protocol.quantization import Q15_SCALE, SMALLEST_THREE_BITS, SMALLEST_THREE_OFFSET, SMALLEST_THREE_SCALE
from firmware_protocol.wire_values import ACCELERATION_LSB_G, GYRO_LSB_DPS

FILE = Path(__file__).parents[1] / "firmware_protocol" / "sensorized_object.dbc"
RECONSTRUCTION = (
    "Quaternion of the object, body to world, scalar first. LargestIndex names the component left out "
    "(0 w, 1 x, 2 y, 3 z): it is sqrt(1 - a*a - b*b - c*c) of the other three, and positive "
    "(q and -q are the same orientation). "
    f"A component is (raw - {SMALLEST_THREE_OFFSET}) / {SMALLEST_THREE_SCALE!r}. "
    "Signal QuatX_0 is x where LargestIndex is 0. All 56 bits set: no orientation just now. "
    "The device time of the sample follows from TIME, its flags from SAMPLE_STATE."
)
_COMPONENTS = "WXYZ"
_STATES = tuple((int(state), state.name) for state in DeviceState)
_KINDS = tuple((int(kind), kind.name) for kind in EventKind)
_CODES = tuple((int(code), code.name) for code in AckCode)
_TYPES = tuple((int(kind), kind.name) for kind in PacketType)


@dataclass(frozen=True, slots=True)
class _Signal:
    name: str
    start: int
    bits: int
    signed: bool = False
    scale: float = 1
    offset: float = 0
    unit: str = ""
    mux: str = ""
    values: tuple[tuple[int, str], ...] = ()
    comment: str = ""


@dataclass(frozen=True, slots=True)
class _Message:
    name: str
    function: CanFunction
    length: int
    signals: tuple[_Signal, ...]
    comment: str
    whole: bool = False


def _orientation() -> tuple[_Signal, ...]:
    signals = [
        _Signal("SampleCounter8", 0, 8, comment="Sample counter modulo 256."),
        _Signal("LargestIndex", 62, 2, mux="M"),
    ]
    for left_out in range(4):
        others = [component for k, component in enumerate(_COMPONENTS) if k != left_out]
        for place, component in enumerate(others):
            signals.append(
                _Signal(
                    f"Quat{component}_{left_out}",
                    8 + (2 - place) * SMALLEST_THREE_BITS,
                    SMALLEST_THREE_BITS,
                    scale=1 / SMALLEST_THREE_SCALE,
                    offset=-SMALLEST_THREE_OFFSET / SMALLEST_THREE_SCALE,
                    mux=f"m{left_out}",
                )
            )
    return tuple(signals)


def _imu(name: str, scale: float, unit: str) -> tuple[_Signal, ...]:
    axes = tuple(_Signal(f"{name}{axis}", 8 + 16 * k, 16, True, scale, 0, unit) for k, axis in enumerate("XYZ"))
    return (_Signal("SampleCounter8", 0, 8), *axes)


def _reading(name: str) -> tuple[_Signal, ...]:
    return (_Signal("CommandId", 0, 8), _Signal(name, 8, 56, unit="us"))


def _long() -> tuple[_Signal, ...]:
    return (
        _Signal(
            "FrameType", 4, 4, mux="M", values=((0, "SINGLE"), (1, "FIRST"), (2, "CONSECUTIVE"), (3, "FLOW_CONTROL"))
        ),
        _Signal("SingleLength", 0, 4, mux="m0"),
        _Signal("SingleData", 8, 56, mux="m0"),
        _Signal("FirstLengthHigh", 0, 4, mux="m1"),
        _Signal("FirstLengthLow", 8, 8, mux="m1"),
        _Signal("FirstData", 16, 48, mux="m1"),
        _Signal("Number", 0, 4, mux="m2"),
        _Signal("ConsecutiveData", 8, 56, mux="m2"),
        _Signal("FlowStatus", 0, 4, mux="m3", values=((0, "CONTINUE"), (1, "WAIT"), (2, "OVERFLOW"))),
        _Signal("BlockSize", 8, 8, mux="m3"),
        _Signal("SeparationTime", 16, 8, mux="m3"),
    )


def _commands() -> tuple[_Signal, ...]:
    signals = [_Signal("PacketType", 0, 8, mux="M", values=_TYPES), _Signal("CommandId", 8, 8)]
    for packet_type in PacketType:
        for row in field_rows(packet_type)[2:] if packet_type >= 0x80 else ():
            signals.append(_Signal(_camel(row.name), 8 * row.offset, 8 * row.size, mux=f"m{int(packet_type)}"))
    return tuple(signals)


_STATUS = (
    _Signal("Page", 0, 8, mux="M", comment="0-4, sent in order; one STATUS is five frames."),
    _Signal("UptimeUs", 8, 56, unit="us", mux="m0"),
    _Signal("SamplesProduced", 8, 56, mux="m1"),
    _Signal("SamplesDropped", 8, 32, mux="m2"),
    _Signal("State", 40, 8, mux="m2", values=_STATES),
    _Signal("Errors", 48, 16, mux="m2"),
    _Signal("BatteryMv", 8, 16, unit="mV", mux="m3"),
    _Signal("TemperatureC", 24, 16, True, 0.01, unit="degC", mux="m3", comment="-327.68 where unknown."),
    _Signal("GyroBiasDpsX", 40, 16, True, 0.001, unit="deg/s", mux="m3"),
    _Signal("GyroBiasDpsY", 8, 16, True, 0.001, unit="deg/s", mux="m4"),
    _Signal("GyroBiasDpsZ", 24, 16, True, 0.001, unit="deg/s", mux="m4"),
)
_SCALES: dict[str, tuple[float, str]] = {
    "q_wxyz": (1 / Q15_SCALE, ""),
    "temperature_c": (0.01, "degC"),
    "gyro_bias_dps": (0.001, "deg/s"),
    "gyro_dps": (GYRO_LSB_DPS, "deg/s"),
    "acceleration_g": (ACCELERATION_LSB_G, "g"),
    "battery_mv": (1, "mV"),
}
_VALUES = {"state": _STATES, "kind": _KINDS, "code": _CODES, "packet_type": _TYPES, "command_type": _TYPES}


def _camel(name: str) -> str:
    if name == "q_wxyz":
        return "Quat"
    return "".join(part.capitalize() for part in name.split("_"))


def _fields(packet_type: PacketType, shift: int) -> tuple[_Signal, ...]:
    """Signals of a packet that stands ``shift`` bits from the start of its frame."""
    signals = []
    for row in field_rows(packet_type):
        base, _, count = row.wire_type.partition("[")
        n = int(count[:-1]) if count else 1
        scale, unit = _SCALES.get(row.name, (1, "us" if row.name.endswith("_us") else ""))
        for k in range(n):
            suffix = "" if n == 1 else (_COMPONENTS if n == 4 else "XYZ")[k]
            bits = 8 * row.size // n
            start = shift + 8 * row.offset + k * bits
            values = _VALUES.get(row.name, ())
            signals.append(_Signal(_camel(row.name) + suffix, start, bits, base[0] == "i", scale, 0, unit, "", values))
    return tuple(signals)


def _whole(packet_type: PacketType, function: CanFunction) -> _Message:
    length = min(size for size in FD_LENGTHS if size > schema.PACKET_BYTES[packet_type])
    signals = (_Signal("Size", 0, 8, comment="Bytes of the packet; zeros follow."), *_fields(packet_type, 8))
    name = f"{packet_type.name}_FD"
    return _Message(name, function, length, signals, f"The whole {packet_type.name} packet in one frame.", True)


_CLASSIC: tuple[_Message, ...] = (
    _Message("COMMAND", CanFunction.COMMAND, 4, _commands(), "From the host; as long as the command, 2-4 bytes."),
    _Message("ACK", CanFunction.ACK, 4, _fields(PacketType.ACK, 0), "The object's answer to a command."),
    _Message(
        "TIME_REPLY_RECEIVE",
        CanFunction.TIME_REPLY_RECEIVE,
        8,
        _reading("ReceiveUptimeUs"),
        "Device clock at the request.",
    ),
    _Message(
        "TIME_REPLY_TRANSMIT",
        CanFunction.TIME_REPLY_TRANSMIT,
        8,
        _reading("TransmitUptimeUs"),
        "Device clock at the reply.",
    ),
    _Message("EVENT", CanFunction.EVENT, 8, _fields(PacketType.EVENT, 0), "Button or marker."),
    _Message(
        "SAMPLE_STATE",
        CanFunction.SAMPLE_STATE,
        8,
        (
            _Signal("SampleCounter", 0, 32),
            _Signal("Flags", 32, 8, comment="1 still, 2 overrange, 4 saturated, 8 calibrated."),
            _Signal("RateHz", 40, 16, unit="Hz"),
            _Signal("BootTag", 56, 8, comment="1-255, another one for every object and boot; 0 where unknown."),
        ),
        "From this sample on: flags and rate. Sent when they change, and before every TIME that is due.",
    ),
    _Message(
        "TIME",
        CanFunction.TIME,
        8,
        (_Signal("SampleCounter", 0, 32), _Signal("DeviceTimeUs", 32, 32, unit="us")),
        "Device time of the sample with this counter. Later ones: + round((counter - this one) * 1000000 / RateHz). "
        "Due before the first sample, and where the counter is a multiple of the largest power of two that is at most "
        "RateHz / 5 and 64.",
    ),
    _Message("ORIENTATION", CanFunction.ORIENTATION, 8, _orientation(), RECONSTRUCTION),
    _Message("STATUS", CanFunction.STATUS, 8, _STATUS, "Health of the object in five frames, at least once a second."),
    _Message("RAW_GYRO", CanFunction.RAW_GYRO, 7, _imu("GyroDps", GYRO_LSB_DPS, "deg/s"), "Rate of turn, sensor axes."),
    _Message(
        "RAW_ACCELERATION",
        CanFunction.RAW_ACCELERATION,
        7,
        _imu("AccelerationG", ACCELERATION_LSB_G, "g"),
        "Specific force, sensor axes.",
    ),
    _Message("LONG_TO_OBJECT", CanFunction.LONG_TO_OBJECT, 8, _long(), "ISO-TP (ISO 15765-2) from the host."),
    _Message("LONG_FROM_OBJECT", CanFunction.LONG_FROM_OBJECT, 8, _long(), "ISO-TP from the object: INFO."),
)


def _messages() -> tuple[_Message, ...]:
    whole = (
        replace(_CLASSIC[0], name="COMMAND_FD", length=5, whole=True, signals=_shifted(_commands())),
        _whole(PacketType.ACK, CanFunction.ACK),
        _whole(PacketType.TIME_REPLY, CanFunction.TIME_REPLY_RECEIVE),
        _whole(PacketType.EVENT, CanFunction.EVENT),
        _whole(PacketType.ORIENTATION, CanFunction.ORIENTATION),
        _whole(PacketType.STATUS, CanFunction.STATUS),
        _whole(PacketType.RAW_IMU, CanFunction.RAW_GYRO),
        *(replace(message, name=f"{message.name}_FD", length=FD_BYTES, whole=True) for message in _CLASSIC[-2:]),
    )
    return _CLASSIC + whole


def _shifted(signals: tuple[_Signal, ...]) -> tuple[_Signal, ...]:
    return (_Signal("Size", 0, 8), *(replace(signal, start=signal.start + 8) for signal in signals))


def generated_dbc(node: int = 1) -> str:
    """Return the DBC file of the object with this node id; the shipped one is that of node 1."""
    messages = _messages()
    identifiers = [arbitration_id(message.function, node, message.whole) for message in messages]
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: Host Object", ""]
    for message, identifier in zip(messages, identifiers, strict=True):
        assert message.whole or message.length == EXACT_LENGTHS.get(message.function, message.length)
        lines.append(f"BO_ {identifier} {message.name}: {message.length} {_sender(message)}")
        lines += [_signal_line(signal) for signal in message.signals]
        lines.append("")
    lines.append(f'CM_ "Sensorized object of the Rotation Drift Benchmark, node {node}. Generated: do not edit.";')
    for message, identifier in zip(messages, identifiers, strict=True):
        lines.append(f'CM_ BO_ {identifier} "{message.comment}";')
        lines += [
            f'CM_ SG_ {identifier} {signal.name} "{signal.comment}";' for signal in message.signals if signal.comment
        ]
    lines.append(
        'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN",'
        + _RESERVED
        + '"StandardCAN_FD","ExtendedCAN_FD";'
    )
    lines.append('BA_DEF_ "BusType" STRING ;')
    lines += ['BA_DEF_DEF_ "VFrameFormat" "StandardCAN";', 'BA_DEF_DEF_ "BusType" "CAN";', 'BA_ "BusType" "CAN FD";']
    for message, identifier in zip(messages, identifiers, strict=True):
        if message.whole:
            lines.append(f'BA_ "VFrameFormat" BO_ {identifier} 14;')
    for message, identifier in zip(messages, identifiers, strict=True):
        for signal in message.signals:
            if signal.values:
                listed = " ".join(f'{value} "{name}"' for value, name in reversed(signal.values))
                lines.append(f"VAL_ {identifier} {signal.name} {listed} ;")
    return "\n".join(lines) + "\n"


_RESERVED = "".join(f'"reserved{k}",' for k in range(2, 14))


def _sender(message: _Message) -> str:
    return "Host" if message.function in (CanFunction.COMMAND, CanFunction.LONG_TO_OBJECT) else "Object"


def _signal_line(signal: _Signal) -> str:
    low, high = (-(1 << signal.bits - 1), (1 << signal.bits - 1) - 1) if signal.signed else (0, (1 << signal.bits) - 1)
    scale, offset = _number(signal.scale), _number(signal.offset)
    limits = f"[{_number(low * signal.scale + signal.offset)}|{_number(high * signal.scale + signal.offset)}]"
    mux = f" {signal.mux}" if signal.mux else ""
    sign = "-" if signal.signed else "+"
    place = f"{signal.start}|{signal.bits}@1{sign}"
    return f' SG_ {signal.name}{mux} : {place} ({scale},{offset}) {limits} "{signal.unit}" Vector__XXX'


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(float(value))


if __name__ == "__main__":
    FILE.write_text(generated_dbc(), encoding="utf-8")
