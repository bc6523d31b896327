"""One packet to bytes and back: values, ranges, refusals, versions."""

import dataclasses
import math
import struct
import subprocess
import sys

import numpy as np
import pytest

from docs.field_tables import field_rows
from firmware_protocol import codec, schema
from firmware_protocol.errors import (
    MalformedPacketError,
    PacketValueError,
    ProtocolError,
    UnknownPacketTypeError,
    UnsupportedVersionError,
)
from firmware_protocol.packets import (
    Ack,
    AckCode,
    Calibrate,
    DeviceError,
    DeviceState,
    Event,
    EventKind,
    GetInfo,
    Identify,
    Info,
    InternalWeight,
    Mark,
    ObjectCard,
    ObjectShape,
    Orientation,
    OrientationFlag,
    PacketType,
    RawImu,
    SetRate,
    Start,
    Status,
    Stop,
    TimeReply,
    TimeRequest,
)
from tests.waiting import HANG_S

CARD = ObjectCard(
    shape=ObjectShape.CYLINDER,
    size_mm=(60.0, 80.5, 0.0),
    surface="PLA, glatt ± 0.1",
    mass_g=123.5,
    com_mm=(-1.5, 0.25, 3.0),
    weights=(InternalWeight(1, 12.34), InternalWeight(200, 655.35), InternalWeight(0, 0.0)),
    mounting_q_body_sensor=(0.0, 1.0, 0.0, 0.0),
)
INFO = Info(2**64 - 1, 2**32 - 1, (1, 2, 255), 1000, "Würfel 1", "ICM-42688-P", "VQF 6D", CARD)
EXACT = [
    INFO,
    Status(
        2**64 - 1, DeviceState.FAULT, 2**64 - 1, 2**32 - 1, 65535, -40.01, (32.767, -32.767, 0.001), DeviceError(17)
    ),
    RawImu(65535, 2**32 - 1, (-2000.0, 0.0, 1000.0), (-16.0, 1.0, 8.0)),
    Ack(0xFF, 255, AckCode.HARDWARE_FAULT),
    TimeReply(255, 2**64 - 1, 2**63),
    Event(2**32 - 1, EventKind.MARKER, 65535),
    GetInfo(0),
    Start(255, True),
    Start(1, False),
    Stop(1),
    SetRate(1, 65535),
    Identify(1, 255),
    Calibrate(1),
    TimeRequest(255),
    Mark(1, 65535),
]


@pytest.mark.parametrize("packet", EXACT, ids=lambda packet: packet.packet_type.name)
def test_every_packet_comes_back_as_it_went(packet):
    data = codec.encode_packet(packet)
    assert data[0] == packet.packet_type
    assert len(data) == schema.PACKET_BYTES[packet.packet_type]
    assert codec.decode_packet(data) == packet
    assert not codec.is_extended(data)


def test_there_is_a_case_for_every_packet_type():
    assert {packet.packet_type for packet in EXACT} | {PacketType.ORIENTATION} == set(PacketType)


def test_orientation_bytes_are_as_laid_down():
    packet = Orientation(0x0102, 0x03040506, (0.0, -1.0, 0.0, 0.0), OrientationFlag.CALIBRATED)
    data = codec.encode_packet(packet)
    assert data.hex() == "02020106050403000001800000000008"
    assert codec.decode_packet(data) == Orientation(
        0x0102, 0x03040506, (0.0, -1.0, 0.0, 0.0), OrientationFlag.CALIBRATED
    )


@pytest.mark.parametrize("packet_type", list(codec.STREAMED))
def test_the_fast_layouts_are_the_schema(packet_type):
    layout = codec.STREAMED[packet_type]
    assert layout.size == schema.PACKET_BYTES[packet_type]
    pattern = bytes([packet_type]) + bytes((37 * k + 11) % 256 for k in range(1, layout.size))
    assert layout.unpack(pattern)[1:] == schema.parse(pattern)
    assert schema.build(packet_type, schema.parse(pattern)) == pattern


def test_the_layout_of_runs_of_samples_is_the_schema():
    rows = field_rows(PacketType.ORIENTATION)
    fields = codec.ORIENTATION_DTYPE.fields
    assert [(row.offset, row.size) for row in rows] == [
        (offset, dtype.itemsize) for dtype, offset in (fields[name] for name in codec.ORIENTATION_DTYPE.names)
    ]
    pattern = bytes([PacketType.ORIENTATION, *range(200, 215)])
    packet = np.frombuffer(pattern, codec.ORIENTATION_DTYPE)[0]
    values = (packet["sequence"], packet["device_time_us"], *packet["q"], packet["flags"])
    assert tuple(int(value) for value in values) == schema.parse(pattern)


def test_unknown_numbers_travel_as_nan():
    packet = codec.decode_packet(codec.encode_packet(Info(1, 2)))
    assert isinstance(packet, Info)
    assert all(math.isnan(value) for value in (*packet.card.size_mm, packet.card.mass_g, *packet.card.com_mm))
    status = codec.decode_packet(codec.encode_packet(Status(0)))
    assert isinstance(status, Status)
    assert math.isnan(status.temperature_c)


@pytest.mark.parametrize(
    ("value", "decoded"), [(5000.0, 2000.0 - 2000 / 32768), (-5000.0, -2000.0), (math.inf, 2000.0 - 2000 / 32768)]
)
def test_measured_values_end_at_their_range(value, decoded):
    packet = codec.decode_packet(codec.encode_packet(RawImu(0, 0, (value, 0.0, 0.0), (0.0, 0.0, 0.0))))
    assert isinstance(packet, RawImu)
    assert packet.gyro_dps[0] == decoded


def test_temperature_never_becomes_unknown_by_being_low():
    packet = codec.decode_packet(codec.encode_packet(Status(0, temperature_c=-1000.0)))
    assert isinstance(packet, Status)
    assert packet.temperature_c == -327.67


def with_card(**changes):
    return dataclasses.replace(INFO, card=dataclasses.replace(CARD, **changes))


@pytest.mark.parametrize(
    "packet",
    [
        GetInfo(256),
        GetInfo(-1),
        GetInfo(1.5),
        Mark(1, 65536),
        Orientation(65536, 0, (1.0, 0.0, 0.0, 0.0)),
        Orientation(0, 2**32, (1.0, 0.0, 0.0, 0.0)),
        Orientation(0, 0, (1.02, 0.0, 0.0, 0.0)),
        Orientation(0, 0, (math.nan, 0.0, 0.0, 0.0)),
        Orientation(0, 0, (1.0, 0.0, 0.0)),
        Status(2**64),
        Status(0, state=9),
        Status(0, gyro_bias_dps=(math.nan, 0.0, 0.0)),
        RawImu(0, 0, (0.0, 0.0), (0.0, 0.0, 0.0)),
        Ack(256, 0),
        Event(0, 7),
        dataclasses.replace(INFO, rate_hz=9),
        dataclasses.replace(INFO, rate_hz=1001),
        dataclasses.replace(INFO, name="ü" * 17),
        dataclasses.replace(INFO, name="a\nb"),
        dataclasses.replace(INFO, sensor="\0"),
        dataclasses.replace(INFO, filter="\ud800"),
        dataclasses.replace(INFO, firmware_version=(1, 2)),
        with_card(shape=4),
        with_card(mass_g=-1.0),
        with_card(mass_g=math.inf),
        with_card(mass_g=1e39),
        with_card(size_mm=(1.0, 2.0)),
        with_card(com_mm=(math.inf, 0.0, 0.0)),
        with_card(weights=(InternalWeight(0, 1.0),) * 9),
        with_card(weights=(InternalWeight(256, 1.0),)),
        with_card(weights=(InternalWeight(0, 656.0),)),
        with_card(mounting_q_body_sensor=(1.0, 1.0, 0.0, 0.0)),
    ],
)
def test_what_the_wire_cannot_carry_is_refused(packet):
    with pytest.raises(PacketValueError) as caught:
        codec.encode_packet(packet)
    assert isinstance(caught.value, ProtocolError)
    assert caught.value.__cause__ is None, "no error of construct or struct shows through"


def info_bytes(name, value):
    row = next(row for row in field_rows(PacketType.INFO) if row.name == name)
    data = bytearray(codec.encode_packet(INFO))
    data[row.offset : row.offset + len(value)] = value
    return bytes(data)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x01",
        b"\x02",
        b"\x81",
        codec.encode_packet(INFO)[:-1],
        codec.encode_packet(Status(0))[:-1],
        b"\x02" + bytes(15),  # norm 0
        b"\x02" + bytes(6) + struct.pack("<4h", 32767, 32767, 0, 0) + b"\0",
        b"\x03" + bytes(8) + b"\x04" + bytes(24),  # state
        b"\x05\x81\x00\x07",  # code
        b"\x07" + bytes(4) + b"\x02" + bytes(2),  # kind
        b"\x82\x01\x02",  # with_raw_imu
        info_bytes("rate_hz", b"\x09\x00"),
        info_bytes("shape", b"\x04"),
        info_bytes("weight_count", b"\x09"),
        info_bytes("mass_g", struct.pack("<f", -1.0)),
        info_bytes("size_mm", struct.pack("<f", math.inf)),
        info_bytes("mounting_q_body_sensor", struct.pack("<4f", 0.0, 0.0, 0.0, 0.0)),
        info_bytes("mounting_q_body_sensor", struct.pack("<f", math.nan)),
    ],
    ids=lambda data: data[:4].hex() or "empty",
)
def test_impossible_bytes_are_malformed(data):
    with pytest.raises(MalformedPacketError):
        codec.decode_packet(data)


def test_device_text_cannot_drive_a_terminal():
    packet = codec.decode_packet(info_bytes("name", b"\x1b[31mred\r\n\xe2\x80\xaegnp\xff\x00after"))
    assert isinstance(packet, Info)
    assert packet.name == "[31mredgnp\ufffd"


def test_newer_minor_versions_are_read_as_far_as_known():
    newer = dataclasses.replace(INFO, protocol_minor=7)
    data = codec.encode_packet(newer) + b"new"
    assert codec.decode_packet(data) == newer
    assert codec.is_extended(data)
    assert codec.is_extended(codec.encode_packet(Ack(1, 2)) + b"\0")
    with pytest.raises(UnknownPacketTypeError, match="0x08"):
        codec.decode_packet(b"\x08abc")


def test_another_major_version_is_named_whatever_else_it_sends():
    with pytest.raises(UnsupportedVersionError, match=r"2\.5") as caught:
        codec.decode_packet(b"\x01\x02\x05")
    assert (caught.value.protocol_major, caught.value.protocol_minor) == (2, 5)
    assert codec.encode_packet(dataclasses.replace(INFO, protocol_major=2))[:3] == b"\x01\x02\x00"


def test_reading_samples_does_not_load_construct():
    code = (
        "import sys, firmware_protocol.serial.decoder as s;"
        "s.StreamDecoder().feed(bytes.fromhex('%s'));"
        "sys.exit('construct' in sys.modules)"
    )
    frame = codec.encode_packet(Orientation(1, 2, (1.0, 0.0, 0.0, 0.0)))
    from firmware_protocol.serial.framing import encode_frame

    assert (
        subprocess.run([sys.executable, "-c", code % encode_frame(frame).hex()], check=False, timeout=HANG_S).returncode
        == 0
    )
