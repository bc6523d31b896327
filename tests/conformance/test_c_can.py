"""The C library's end of a CAN bus against the golden vectors, the emulator's object, and the host's decoder."""

import json
import math
import random
import struct

import numpy as np
import pytest

from analysis.geometry.rotations import distance
from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import FD_LENGTHS, CanFrame, FrameFlag, pack_frames
from firmware_protocol.can.iso_tp import LongPacketChannel
from firmware_protocol.can.mapping import FD_BIT, NO_ORIENTATION, CanFunction, arbitration_id, boot_tag, split_id
from firmware_protocol.codec import decode_packet, encode_packet
from firmware_protocol.packets import Event, EventKind, Orientation, OrientationFlag, PacketType
from firmware_protocol.quantization import (
    SMALLEST_THREE_PLAIN_MAX_ERROR_RAD,
    quats_from_smallest_three,
    quats_to_smallest_three,
)
from tests.can_traffic import info_packet, is_sample, joined, object_at, sample_packets, unit_quaternions
from tests.vectors.files import CAN_FILE

DOCUMENT = json.loads(CAN_FILE.read_text(encoding="utf-8"))
NODE = DOCUMENT["node"]
DEVICE_ID, BOOT_ID = 0x0123456789ABCDEF, 0xC0FFEE42
FD_FLAGS = FrameFlag.FD | FrameFlag.BITRATE_SWITCH


def frames_in(answer):
    """Frames an answer lists, and what follows them."""
    *listed, result = answer.split(" ")
    frames = []
    for word in listed:
        identifier, data = word.split(":")
        flags = FD_FLAGS if int(identifier, 16) & FD_BIT else FrameFlag(0)
        frames.append(CanFrame(int(identifier, 16), bytes.fromhex(data), flags))
    return frames, result


def new(fd, device_id=DEVICE_ID, boot_id=BOOT_ID, node=NODE):
    return f"can-new {node} {int(fd)} {device_id} {boot_id}"


def sample(counter, time_us, rate_hz, q, flags):
    return f"can-sample {counter} {time_us} {rate_hz} {' '.join(map(repr, q))} {flags}"


def fields_of(code):
    return [code >> 54, *(code >> shift & 0x3FFFF for shift in (36, 18, 0))]


def assert_same_but_for_rounding(frames, expected):
    """Sample frames may hold another neighbour of the exact numbers: the library rounds each by itself."""
    assert [frame.arbitration_id for frame in frames] == [frame.arbitration_id for frame in expected]
    for frame, own in zip(frames, expected, strict=True):
        if is_sample(frame) and not frame.arbitration_id & FD_BIT:
            assert frame.data[0] == own.data[0]
            codes = [fields_of(int.from_bytes(each.data[1:], "little")) for each in (frame, own)]
            if codes[0][0] == codes[1][0]:  # else two components are equally large
                assert np.abs(np.subtract(*codes)).max() <= 1
        else:
            assert (frame.data, frame.flags) == (own.data, own.flags)


@pytest.mark.parametrize("fd", [False, True])
def test_frames_are_those_of_the_vectors(any_driver, fd):
    vectors = [vector for vector in DOCUMENT["vectors"] if vector["fd"] == fd]
    lines, expected = [new(fd)], [[]]
    for vector in vectors:
        data = bytes.fromhex(vector["bytes"])
        frames = [
            CanFrame(int(frame["id"], 16), bytes.fromhex(frame["data"]), FD_FLAGS if frame["fd"] else FrameFlag(0))
            for frame in vector["frames"]
        ]
        if data[0] == PacketType.ORIENTATION:
            packet = decode_packet(data)
            lines.append(sample(packet.sequence, packet.device_time_us, 200, packet.q_wxyz, int(packet.flags)))
            expected.append(frames)
        elif data[0] == PacketType.INFO:
            first, flow_control, *rest = frames
            identifier, bytes_ = flow_control.arbitration_id, flow_control.data.hex()
            lines += [f"can-packet 0 {data.hex()}", f"can-frame 10 {identifier} {bytes_}", "can-poll 20"]
            expected += [[first], [], rest]
        elif data[0] > 0x80:
            lines.append(f"can-frame 0 {frames[0].arbitration_id} {frames[0].data.hex()}")
            expected.append(data.hex())
        else:
            lines.append(f"can-packet 0 {data.hex()}")
            expected.append(frames)
    answers = any_driver.ask(lines)
    assert answers[0] == str(boot_tag(DEVICE_ID, BOOT_ID))
    for answer, wanted in zip(answers[1:], expected[1:], strict=True):
        frames, result = frames_in(answer)
        if isinstance(wanted, str):
            assert result == wanted
        else:
            assert_same_but_for_rounding(frames, wanted)


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("rate_hz", [10, 200, 300, 1000])
def test_samples_are_those_of_the_emulators_object(c_driver, rate_hz, fd):
    n = 700
    quats = np.concatenate([unit_quaternions(n - 8), np.eye(4), -np.eye(4)])
    flags = np.where(np.arange(n) % 150 < 20, 9, 8)
    times_us = (2**32 - 1_000_000 + np.arange(n) * 1_000_000 // rate_hz) % 2**32  # the clock wraps
    ours = object_at(NODE, fd, rate_hz=rate_hz)
    packets = sample_packets(n, rate_hz, time_us=2**32 - 1_000_000, flags=flags, quats=quats)
    lines = [new(fd, 7, 9)]  # the identity of info_packet
    norms = np.random.default_rng(1).uniform(0.9999, 1.0002, n)
    lines += [sample(k, times_us[k], rate_hz, (quats[k] * norms[k]).tolist(), flags[k]) for k in range(n)]
    frames = [frame for answer in c_driver.ask(lines)[1:] for frame in frames_in(answer)[0]]
    expected = ours.encode(packets)
    assert [frame.arbitration_id for frame in frames] == [frame.arbitration_id for frame in expected]
    for frame, own in zip(frames, expected, strict=True):
        assert is_sample(frame) or frame == own
    decoder = CanStreamDecoder(NODE)
    got = joined(decoder.feed(pack_frames(frames)))
    assert np.array_equal(got.sequence, np.arange(n))
    assert np.abs((got.device_time_us.astype(np.int64) - times_us + 2**31) % 2**32 - 2**31).max() <= 1
    assert np.array_equal(got.flags, flags)
    bound = 2.0 / 32767 if fd else SMALLEST_THREE_PLAIN_MAX_ERROR_RAD + 1e-6  # of single precision: 0.00006 deg
    assert distance(got.quats_wxyz, quats).max() <= bound
    assert decoder.counters.malformed == 0


def sent(c_driver, fd, times_us, rates_hz, quats, flags=8):
    rows = zip(times_us, rates_hz, quats.tolist(), strict=True)
    lines = [new(fd, 7, 9), *(sample(k, time_us, rate_hz, q, flags) for k, (time_us, rate_hz, q) in enumerate(rows))]
    return [frame for answer in c_driver.ask(lines)[1:] for frame in frames_in(answer)[0]]


def assert_same_times_and_states(frames, times_us, quats, rate_hz, flags=8):
    """Every frame is that of our object, but for the roundings of the samples."""
    packets = [
        encode_packet(Orientation(k, int(time_us), tuple(q), OrientationFlag(flags)))
        for k, (time_us, q) in enumerate(zip(times_us, quats.tolist(), strict=True))
    ]
    expected = object_at(NODE, rate_hz=rate_hz).encode(packets)
    assert [frame.arbitration_id for frame in frames] == [frame.arbitration_id for frame in expected]
    assert [frame for frame in frames if not is_sample(frame)] == [frame for frame in expected if not is_sample(frame)]


@pytest.mark.parametrize("rate_hz", [300, 700, 1000])
def test_an_imu_on_a_clock_of_its_own_keeps_its_times(c_driver, rate_hz):
    """TIME comes exactly where our object sends it: where the host would be wrong by 2 us, and not where by 1."""
    n = 1500
    jitter = np.random.default_rng(rate_hz).integers(-2, 3, n)
    times_us = 1000 + np.arange(n) * 1_000_000 // rate_hz + jitter
    quats = unit_quaternions(n)
    frames = sent(c_driver, False, times_us, [rate_hz] * n, quats)
    assert_same_times_and_states(frames, times_us, quats, rate_hz)
    got = joined(CanStreamDecoder(NODE).feed(pack_frames(frames)))
    assert np.abs(got.device_time_us.astype(np.int64) - times_us).max() <= 1
    assert 0.2 * n < len(frames) - n < n


def test_a_new_rate_is_published_before_its_first_sample(c_driver):
    rates_hz = np.repeat([200, 500, 100, 1000], [301, 303, 305, 300])
    times_us = np.cumsum(1_000_000 // rates_hz)
    quats = unit_quaternions(len(rates_hz))
    frames = sent(c_driver, False, times_us, rates_hz, quats)
    assert_same_times_and_states(frames, times_us, quats, 200)
    got = joined(CanStreamDecoder(NODE).feed(pack_frames(frames)))
    assert np.array_equal(got.device_time_us, times_us)


def test_whole_packets_are_padded_to_a_length_of_can_fd(c_driver):
    """Also those of a newer minor version, with more behind the fields known here."""
    event = encode_packet(Event(5, EventKind.BUTTON, 2))
    packets = [event + bytes(range(1, extra + 1)) for extra in range(57)]
    answers = c_driver.ask([new(True), *(f"can-packet 0 {packet.hex()}" for packet in packets)])[1:]
    for packet, answer in zip(packets[:-1], answers[:-1], strict=True):
        assert frames_in(answer) == (CanObject(NODE, True).encode([packet]), "1")
    assert answers[-1] == "0"  # 64 bytes, and the length byte


def test_smallest_three_of_any_norm(c_driver):
    units = np.concatenate([unit_quaternions(3000, 5), np.eye(4), -np.eye(4), np.full((1, 4), 0.5)])
    half = math.sqrt(0.5)
    units = np.concatenate([units, [[half, half, 0, 0], [0, -half, 0, half], [half, -half, 0, 0]]])
    quats = units * np.random.default_rng(2).uniform(0.9901, 1.0099, (len(units), 1))
    rows = [answer.split() for answer in c_driver.ask(f"smallest {' '.join(map(repr, q))}" for q in quats.tolist())]
    assert {(row[0], row[2]) for row in rows} == {("1", "1")}
    codes = np.array([int(row[1], 16) for row in rows], np.uint64)
    decoded, valid = quats_from_smallest_three(codes)
    assert valid.all()
    assert distance(decoded, units).max() <= SMALLEST_THREE_PLAIN_MAX_ERROR_RAD + 1e-6
    back = np.array([[struct.unpack("<f", struct.pack("<I", int(word)))[0] for word in row[3:]] for row in rows])
    assert np.abs(back - decoded).max() < 3e-7
    exact = quats_to_smallest_three(units)
    assert np.mean(codes == exact) > 0.5  # the others are a neighbour


def test_codes_that_no_quaternion_has(c_driver):
    rng = random.Random(1)
    codes = [rng.getrandbits(56) for _ in range(3000)]
    codes += [NO_ORIENTATION, 0, 1 << 36, 0x20000 << 36 | 0x20000 << 18 | 0x20000, 0x20000 << 36 | 0x20000 << 18]
    answers = [answer.split() for answer in c_driver.ask(f"widen {code:014x}" for code in codes)]
    quats, valid = quats_from_smallest_three(np.array(codes, np.uint64))
    assert [answer[0] == "1" for answer in answers] == valid.tolist()
    assert 0.05 < valid.mean() < 0.95
    back = np.array(
        [[struct.unpack("<f", struct.pack("<I", int(word)))[0] for word in answer[1:]] for answer in answers]
    )
    assert np.abs(back - quats)[valid].max() < 3e-7
    assert c_driver.ask([f"widen {1 << 56:015x}"])[0].startswith("0 ")


@pytest.mark.parametrize("fd", [False, True])
def test_a_filter_that_failed_sends_no_orientation(c_driver, fd):
    lines = [new(fd), sample(1, 10_000, 100, (1.0, 0.0, 0.0, 0.0), 0)]
    lines += [sample(2, 20_000, 100, (math.nan, 0.0, 0.0, 0.0), 0), sample(3, 30_000, 100, (0.0, 0.9, 0.0, 0.0), 0)]
    answers = [frames_in(answer) for answer in c_driver.ask(lines)[1:]]
    assert [result for _, result in answers] == (["1", "0", "0"] if fd else ["1", "1", "1"])
    decoder = CanStreamDecoder(NODE)
    got = joined(decoder.feed(pack_frames([frame for frames, _ in answers for frame in frames])))
    assert got.sequence.tolist() == [1]
    assert decoder.counters.malformed == (0 if fd else 2)


@pytest.mark.parametrize("fd", [False, True])
def test_a_queue_without_room_loses_samples_and_nothing_else(c_driver, fd):
    """Whatever could not be sent, every sample that the host receives has its own number, time, flags and rotation."""
    rng, n, rate_hz = random.Random(3), 3000, 200
    quats = unit_quaternions(n, 9)
    lines, numbers = [new(fd)], []
    for k in range(n):
        full = k % 400 > 300
        lines += [f"can-room {rng.choice((0, 0, 0, 1, 1, 2, 3)) if full else 9}"]
        numbers.append(len(lines))
        lines.append(sample(k, 5000 * k, rate_hz, quats[k].tolist(), 8 + (k // 37) % 2))
    answers = [frames_in(answer) for answer in c_driver.ask(lines)]
    frames, sent = [], []
    for k, number in enumerate(numbers):
        made, result = answers[number]
        frames += [CanFrame(f.arbitration_id, f.data, f.flags, host_time_ns=10**9 + 5_000_000 * k) for f in made]
        if result == "1":
            sent.append(k)
    assert 0.75 * n < len(sent) < 0.95 * n
    decoder = CanStreamDecoder(NODE)
    got = joined(decoder.feed(pack_frames(frames)))
    assert got.sequence.tolist() == sent
    assert got.device_time_us.tolist() == [5000 * k for k in sent]
    if not fd:  # whole packets carry flags of their own
        assert got.flags.tolist() == [8 + (k // 37) % 2 for k in sent]
    assert distance(got.quats_wxyz, quats[sent]).max() < 1e-4


# ---- INFO by ISO-TP


def pieces(packet, fd):
    host = LongPacketChannel(NODE, is_object=False, fd=fd)
    end = CanObject(NODE, fd)
    first = end.encode([packet])
    host.feed(first[0].data)
    return [*first, *end.receive(host.take_outgoing()[0])[1]]


@pytest.mark.parametrize("fd", [False, True])
def test_info_keeps_the_hosts_block_size_and_separation_time(c_driver, fd):
    packet = info_packet()
    expected = pieces(packet, fd)
    control = arbitration_id(CanFunction.LONG_TO_OBJECT, NODE, fd)
    lines, now, k = [new(fd), f"can-packet 0 {packet.hex()}"], 0, 1
    steps = [1]
    while k < len(expected):
        lines += [f"can-poll {now}", f"can-frame {now} {control} 300205"]  # two frames, 5 ms
        steps += [0, 0]
        for wait, made in ((4900, 0), (5000, 1), (9900, 0), (10_000, 1), (11_000, 0)):
            made = min(made, len(expected) - k)
            lines.append(f"can-poll {now + wait}")
            steps.append(made)
            k += made
        now += 20_000
    answers = [frames_in(answer)[0] for answer in c_driver.ask(lines)][1:]
    assert [len(frames) for frames in answers] == steps
    assert [frame for frames in answers for frame in frames] == expected


def test_info_goes_on_where_the_queue_had_no_room(c_driver):
    packet = info_packet()
    control = arbitration_id(CanFunction.LONG_TO_OBJECT, NODE)
    lines = [new(False), "can-room 0", f"can-packet 0 {packet.hex()}", "can-room 1", f"can-packet 0 {packet.hex()}"]
    lines += [f"can-packet 1 {packet.hex()}", f"can-frame 2 {control} 300000"]  # one at a time
    for k in range(20):
        lines += ["can-room 2", f"can-poll {k}"]
    answers = [frames_in(answer) for answer in c_driver.ask(lines)]
    assert [answers[k][1] for k in (2, 4, 5)] == ["0", "1", "0"]
    assert [frame for frames, _ in answers for frame in frames] == pieces(packet, False)
    assert answers[-1][1] == "0"


@pytest.mark.parametrize(
    ("control", "at_us", "goes_on"),
    [
        ("", 0, False),
        ("310000", 249_000, False),  # wait: and then nothing
        ("320000", 1000, False),  # no room at the host
        ("300000", 249_000, True),
        ("3000", 1000, False),  # too short to be flow control
        ("200000", 1000, False),
    ],
)
def test_info_is_given_up_where_no_host_takes_it(c_driver, control, at_us, goes_on):
    packet = info_packet()
    lines = [new(False), f"can-packet 0 {packet.hex()}"]
    if control:
        lines.append(f"can-frame {at_us} {arbitration_id(CanFunction.LONG_TO_OBJECT, NODE)} {control}")
    lines += [f"can-poll {at_us + 1}", f"can-poll {at_us + 250_001}", f"can-packet 600000 {packet.hex()}"]
    answers = [frames_in(answer) for answer in c_driver.ask(lines)]
    assert (len(answers[-3][0]) > 0) == goes_on
    assert answers[-2][1] == "0"
    assert (len(answers[-1][0]), answers[-1][1]) == (1, "1")  # the next one can be sent


@pytest.mark.parametrize(
    ("code", "wait_us"), [(0, 0), (1, 1000), (0x7F, 127_000), (0xF1, 100), (0xF9, 900), (0xFA, 127_000)]
)
def test_separation_times_are_those_of_the_standard(c_driver, code, wait_us):
    """ISO 15765-2: milliseconds to 0x7F, hundreds of microseconds from 0xF1 to 0xF9, else the longest."""
    control = arbitration_id(CanFunction.LONG_TO_OBJECT, NODE)
    lines = [new(False), f"can-packet 0 {info_packet().hex()}", f"can-frame 50 {control} 3000{code:02x}"]
    lines += ["can-room 1", f"can-poll {50 + wait_us - 1}", f"can-poll {50 + wait_us}"]
    answers = [len(frames_in(answer)[0]) for answer in c_driver.ask(lines)]
    assert answers[-2:] == ([1, 0] if code == 0 else [0, 1])


@pytest.mark.parametrize("fd", [False, True])
def test_flow_control_of_the_other_kind_of_frame_is_not_ours(c_driver, fd):
    other = arbitration_id(CanFunction.LONG_TO_OBJECT, NODE, not fd)
    lines = [new(fd), f"can-packet 0 {info_packet().hex()}", f"can-frame 1 {other} 300000", "can-poll 2"]
    assert c_driver.ask(lines)[-1] == "1"


def test_a_wait_frame_gives_the_host_more_time(c_driver):
    control = arbitration_id(CanFunction.LONG_TO_OBJECT, NODE)
    lines = [new(False), f"can-packet 0 {info_packet().hex()}"]
    for at_us in (200_000, 400_000, 600_000):
        lines += [f"can-frame {at_us} {control} 310000", f"can-poll {at_us + 1000}"]
    lines += [f"can-frame 700000 {control} 300000", "can-poll 700001"]
    answers = [frames_in(answer) for answer in c_driver.ask(lines)]
    assert len(answers[-1][0]) == len(pieces(info_packet(), False)) - 1


# ---- commands


@pytest.mark.parametrize("fd", [False, True])
def test_commands_are_received_as_our_object_takes_them(c_driver, fd):
    rng = random.Random(4)
    frames = []
    for _ in range(4000):
        function = rng.choice((CanFunction.COMMAND, CanFunction.COMMAND, rng.randrange(32)))
        node = rng.choice((NODE, NODE, 0, rng.randrange(32)))
        whole = rng.random() < 0.5
        length = rng.choice(FD_LENGTHS) if whole else rng.randrange(9)
        data = bytearray(rng.randbytes(length))
        if whole and data and rng.random() < 0.7:
            data[0] = rng.randrange(length + 2)
        frames.append(CanFrame(FD_BIT * whole | function << 5 | node, bytes(data), FD_FLAGS if whole else FrameFlag(0)))
    frames = [frame for frame in frames if frame.arbitration_id >> 5 & 31 != CanFunction.LONG_TO_OBJECT]
    lines = [f"can-frame 0 {frame.arbitration_id} {frame.data.hex()}" for frame in frames]
    received = 0
    for frame, answer in zip(frames, c_driver.ask([new(fd), *lines])[1:], strict=True):
        packets, _ = CanObject(NODE, fd).receive(frame)
        assert answer == (packets[0].hex() if packets else ""), frame
        received += bool(packets)
    assert 500 < received < len(frames) / 2


def test_only_packets_that_have_frames_are_sent(c_driver):
    """Commands are the host's, samples have rd_can_sample, and nothing shorter than its fields is read."""
    refused = ["8101", "02" + "00" * 15, "40aa", "05", "0300", "01" * 20, ""]
    answers = c_driver.ask([new(False), *(f"can-packet 0 {data}" for data in refused)])
    assert answers[1:] == ["0"] * len(refused)
    assert split_id(0x7FF) is None
