"""docs/protocol.md says what the code does: every table row, the times, the example, the bounds."""

import dataclasses
import re
from pathlib import Path

import pytest

from docs.field_tables import field_rows
from firmware_protocol import codec, packets, quantization, schema
from firmware_protocol.errors import PacketValueError
from firmware_protocol.packets import PacketType
from firmware_protocol.serial import decoder as stream
from firmware_protocol.serial import framing as serial_framing
from host.links.serial.port import DEFAULT_BAUD
from host.stream.session import SessionSettings
from tests.sequence_oracle import LATE_WINDOW
from tests.vectors.files import load_vectors
from tests.vectors.serial_definitions import PACKETS

TEXT = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text(encoding="utf-8")
BITS = {"u8": 8, "u16": 16, "u32": 32, "u64": 64}
EXAMPLES = {packet.packet_type: packet for _, packet in reversed(PACKETS)}


def table_under(heading):
    """Rows of the first table below a heading, as dictionaries by column."""
    section = TEXT.split(f"{heading}\n", 1)[1].split("\n#", 1)[0]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]


def packet_heading(packet_type):
    return f"### {packet_type.name} 0x{packet_type:02X}, {schema.PACKET_BYTES[packet_type]} bytes"


@pytest.mark.parametrize("packet_type", list(PacketType))
def test_field_tables_are_the_schema(packet_type):
    written = [(int(row["offset"]), row["type"], row["field"]) for row in table_under(packet_heading(packet_type))]
    assert written == [(row.offset, row.wire_type, row.name) for row in field_rows(packet_type)]
    rows = field_rows(packet_type)
    assert [row.offset for row in rows[1:]] == [row.offset + row.size for row in rows[:-1]], "no padding"
    assert rows[-1].offset + rows[-1].size == schema.PACKET_BYTES[packet_type] <= serial_framing.MAX_PACKET_BYTES


def test_no_table_of_a_packet_that_is_none():
    assert len(re.findall(r"^### .* bytes$", TEXT, flags=re.MULTILINE)) == len(PacketType)


@pytest.mark.parametrize("packet_type", list(PacketType))
def test_type_bytes_are_as_written(packet_type):
    first = table_under(packet_heading(packet_type))[0]
    assert int(first["range"]) == int(first["meaning"], 16) == packet_type


def scalar_ranges():
    for packet_type in PacketType:
        fields = {field.name for field in dataclasses.fields(EXAMPLES[packet_type])}
        for row in table_under(packet_heading(packet_type)):
            if row["type"] in BITS and row["field"] in fields and not row["range"].startswith("["):
                largest = 2 ** BITS[row["type"]] - 1
                low, high = (0, largest) if row["range"] == "all" else map(int, row["range"].split("…"))
                yield pytest.param(packet_type, row["field"], low, high, id=f"{packet_type.name}-{row['field']}")


@pytest.mark.parametrize(("packet_type", "name", "low", "high"), list(scalar_ranges()))
def test_integer_ranges_are_what_the_codec_takes(packet_type, name, low, high):
    for value in (low, high):
        packet = dataclasses.replace(EXAMPLES[packet_type], **{name: value})
        if name == "protocol_major":
            continue  # its whole range can be sent; only one value can be read
        assert getattr(codec.decode_packet(codec.encode_packet(packet)), name) == value
    for value in (low - 1, high + 1):
        with pytest.raises(PacketValueError, match=name):
            codec.encode_packet(dataclasses.replace(EXAMPLES[packet_type], **{name: value}))


STEPS = {
    (PacketType.ORIENTATION, "q_wxyz"): None,
    (PacketType.STATUS, "temperature_c"): lambda packet: packet.temperature_c,
    (PacketType.STATUS, "gyro_bias_dps"): lambda packet: packet.gyro_bias_dps[0],
    (PacketType.RAW_IMU, "gyro_dps"): lambda packet: packet.gyro_dps[0],
    (PacketType.RAW_IMU, "acceleration_g"): lambda packet: packet.acceleration_g[0],
    (PacketType.INFO, "weights"): lambda packet: packet.card.weights[0].mass_g,
}


def written_step(packet_type, name):
    row = next(row for row in table_under(packet_heading(packet_type)) if row["field"] == name)
    number = row["step"].split()[0]
    numerator, _, denominator = number.partition("/")
    return float(numerator) / float(denominator or 1)


@pytest.mark.parametrize(("packet_type", "name"), STEPS, ids=lambda value: getattr(value, "name", value))
def test_one_count_means_what_the_table_says(packet_type, name):
    row = next(row for row in field_rows(packet_type) if row.name == name)
    data = bytearray(codec.encode_packet(EXAMPLES[packet_type]))
    at = row.offset + (1 if name == "weights" else 0)  # the slot stands in front of the mass
    if name == "q_wxyz":
        assert written_step(packet_type, name) == 1 / quantization.Q15_SCALE
        return
    values = []
    for count in (100, 101):
        data[at : at + 2] = count.to_bytes(2, "little")
        values.append(STEPS[packet_type, name](codec.decode_packet(bytes(data))))
    assert values == pytest.approx([count * written_step(packet_type, name) for count in (100, 101)], rel=1e-12)


@pytest.mark.parametrize("name", re.findall(r"^### ([A-Z][a-zA-Z]+)$", TEXT, flags=re.MULTILINE))
def test_value_tables_are_the_enumerations(name):
    written = {row["name"]: int(row["value"], 0) for row in table_under(f"### {name}")}
    assert written == {member.name: int(member) for member in getattr(packets, name)}


def test_every_enumeration_has_its_table():
    tables = set(re.findall(r"^### ([A-Z][a-zA-Z]+)$", TEXT, flags=re.MULTILINE))
    enums = {name for name, value in vars(packets).items() if isinstance(value, type) and hasattr(value, "__members__")}
    assert tables == enums - {"PacketType"}
    assert set(re.findall(r"\]\(#([a-z]+)\)", TEXT)) == {name.lower() for name in tables}


def test_the_counters_of_pieces_exist():
    written = set(re.findall(r"`([a-z_]+)`", "".join(row["counter"] for row in table_under("## Serial frames"))))
    written |= set(re.findall(r"\(`([a-z_]+)`\)", TEXT))
    assert written <= set(vars(stream.StreamDecoder().counters))
    assert len(written) == 7


def test_times_are_those_of_the_host():
    rows = table_under("## Conversation")
    waits = {row["what the host waits for"].split(",")[0]: row["how long"] for row in rows}
    settings = SessionSettings()
    assert waits == {
        "anything at all": f"{settings.handshake_s:g} s",
        "an answer": f"{settings.answer_s:g} s",
        "tries of one command": f"{settings.tries}",
        "INFO": f"{settings.mute_s:g} s",
        "between two TIME_REQUEST": f"{settings.time_request_s:g} s",
        "the ACK of STOP": f"{settings.stop_s:g} s",
    }


def test_the_example_is_a_golden_vector():
    vector = next(v for v in load_vectors()["packets"] if v["name"] == "orientation, identity, at rest")
    lines = dict(re.findall(r"^(packet|crc|frame) +([0-9a-fx ]+?)(?:  .*)?$", TEXT, flags=re.MULTILINE))
    assert bytes.fromhex(lines["packet"]).hex() == vector["packet"]
    assert bytes.fromhex(lines["frame"]).hex() == vector["frame"]
    assert int(lines["crc"], 16) == serial_framing.checksum(bytes.fromhex(vector["packet"]))
    parts = re.findall(r"^ {9,}((?:[0-9a-f]{2} )+) +(?:type|sequence|device_time_us|q|flags)", TEXT, flags=re.MULTILINE)
    assert "".join(parts).replace(" ", "") == vector["packet"]


def test_numbers_in_the_text():
    assert f"Version {packets.PROTOCOL_MAJOR}.{packets.PROTOCOL_MINOR}." in TEXT
    assert f"1 to {serial_framing.MAX_PACKET_BYTES} bytes" in TEXT
    assert f"more than {serial_framing.MAX_PIECE_BYTES} bytes" in TEXT
    assert "at most 0.0035°" in TEXT
    assert quantization.Q15_MAX_ERROR_DEG <= 0.0035
    assert f"{packets.MIN_RATE_HZ} to {packets.MAX_RATE_HZ}" in TEXT
    assert f"with {DEFAULT_BAUD} baud" in TEXT
    assert f"at most {LATE_WINDOW} behind" in TEXT
    example = codec.encode_packet(packets.Orientation(0, 0, (1.0, 0.0, 0.0, 0.0)))
    assert f"frame has {len(serial_framing.encode_frame(example))} bytes" in TEXT


def test_the_sections_of_the_vectors_are_listed():
    listed = {row["section"].strip("`") for row in table_under("## Golden vectors")}
    assert listed == {name for name, content in load_vectors().items() if isinstance(content, list)}
