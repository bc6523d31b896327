"""CAN mapping: ids, layouts and every packet there and back."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.encoder import CanObject, command_frame
from firmware_protocol.can.frames import CanFrame, FrameFlag, frame_array, pack_frames, unpack_frames
from firmware_protocol.can.iso_tp import flow_control
from firmware_protocol.can.mapping import (
    ALL_NODES,
    CanFunction,
    arbitration_id,
    boot_tag,
    split_id,
    time_interval,
)
from firmware_protocol.codec import encode_packet
from firmware_protocol.errors import MalformedPacketError, PacketValueError
from firmware_protocol.packets import (
    Ack,
    AckCode,
    DeviceError,
    DeviceState,
    Event,
    EventKind,
    GetInfo,
    Info,
    Mark,
    PacketType,
    RawImu,
    SetRate,
    Start,
    Status,
    TimeReply,
)
from firmware_protocol.quantization import SMALLEST_THREE_MAX_ERROR_DEG
from tests.can_traffic import (
    PatientObject,
    answers,
    fed,
    info_packet,
    joined,
    object_at,
    sample_packets,
    timed,
    unit_quaternions,
)
from tests.sequence_oracle import counted

STATUS = Status(
    uptime_us=(1 << 55) + 12345,
    state=DeviceState.STREAMING,
    samples_produced=(1 << 52) + 7,
    samples_dropped=2**32 - 1,
    battery_mv=3712,
    temperature_c=-12.34,
    gyro_bias_dps=(0.001, -32.767, 1.5),
    errors=DeviceError.LOW_BATTERY | DeviceError.SENSOR,
)
RARE = [
    STATUS,
    Ack(0x84, 200, AckCode.INVALID_ARGUMENT),
    TimeReply(17, 2**40 + 5, 2**40 + 99),
    Event(4_000_000_000, EventKind.MARKER, 65535),
]


def test_ids_are_unique_and_come_apart() -> None:
    seen = {}
    for function in CanFunction:
        for node in range(32):
            for whole in (False, True):
                identifier = arbitration_id(function, node, whole)
                assert 0x020 <= identifier < 0x800
                assert identifier not in seen
                seen[identifier] = split_id(identifier)
                assert (seen[identifier].function, seen[identifier].node) == (function, node)
                assert seen[identifier].whole_packet == whole
    others = [identifier for identifier in range(-1, 3000) if identifier not in seen]
    assert all(split_id(identifier) is None for identifier in others)


def test_commands_win_the_bus_and_time_goes_before_its_sample() -> None:
    order = [
        CanFunction.COMMAND,
        CanFunction.ACK,
        CanFunction.SAMPLE_STATE,
        CanFunction.TIME,
        CanFunction.ORIENTATION,
        CanFunction.STATUS,
        CanFunction.LONG_FROM_OBJECT,
    ]
    assert order == sorted(order)


@pytest.mark.parametrize("node", [-1, 32, 100])
def test_impossible_nodes_are_refused(node: int) -> None:
    with pytest.raises(PacketValueError, match="node id"):
        arbitration_id(CanFunction.TIME, node)
    with pytest.raises(PacketValueError):
        CanObject(node)


def test_no_object_has_the_id_of_all() -> None:
    with pytest.raises(PacketValueError, match="0 addresses all"):
        CanObject(ALL_NODES)


@pytest.mark.parametrize(("rate_hz", "interval"), [(10, 2), (24, 4), (50, 8), (100, 16), (320, 64), (1000, 64)])
def test_time_is_told_at_least_five_times_a_second_and_every_64_samples(rate_hz: int, interval: int) -> None:
    assert time_interval(rate_hz) == interval
    assert rate_hz / interval >= 5


def test_boot_tags_are_never_zero_and_mostly_differ() -> None:
    tags = [boot_tag(1234567, boot) for boot in range(2000)]
    assert min(tags) >= 1
    assert max(tags) <= 255
    same = sum(a == b for a, b in itertools.pairwise(tags))
    assert same < 30  # 1 in 255 expected


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("packet", RARE, ids=lambda packet: packet.packet_type.name)
def test_rare_packets_come_back_the_same(packet: object, fd: bool) -> None:
    end = object_at(fd=fd)
    decoder = CanStreamDecoder()
    assert decoder.feed(pack_frames(end.encode([encode_packet(packet)]))) == [packet]
    assert decoder.counters.packets == {packet.packet_type: 1}
    assert decoder.node == 3


@pytest.mark.parametrize("fd", [False, True])
def test_raw_imu_has_the_time_of_its_sample(fd: bool) -> None:
    end = object_at(fd=fd)
    packets = []
    for k, sample in enumerate(sample_packets(300)):
        packets += [sample, encode_packet(RawImu(k, 100 + k * 1000, (1.0, -2.0, 0.25), (0.5, 0.0, -1.0)))]
    items = fed(CanStreamDecoder(3), end.encode(packets), 10_000)
    raw = [item for item in items if isinstance(item, RawImu)]
    assert [(packet.sequence, packet.device_time_us) for packet in raw] == [(k, 100 + k * 1000) for k in range(300)]
    assert raw[0].acceleration_g == (0.5, 0.0, -1.0)
    assert len(joined(items).sequence) == 300


def test_status_wants_all_its_pages_in_order() -> None:
    frames = object_at().encode([encode_packet(STATUS), encode_packet(STATUS)])
    assert len(frames) == 10
    decoder = CanStreamDecoder(3)
    assert decoder.feed(pack_frames(frames[2:5])) == []
    assert decoder.counters.malformed == 0  # came in the middle
    assert decoder.feed(pack_frames(frames[:2] + frames[3:5])) == []
    assert decoder.counters.malformed == 1
    assert decoder.feed(pack_frames(frames[5:])) == [STATUS]


def test_readings_of_different_requests_make_no_reply() -> None:
    end = object_at()
    first = end.encode([encode_packet(TimeReply(1, 10, 20))])
    second = end.encode([encode_packet(TimeReply(2, 30, 40))])
    decoder = CanStreamDecoder(3)
    assert decoder.feed(pack_frames([first[0], second[1]])) == []
    assert decoder.counters.malformed == 1
    assert decoder.feed(pack_frames(second)) == [TimeReply(2, 30, 40)]


@pytest.mark.parametrize("fd", [False, True])
def test_info_travels_by_isotp_with_flow_control(fd: bool) -> None:
    end = PatientObject(5, fd)
    host = CanStreamDecoder(5)
    packet = info_packet()
    frames = end.encode([packet])
    items = []
    sent_by_host = 0
    for _ in range(20):
        if not frames:
            break
        items += host.feed(pack_frames(frames))
        to_object, frames = answers(frames), []
        for answer in to_object:
            sent_by_host += 1
            frames += end.receive(answer)[1]
    assert [item.name for item in items if isinstance(item, Info)] == ["cube"]
    assert sent_by_host == 1
    assert host.counters.long_packet_errors == 0


def test_a_listener_that_never_sends_still_gets_a_long_packet_another_host_asked_for() -> None:
    end, listener = PatientObject(5), CanStreamDecoder(5)
    traffic = end.encode([info_packet()])
    answer = answers(traffic)
    traffic += answer + end.receive(answer[0])[1]
    items = listener.feed(pack_frames(traffic))
    assert [item.device_id for item in items if isinstance(item, Info)] == [7]
    assert listener.counters.host_frames == 1


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize(
    "start", ["10c8", "1fff", "100000000fff", "100000001000", "10", "100000", "05", "21", "30", "41", ""]
)
def test_flow_control_is_what_the_iso_tp_library_sends(start: str, fd: bool) -> None:
    from firmware_protocol.can.iso_tp import LongPacketChannel

    data = bytes.fromhex(start)
    for sent in (data, data.ljust(64 if fd else 8, b"\x55")) if data else (data,):
        library = LongPacketChannel(5, is_object=False, fd=fd)
        library.feed(sent)
        answer = flow_control(sent, 5, fd)
        assert library.take_outgoing() == ([] if answer is None else [answer])


@pytest.mark.parametrize("fd", [False, True])
def test_long_packets_travel_to_the_object_too(fd: bool) -> None:
    from firmware_protocol.can.iso_tp import LongPacketChannel

    end, host = CanObject(5, fd), LongPacketChannel(5, is_object=False, fd=fd)
    unknown = bytes([0xF0, 1]) + bytes(200)
    host.send(unknown)
    got: list[bytes] = []
    for _ in range(10):
        for frame in host.take_outgoing():
            packets, answers = end.receive(frame)
            got += packets
            for answer in answers:
                host.feed(answer.data)
    assert got == [unknown]


@pytest.mark.parametrize("fd", [False, True])
def test_failed_long_packets_stay_counted_when_the_link_is_opened_again(fd: bool) -> None:
    (first,) = CanObject(5, fd).encode([info_packet()])
    decoder = CanStreamDecoder(5)
    decoder.feed(pack_frames([first, dataclasses.replace(first, data=b"\x25" + first.data[1:])]))  # 5 in place of 1
    assert decoder.counters.long_packet_errors == 1
    decoder.restart()
    assert decoder.counters.long_packet_errors == 1


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("command", [GetInfo(1), Start(2, True), SetRate(255, 1000), Mark(7, 65535)])
def test_commands_reach_their_node_and_all(command: object, fd: bool) -> None:
    packet = encode_packet(command)
    for node, taken in ((5, [packet]), (ALL_NODES, [packet]), (6, [])):
        end = CanObject(5, fd)
        assert end.receive(command_frame(packet, node, fd)) == (taken, [])


def test_objects_ignore_what_is_no_command() -> None:
    end = CanObject(5)
    for frame in (
        CanFrame(0x7FF, b"1"),
        CanFrame(arbitration_id(CanFunction.COMMAND, 5), b""),
        CanFrame(arbitration_id(CanFunction.COMMAND, 5), b"", FrameFlag.REMOTE, remote_length=8),
        CanFrame(arbitration_id(CanFunction.COMMAND, 5), b"\x81\x01", FrameFlag.EXTENDED),
        CanFrame(arbitration_id(CanFunction.COMMAND, 5, True), b"\x09\x81", FrameFlag.FD),
        CanFrame(arbitration_id(CanFunction.ORIENTATION, 5), bytes(8)),
    ):
        assert end.receive(frame) == ([], [])


def test_a_sample_is_off_by_less_than_0_0009_degrees() -> None:
    # Against the exact orientation: the emulated object itself rounds to Q15 first, so that is encoded exactly here.
    from firmware_protocol.quantization import quats_from_smallest_three, quats_to_smallest_three

    quats = unit_quaternions(20_000, 5)
    corner = np.array([[0.5, 0.5, 0.5, 0.5], [1, 0, 0, 0], [-0.5, 0.5, -0.5, 0.5], [0, 0, 0, -1]])
    quats = np.concatenate([quats, corner, corner + 1e-6])
    quats /= np.linalg.norm(quats, axis=1)[:, None]
    back, good = quats_from_smallest_three(quats_to_smallest_three(quats))
    assert good.all()
    # |q - p| and |q + p|: the smaller chord is 2 sin(angle / 4).
    chord = np.minimum(np.linalg.norm(quats - back, axis=1), np.linalg.norm(quats + back, axis=1))
    error_deg = np.degrees(4 * np.arcsin(chord / 2)).max()
    assert 0.0002 < error_deg < SMALLEST_THREE_MAX_ERROR_DEG < 0.0009


@pytest.mark.parametrize("fd", [False, True])
def test_samples_come_back_with_sequence_time_and_flags(fd: bool) -> None:
    n = 3000
    flags = np.repeat(np.random.default_rng(2).integers(0, 16, n // 50), 50).astype(np.uint8)
    quats = unit_quaternions(n)
    packets = sample_packets(n, first=65_000, time_us=2**32 - 1_000_000, flags=flags, quats=quats)
    decoder = CanStreamDecoder()
    got = joined(fed(decoder, object_at(fd=fd).encode(packets), 700))
    assert np.array_equal(got.sequence, (65_000 + np.arange(n)) % 65_536)
    assert np.array_equal(got.device_time_us, (2**32 - 1_000_000 + 1000 * np.arange(n)) % 2**32)
    assert np.array_equal(got.flags, flags)
    dot = np.abs(np.einsum("ij,ij->i", got.quats_wxyz, quats))
    assert np.degrees(2 * np.arccos(np.minimum(dot, 1))).max() < 0.0035 + 0.0009
    counters = decoder.counters
    assert counters.packets == {PacketType.ORIENTATION: n}
    assert (counters.malformed, counted([got])) == (0, {})


@pytest.mark.parametrize("rate_hz", [10, 25, 40, 100, 125, 400, 1000])
def test_device_time_is_exact_at_rates_that_divide_a_second(rate_hz: int) -> None:
    packets = sample_packets(400, rate_hz)
    got = joined(fed(CanStreamDecoder(), object_at(rate_hz=rate_hz).encode(packets), 97))
    assert np.array_equal(got.device_time_us, 100 + np.arange(400) * 1_000_000 // rate_hz)


@pytest.mark.parametrize("rate_hz", [30, 60, 119, 240, 300, 999])
def test_device_time_is_within_a_microsecond_at_any_rate(rate_hz: int) -> None:
    packets = sample_packets(2000, rate_hz)
    frames = object_at(rate_hz=rate_hz).encode(packets)
    got = joined(fed(CanStreamDecoder(), frames, 97))
    assert np.abs(got.device_time_us.astype(int) - (100 + np.arange(2000) * 1_000_000 // rate_hz)).max() <= 1
    assert len(frames) < 2000 * 1.6  # without TIME frames for rounding alone


def test_an_object_that_never_said_its_rate_is_understood() -> None:
    end = CanObject(3)
    got = joined(fed(CanStreamDecoder(), end.encode(sample_packets(500, 250)), 11))
    assert np.array_equal(got.device_time_us, 100 + np.arange(500) * 4000)


def test_a_change_of_rate_and_a_pause_keep_the_times_exact() -> None:
    packets = sample_packets(100, 100) + sample_packets(400, 1000, first=100, time_us=1_000_000)
    packets += sample_packets(100, 1000, first=500, time_us=9_000_123)
    got = joined(fed(CanStreamDecoder(), object_at(rate_hz=100).encode(packets), 64))
    times = np.concatenate(
        [100 + 10_000 * np.arange(100), 1_000_000 + 1000 * np.arange(400), 9_000_123 + 1000 * np.arange(100)]
    )
    assert np.array_equal(got.device_time_us, times)


def test_frame_batches_keep_every_field() -> None:
    frames = [
        CanFrame(0x183, b"12345678", FrameFlag(0), 5, 1.5),
        CanFrame(0x1FFFFFFF, b"", FrameFlag.EXTENDED | FrameFlag.REMOTE, 6, math.inf, remote_length=8),
        CanFrame(0x583, bytes(range(64)), FrameFlag.FD | FrameFlag.BITRATE_SWITCH, 7, -1.0),
        CanFrame(0x20000004, bytes(8), FrameFlag.ERROR, 2**62, 0.0),
    ]
    assert unpack_frames(pack_frames(frames)) == frames
    assert unpack_frames(pack_frames(frames[:1]) + pack_frames(frames[1:])) == frames
    assert len(pack_frames(frames[:1])) == 8 + 32
    assert len(frame_array(b"")) == 0


@pytest.mark.parametrize(
    "damage", [b"CF\x01\x08\x01\x00\x00\x00", b"XX", b"CF\x02\x08\x00\x00\x00\x00", b"CF\x01\x09" + bytes(4)]
)
def test_damaged_batches_raise_alone_and_are_counted_by_decoders(damage: bytes) -> None:
    with pytest.raises(MalformedPacketError):
        frame_array(damage)
    stream = CanStreamDecoder()
    assert stream.feed(damage) == []
    assert stream.counters.damaged_batches == 1


def test_frames_too_long_for_their_kind_are_refused() -> None:
    with pytest.raises(PacketValueError):
        pack_frames([CanFrame(1, bytes(9))])
    with pytest.raises(PacketValueError):
        command_frame(bytes(9), 1)
    with pytest.raises(PacketValueError):
        command_frame(bytes(64), 1, fd=True)


def test_time_order_of_frames_and_packets_is_kept() -> None:
    end = object_at()
    samples = sample_packets(10)
    frames = timed(end, [*samples[:4], encode_packet(STATUS), *samples[4:]], 1_000_000)
    items = CanStreamDecoder().feed(pack_frames(frames))
    assert [len(item.sequence) if hasattr(item, "quats_wxyz") else item for item in items] == [4, STATUS, 6]


def test_a_decoder_puts_a_long_packet_together_however_long_it_takes(monkeypatch):
    """Live, seconds may pass between two of its frames; as a recording is read, none do: both give the same."""
    import isotp.tools

    from firmware_protocol.can.iso_tp import LongPacketChannel

    now_ns = [0]
    monkeypatch.setattr(isotp.tools.time, "perf_counter_ns", lambda: now_ns[0])
    packet = bytes(range(20))
    channel = LongPacketChannel(5, is_object=False, listens_only=True)
    assert channel.feed(bytes([0x10, 20]) + packet[:6]) == []
    now_ns[0] += 5 * 10**9
    assert channel.feed(bytes([0x21]) + packet[6:13]) == []
    now_ns[0] += 5 * 10**9
    assert channel.feed(bytes([0x22]) + packet[13:]) == [packet]
