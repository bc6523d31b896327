"""``python -m tests.c_library.constants``: write the constants of the C library from the schema and its tables."""

from __future__ import annotations

import enum
import math
import re

from docs.field_tables import field_rows
from firmware_protocol import packets as p
from firmware_protocol import quantization, schema, wire_values
from firmware_protocol.can import mapping
from firmware_protocol.serial import framing
from tests.c_library.build import LIBRARY
from tests.sequence_oracle import LATE_WINDOW

HEADER = LIBRARY / "rotdrift_constants.h"
_TABLES: dict[str, type[enum.IntEnum] | type[enum.IntFlag]] = {
    "SHAPE": p.ObjectShape,
    "FLAG": p.OrientationFlag,
    "STATE": p.DeviceState,
    "ERROR": p.DeviceError,
    "ACK": p.AckCode,
    "EVENT": p.EventKind,
    "CAN": mapping.CanFunction,
}


def _enumeration(members: list[tuple[str, int]]) -> str:
    return "\nenum {\n" + "".join(f"    RD_{name} = {value},\n" for name, value in members) + "};\n"


def _layout(packet_type: p.PacketType) -> str:
    """Return the macro that lists a packet's fields behind the type byte: struct, name, kind, how many."""
    fields = []
    for row in field_rows(packet_type)[1:]:
        kind, count = re.fullmatch(r"(.*?)(?:\[(\d+)\])?", row.wire_type).groups()  # type: ignore[union-attr]
        kind = re.sub(r"\W+", "_", kind.replace("char", "u8")).strip("_").upper()
        fields.append(f"FIELD(S, {row.name}, {kind}, {count or 1})")
    return f"\n#define RD_LAYOUT_{packet_type.name}(FIELD, S) \\\n    " + " \\\n    ".join(fields) + "\n"


def header_text() -> str:
    """Return ``rotdrift_constants.h``."""
    numbers = [
        ("PROTOCOL_MAJOR", p.PROTOCOL_MAJOR),
        ("PROTOCOL_MINOR", p.PROTOCOL_MINOR),
        ("MIN_RATE_HZ", p.MIN_RATE_HZ),
        ("MAX_RATE_HZ", p.MAX_RATE_HZ),
        ("MAX_PACKET_BYTES", framing.MAX_PACKET_BYTES),
        ("MAX_FRAME_BYTES", framing.MAX_PACKET_BYTES + framing.LONE_FRAME_OVERHEAD),
        ("MAX_PIECE_BYTES", framing.MAX_PIECE_BYTES),
        ("LATE_WINDOW", LATE_WINDOW),
        ("MAX_WEIGHTS", wire_values.MAX_WEIGHTS),
        ("TEMPERATURE_UNKNOWN", wire_values.TEMPERATURE_UNKNOWN),
        ("Q15_SCALE", quantization.Q15_SCALE),
        ("SMALLEST_THREE_BITS", quantization.SMALLEST_THREE_BITS),
        ("MIN_NODE", mapping.MIN_NODE),
        ("MAX_NODE", mapping.MAX_NODE),
        ("CAN_WHOLE_PACKET", mapping.FD_BIT),
        ("CAN_TIME_FRAMES_PER_S", mapping.TIME_FRAMES_PER_S),
        ("CAN_MAX_TIME_INTERVAL", mapping.MAX_TIME_INTERVAL),
        ("CAN_GRID_TOLERANCE_US", mapping.GRID_TOLERANCE_US),
    ]
    # In steps, where C can judge the sum of squares exactly.
    three_max = math.floor(quantization._MAX_THREE_SQUARE * quantization.SMALLEST_THREE_SCALE**2)
    rows = {packet_type: field_rows(packet_type) for packet_type in p.PacketType}
    parts = [
        "/* Made by `python -m tests.c_library.constants`; not written by hand. */\n"
        "#ifndef ROTDRIFT_CONSTANTS_H\n#define ROTDRIFT_CONSTANTS_H\n",
        _enumeration(numbers),
        f"\n#define RD_Q15_MIN_SQUARE {quantization.Q15_MIN_SQUARE}u\n",
        f"#define RD_Q15_MAX_SQUARE {quantization.Q15_MAX_SQUARE}u\n",
        f"#define RD_NORM_TOLERANCE {quantization.NORM_TOLERANCE}f\n",
        f"#define RD_SMALLEST_THREE_SCALE {quantization.SMALLEST_THREE_SCALE:.3f}f\n",
        f"#define RD_SMALLEST_THREE_MAX_SQUARE {three_max}ull\n",
        f"#define RD_GYRO_COUNTS_PER_DPS {1 / wire_values.GYRO_LSB_DPS!r}f\n",
        f"#define RD_ACCELERATION_COUNTS_PER_G {1 / wire_values.ACCELERATION_LSB_G!r}f\n",
        _enumeration([(kind.name, int(kind)) for kind in p.PacketType]),
        _enumeration([(f"{kind.name}_BYTES", size) for kind, size in schema.PACKET_BYTES.items()]),
        *(
            _enumeration([(f"{kind.name}_{row.name.upper()}_AT", row.offset) for row in rows[kind][1:]])
            for kind in p.PacketType
        ),
        *(_enumeration([(f"{name}_{m.name}", int(m)) for m in table]) for name, table in _TABLES.items()),
        *(_layout(kind) for kind in p.PacketType),
        "\n#endif\n",
    ]
    return "".join(parts)


if __name__ == "__main__":
    HEADER.write_text(header_text(), encoding="utf-8")
