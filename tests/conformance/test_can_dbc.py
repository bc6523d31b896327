"""The shipped DBC, read by cantools, says of every frame the object sends what our own decoder says."""

import math

import cantools
import numpy as np
import pytest

from docs.can_dbc import FILE as DBC
from docs.can_dbc import generated_dbc
from firmware_protocol.can.dbc import dbc_text
from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.encoder import command_frame
from firmware_protocol.can.frames import CanFrame, pack_frames
from firmware_protocol.can.iso_tp import LongPacketChannel
from firmware_protocol.can.mapping import MAX_NODE, MIN_NODE, CanFunction, arbitration_id, split_id
from firmware_protocol.codec import decode_packet, encode_packet
from firmware_protocol.errors import PacketValueError
from firmware_protocol.packets import Ack, AckCode, Event, EventKind, Mark, RawImu, SetRate, Start, Status, TimeReply
from firmware_protocol.quantization import SMALLEST_THREE_OFFSET, SMALLEST_THREE_SCALE
from tests.can_traffic import PatientObject, info_packet, joined, object_at, sample_packets, unit_quaternions

STATUS = Status(
    2**40 + 1,
    samples_produced=2**33,
    samples_dropped=5,
    battery_mv=3700,
    temperature_c=-1.25,
    gyro_bias_dps=(0.5, -1.0, 2.0),
)
RARE = [
    STATUS,
    Ack(0x84, 3, AckCode.BUSY),
    Event(123456, EventKind.MARKER, 77),
    TimeReply(9, 2**41, 2**41 + 250),
    RawImu(299, 299_100, (10.0, -20.0, 30.0), (0.5, -0.25, 1.0)),
]


@pytest.fixture(scope="module")
def database() -> cantools.database.can.Database:
    return cantools.database.load_file(DBC)


def test_the_shipped_file_is_what_the_code_generates() -> None:
    assert DBC.read_text(encoding="utf-8") == generated_dbc(), "run `python -m docs.can_dbc` and read the difference"


def test_the_file_of_any_node_is_what_the_code_generates() -> None:
    for node in range(MIN_NODE, MAX_NODE + 1):
        assert dbc_text(node) == generated_dbc(node)
    with pytest.raises(PacketValueError, match="node id 32"):
        dbc_text(MAX_NODE + 1)


@pytest.mark.parametrize("node", [1, MAX_NODE])
def test_every_frame_of_the_mapping_is_described_once(node: int) -> None:
    database = cantools.database.load_string(dbc_text(node), "dbc")
    described = {message.frame_id for message in database.messages}
    parts = {split_id(identifier) for identifier in described}
    assert {part.node for part in parts} == {node}
    classic = {part.function for part in parts if not part.whole_packet}
    assert classic == set(CanFunction)
    assert {message.is_fd for message in database.messages if message.frame_id & 0x400} == {True}
    assert not any(message.is_fd for message in database.messages if not message.frame_id & 0x400)


def test_classic_samples_are_the_same_to_the_bit(database: cantools.database.can.Database) -> None:
    quats = np.concatenate([unit_quaternions(600, 8), np.eye(4), -np.eye(4), np.full((1, 4), 0.5)])
    frames = object_at(1).encode(sample_packets(len(quats), quats=quats))
    ours = joined(CanStreamDecoder(1).feed(pack_frames(frames)))
    message = database.get_message_by_name("ORIENTATION")
    samples = [frame for frame in frames if frame.arbitration_id == message.frame_id]
    assert len(samples) == len(ours.sequence) == len(quats)
    for frame, q_wxyz, sequence in zip(samples, ours.quats_wxyz, ours.sequence, strict=True):
        raw = message.decode(frame.data, scaling=False)
        physical = message.decode(frame.data)
        index = raw["LargestIndex"]
        assert raw["SampleCounter8"] == sequence % 256
        rebuilt = [0.0] * 4
        for k, name in enumerate("WXYZ"):
            if k != index:
                rebuilt[k] = (raw[f"Quat{name}_{index}"] - SMALLEST_THREE_OFFSET) / SMALLEST_THREE_SCALE
                assert rebuilt[k] == q_wxyz[k]
                assert physical[f"Quat{name}_{index}"] == pytest.approx(q_wxyz[k], abs=3e-16)
        a, b, c = (value for k, value in enumerate(rebuilt) if k != index)
        assert math.sqrt(1 - (a * a + b * b + c * c)) == pytest.approx(q_wxyz[index], abs=2e-16)
    assert {message.decode(frame.data)["LargestIndex"] for frame in samples} == {0, 1, 2, 3}


def test_the_reconstruction_rule_is_in_the_comments(database: cantools.database.can.Database) -> None:
    comment = database.get_message_by_name("ORIENTATION").comment
    assert "sqrt(1 - a*a - b*b - c*c)" in comment
    assert f"(raw - {SMALLEST_THREE_OFFSET}) / {SMALLEST_THREE_SCALE!r}" in comment


def all_frames(fd: bool) -> list[CanFrame]:
    """Everything an object sends, INFO with a host's flow control."""
    end = PatientObject(1, fd)
    host = LongPacketChannel(1, is_object=False, fd=fd)
    frames = end.encode([info_packet()])
    flow = [answer for frame in frames for _ in host.feed(frame.data) or [0] for answer in host.take_outgoing()]
    frames += flow + [frame for answer in flow for frame in end.receive(answer)[1]]
    frames += end.encode([*sample_packets(300), *(encode_packet(packet) for packet in RARE)])
    return frames + [
        command_frame(encode_packet(command), 1, fd) for command in (SetRate(1, 500), Start(2), Mark(3, 9))
    ]


@pytest.mark.parametrize("fd", [False, True])
def test_every_frame_the_object_sends_decodes(database: cantools.database.can.Database, fd: bool) -> None:
    met = set()
    for frame in all_frames(fd):
        message = database.get_message_by_frame_id(frame.arbitration_id)
        shorter = message.name.startswith(("COMMAND", "LONG"))
        message.decode(frame.data, decode_choices=False, allow_truncated=shorter)
        met.add(message.name)
    if fd:
        missing = {"TIME", "SAMPLE_STATE"} - met
        assert met >= {
            "ORIENTATION_FD",
            "STATUS_FD",
            "RAW_IMU_FD",
            "ACK_FD",
            "EVENT_FD",
            "TIME_REPLY_FD",
            "LONG_FROM_OBJECT_FD",
        }
        assert not missing
    else:
        assert met == {message.name for message in database.messages if not message.is_fd}


@pytest.mark.parametrize("fd", [False, True])
def test_rare_frames_hold_the_same_numbers(database: cantools.database.can.Database, fd: bool) -> None:
    values: dict[str, float] = {}
    for frame in all_frames(fd):
        message = database.get_message_by_frame_id(frame.arbitration_id)
        if frame.arbitration_id & 0x3E0 not in (0x020, 0x300, 0x320, 0x180):
            values |= {
                f"{message.name}.{key}": value
                for key, value in message.decode(frame.data, decode_choices=False).items()
            }
    ending = "_FD" if fd else ""
    expected = {
        f"STATUS{ending}.UptimeUs": STATUS.uptime_us,
        f"STATUS{ending}.SamplesProduced": STATUS.samples_produced,
        f"STATUS{ending}.SamplesDropped": STATUS.samples_dropped,
        f"STATUS{ending}.BatteryMv": STATUS.battery_mv,
        f"STATUS{ending}.TemperatureC": STATUS.temperature_c,
        f"STATUS{ending}.GyroBiasDpsX": 0.5,
        f"STATUS{ending}.GyroBiasDpsY": -1.0,
        f"STATUS{ending}.GyroBiasDpsZ": 2.0,
        f"ACK{ending}.CommandType": 0x84,
        f"ACK{ending}.Code": 5,
        f"EVENT{ending}.DeviceTimeUs": 123456,
        f"EVENT{ending}.Value": 77,
        "TIME.SampleCounter": 256,
        "TIME.DeviceTimeUs": 256_100,
        "SAMPLE_STATE.RateHz": 1000,
        ("TIME_REPLY_FD" if fd else "TIME_REPLY_RECEIVE") + ".ReceiveUptimeUs": 2**41,
        ("TIME_REPLY_FD" if fd else "TIME_REPLY_TRANSMIT") + ".TransmitUptimeUs": 2**41 + 250,
    }
    assert {key: values[key] for key in expected} == pytest.approx(expected)
    raw = decode_packet(encode_packet(RARE[-1]))
    prefix = ("RAW_IMU_FD.", "RAW_IMU_FD.") if fd else ("RAW_GYRO.", "RAW_ACCELERATION.")
    for axis, turn, force in zip("XYZ", raw.gyro_dps, raw.acceleration_g, strict=True):
        assert values[f"{prefix[0]}GyroDps{axis}"] == pytest.approx(turn, abs=1e-12)
        assert values[f"{prefix[1]}AccelerationG{axis}"] == pytest.approx(force, abs=1e-12)


def test_fd_samples_hold_the_q15_numbers(database: cantools.database.can.Database) -> None:
    packets = sample_packets(50)
    message = database.get_message_by_name("ORIENTATION_FD")
    frames = [frame for frame in object_at(1, True).encode(packets) if frame.arbitration_id == message.frame_id]
    for frame, packet in zip(frames, packets, strict=True):
        sample = decode_packet(packet)
        values = message.decode(frame.data)
        assert (values["Sequence"], values["DeviceTimeUs"]) == (sample.sequence, sample.device_time_us)
        decoded = np.array([values[f"Quat{component}"] for component in "WXYZ"])
        assert decoded / np.linalg.norm(decoded) == pytest.approx(np.array(sample.q_wxyz), abs=1e-15)


def test_ids_in_the_file_are_those_of_the_code(database: cantools.database.can.Database) -> None:
    for name, function in (("TIME", CanFunction.TIME), ("ORIENTATION", CanFunction.ORIENTATION)):
        assert database.get_message_by_name(name).frame_id == arbitration_id(function, 1)
