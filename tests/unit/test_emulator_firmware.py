"""The firmware's state machine, command by command."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emulator.device.imu_model import Readings
from emulator.device.sample_stream import pack_orientations, pack_raw_imu
from emulator.scenario import Scenario, load_scenario
from emulator.virtual_object import VirtualObject
from firmware_protocol import packets as p
from firmware_protocol.codec import decode_packet, encode_packet
from firmware_protocol.serial.decoder import StreamDecoder
from tests.memory_link import MemoryLink


class Bench:
    """A virtual object with a host that keeps every packet."""

    def __init__(self, scenario: Scenario | None = None, seed: int = 1):
        self.object = VirtualObject(scenario or load_scenario("ideal"), seed)
        self.packets: list[p.Packet] = []
        self.now_s = 0.0
        self.room: float = float("inf")
        self.connected = True

    def sink(self, data):
        if not self.connected:
            return None
        n = int(min(len(data), self.room))
        self.room -= n
        self.packets += [decode_packet(each) for each in data[:n]]
        return n

    def wait(self, seconds, step_s=0.01):
        for _ in range(round(seconds / step_s)):
            self.now_s = round(self.now_s + step_s, 9)
            self.object.firmware.step(self.now_s, self.sink)
        return self

    def tell(self, command):
        """Send a command and return what came back for it at once."""
        before = len(self.packets)
        self.object.firmware.step(self.now_s, self.sink)
        data = command if isinstance(command, bytes) else encode_packet(command)
        self.object.firmware.receive(data, self.now_s)
        self.object.firmware.step(self.now_s, self.sink)
        return self.packets[before:]

    def all(self, kind):
        return [packet for packet in self.packets if isinstance(packet, kind)]


@pytest.fixture
def bench():
    return Bench().wait(0.1)


def test_power_up_tells_who_it_is_and_then_its_health():
    bench = Bench().wait(10.0)
    info, *rest = bench.packets
    assert isinstance(info, p.Info)
    assert (info.protocol_major, info.rate_hz, info.name) == (p.PROTOCOL_MAJOR, 100, "virtual cube")
    assert {type(packet) for packet in rest} == {p.Status}
    uptimes_us = np.array([packet.uptime_us for packet in rest])
    assert (np.diff(uptimes_us) <= 1_000_000).all()
    assert rest[0].state is p.DeviceState.IDLE


def test_info_carries_the_card_of_the_scenario():
    scenario = load_scenario("default")
    (ack, info) = Bench(scenario).wait(0.1).tell(p.GetInfo(7))
    assert ack == p.Ack(p.PacketType.GET_INFO, 7, p.AckCode.OK)
    assert info.card.shape is p.ObjectShape.CUBE
    assert info.card.weights == (p.InternalWeight(1, 20.0),)
    assert info.device_id == scenario.device.device_id


def test_start_and_stop(bench):
    assert bench.tell(p.Start(1)) == [p.Ack(p.PacketType.START, 1)]
    bench.wait(1.0)
    assert len(bench.all(p.Orientation)) == 100
    assert not bench.all(p.RawImu)
    assert bench.all(p.Status)[-1].state is p.DeviceState.STREAMING
    assert bench.tell(p.Stop(2)) == [p.Ack(p.PacketType.STOP, 2)]
    bench.wait(1.0)
    assert len(bench.all(p.Orientation)) == 100
    bench.tell(p.Start(3))
    bench.wait(1.0)
    assert [each.sequence for each in bench.all(p.Orientation)] == list(range(200))  # goes on from where it was


def test_samples_are_regular_on_the_objects_own_clock(bench):
    bench.tell(p.SetRate(1, 300))
    bench.tell(p.Start(2))
    bench.wait(2.0)
    times_us = np.array([each.device_time_us for each in bench.all(p.Orientation)])
    assert set(np.diff(times_us)) == {3333, 3334}
    assert len(times_us) == 600


def test_raw_imu_comes_with_each_sample_when_asked_for(bench):
    bench.tell(p.Start(1, with_raw_imu=True))
    bench.wait(0.5)
    orientations, raws = bench.all(p.Orientation), bench.all(p.RawImu)
    assert len(raws) == 50
    assert [(r.sequence, r.device_time_us) for r in raws] == [(o.sequence, o.device_time_us) for o in orientations]
    assert raws[0].acceleration_g == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)


@pytest.mark.parametrize(
    ("rate_hz", "code"),
    [(9, "INVALID_ARGUMENT"), (10, "OK"), (1000, "OK"), (1001, "INVALID_ARGUMENT"), (0, "INVALID_ARGUMENT")],
)
def test_set_rate(bench, rate_hz, code):
    assert bench.tell(p.SetRate(4, rate_hz)) == [p.Ack(p.PacketType.SET_RATE, 4, p.AckCode[code])]
    expected = rate_hz if code == "OK" else 100
    assert bench.tell(p.GetInfo(5))[1].rate_hz == expected
    bench.tell(p.Start(6))
    bench.wait(1.0)
    assert abs(len(bench.all(p.Orientation)) - expected) <= 1


def test_rate_may_change_while_streaming(bench):
    bench.tell(p.Start(1))
    bench.wait(1.0).tell(p.SetRate(2, 50))
    bench.wait(1.0)
    sequence = [each.sequence for each in bench.all(p.Orientation)]
    assert sequence == list(range(150))


def test_time_request_is_answered_with_the_clock(bench):
    (reply,) = bench.tell(p.TimeRequest(9))
    assert reply == p.TimeReply(9, 100_000, 100_000)


def test_a_time_reply_that_had_to_wait_says_so(bench):
    bench.room = 0
    assert bench.tell(p.TimeRequest(9)) == []
    bench.wait(0.25)
    bench.room = float("inf")
    bench.wait(0.01)
    (reply,) = bench.all(p.TimeReply)
    assert (reply.receive_uptime_us, reply.transmit_uptime_us) == (100_000, 360_000)


def test_mark_comes_back_as_an_event(bench):
    ack, event = bench.tell(p.Mark(3, 40_000))
    assert ack == p.Ack(p.PacketType.MARK, 3)
    assert event == p.Event(100_000, p.EventKind.MARKER, 40_000)


def test_a_retry_of_mark_is_answered_but_not_done_again(bench):
    bench.tell(p.Mark(3, 1))
    assert bench.tell(p.Mark(3, 1)) == [p.Ack(p.PacketType.MARK, 3)]
    assert len(bench.tell(p.Mark(4, 1))) == 2
    bench.wait(6.0)
    assert len(bench.tell(p.Mark(4, 1))) == 2  # too late to be a retry


def test_identify(bench):
    assert bench.tell(p.Identify(1, 3)) == [p.Ack(p.PacketType.IDENTIFY, 1)]


def test_calibrate_takes_its_time_and_then_shows(bench):
    scenario = replace(load_scenario("ideal"), imu=load_scenario("default").imu)
    bench = Bench(scenario).wait(1.0)
    assert bench.tell(p.Calibrate(1)) == [p.Ack(p.PacketType.CALIBRATE, 1)]
    bench.wait(1.0)
    assert bench.all(p.Status)[-1].state is p.DeviceState.CALIBRATING
    assert bench.tell(p.Calibrate(1)) == [p.Ack(p.PacketType.CALIBRATE, 1)]  # a retry
    assert bench.tell(p.Calibrate(2))[0].code is p.AckCode.BUSY
    assert bench.tell(p.Start(3))[0].code is p.AckCode.WRONG_STATE
    assert bench.tell(p.Stop(4))[0].code is p.AckCode.WRONG_STATE
    assert bench.tell(p.SetRate(5, 50))[0].code is p.AckCode.WRONG_STATE
    bench.wait(1.1)
    status = bench.all(p.Status)[-1]
    assert status.state is p.DeviceState.IDLE
    assert status.gyro_bias_dps == scenario.imu.gyro_bias_dps
    assert not status.errors
    bench.tell(p.Start(6))
    bench.wait(0.1)
    assert all(each.flags & p.OrientationFlag.CALIBRATED for each in bench.all(p.Orientation))


def test_calibrate_is_refused_while_streaming_and_while_moving(bench):
    bench.tell(p.Start(1))
    assert bench.tell(p.Calibrate(2))[0].code is p.AckCode.WRONG_STATE
    bench.wait(3.0).tell(p.Stop(3))
    assert bench.tell(p.Calibrate(4))[0].code is p.AckCode.NOT_STILL  # the hand turns it


def answers_by_state():
    """The table of docs/protocol.md: command, state, answers."""
    page = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text(encoding="utf-8")
    head, _, *rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in page.split("### Commands and states\n")[1].split("\n\nSTART while")[0].splitlines()
        if line.startswith("|")
    ]
    return [(row[0], state, answer) for row in rows for state, answer in zip(head[1:], row[1:], strict=True)]


@pytest.mark.parametrize(("command", "state", "answer"), answers_by_state())
def test_answers_in_each_state_are_those_of_the_protocol(bench, command, state, answer):
    if state != "IDLE":
        bench.tell({"STREAMING": p.Start(1), "CALIBRATING": p.Calibrate(1)}[state])
    commands = {
        "GET_INFO": p.GetInfo(2),
        "START": p.Start(2),
        "STOP": p.Stop(2),
        "SET_RATE": p.SetRate(2, 50),
        "IDENTIFY": p.Identify(2),
        "CALIBRATE": p.Calibrate(2),
        "MARK": p.Mark(2),
    }
    (ack,) = (packet for packet in bench.tell(commands[command]) if isinstance(packet, p.Ack))
    assert (ack.command_id, ack.code.name) == (2, answer.split(",")[0])
    assert set(commands) | {"TIME_REQUEST"} == {kind.name for kind in p.PacketType if kind >= 0x80}


def test_a_calibration_during_which_the_object_moves_fails():
    ideal = load_scenario("ideal")
    scenario = replace(ideal, motion=replace(ideal.motion, begins="at-power-up", lead_in_s=2.0))
    bench = Bench(scenario).wait(1.0)
    assert bench.tell(p.Calibrate(1))[0].code is p.AckCode.OK
    bench.wait(2.1)
    statuses = bench.all(p.Status)
    assert statuses[-1].errors == p.DeviceError.CALIBRATION
    bench.wait(1.0)
    assert bench.all(p.Status)[-1].errors == p.DeviceError(0)


@pytest.mark.parametrize(
    ("data", "answer"),
    [
        (b"\xee\x05", p.Ack(0xEE, 5, p.AckCode.UNKNOWN_COMMAND)),
        (b"\x80\x06\x01\x02", p.Ack(0x80, 6, p.AckCode.UNKNOWN_COMMAND)),
        (b"\x84\x07", p.Ack(0x84, 7, p.AckCode.INVALID_ARGUMENT)),
        (b"\x82\x08\x02", p.Ack(0x82, 8, p.AckCode.INVALID_ARGUMENT)),
        (b"\x81", None),
        (b"", None),
        (b"\x02" + bytes(15), None),
    ],
)
def test_what_is_no_command(bench, data, answer):
    assert bench.tell(data) == ([] if answer is None else [answer])


def test_a_mute_object_streams_and_never_answers():
    bench = Bench(load_scenario("mute")).wait(1.0)
    assert bench.tell(p.GetInfo(1)) == []
    assert bench.tell(p.Stop(1)) == []
    bench.wait(1.0)
    counts = Counter(type(packet) for packet in bench.packets)
    assert counts == {p.Info: 1, p.Orientation: 200, p.Status: 4}


def test_the_hand_begins_with_the_first_start(bench):
    assert bench.object.hand_start_s is None
    bench.wait(3.0).tell(p.Start(1))
    assert bench.object.hand_start_s == pytest.approx(3.1)
    bench.wait(1.0).tell(p.Start(2))
    assert bench.object.hand_start_s == pytest.approx(3.1)


def test_a_full_queue_drops_whole_samples_and_counts(bench):
    bench.tell(p.Start(1))
    bench.wait(0.5)
    bench.room = 0
    bench.wait(60.0)
    bench.room = float("inf")
    bench.wait(1.0)
    counters = bench.object.firmware.counters
    received = len(bench.all(p.Orientation))
    assert counters.samples_produced == 6150
    assert counters.samples_dropped == 6150 - received > 5000
    assert bench.all(p.Status)[-1].samples_dropped == counters.samples_dropped
    assert any(each.errors & p.DeviceError.TRANSMIT_OVERFLOW for each in bench.all(p.Status))
    assert not bench.all(p.Status)[-1].errors
    queued = bench.object.scenario.device.transmit_queue_bytes // 16
    assert abs(received - 150 - queued) < 30  # what the queue held, oldest first, then the present


def test_status_says_what_was_dropped_before_it_exactly(bench):
    bench.tell(p.Start(1))
    for _ in range(40):
        bench.room = 0
        bench.wait(3.0, step_s=0.1)
        bench.room = 150
        bench.wait(0.2, step_s=0.1)
    received = 0
    for packet in bench.packets:
        if isinstance(packet, p.Orientation):
            received += 1
        elif isinstance(packet, p.Status):
            assert packet.samples_produced - packet.samples_dropped == received


def test_nobody_at_the_other_end_means_drop_and_no_stale_samples(bench):
    bench.tell(p.Start(1))
    bench.connected = False
    bench.wait(10.0)
    bench.connected = True
    bench.wait(0.1)
    assert [each.sequence for each in bench.all(p.Orientation)] == list(range(1000, 1010))
    bench.wait(1.0)
    assert bench.all(p.Status)[-1].samples_dropped == 1000


def test_a_sequence_and_a_clock_that_wrap():
    wrapping = load_scenario("clock-wrap")
    bench = Bench(
        replace(wrapping, device=replace(wrapping.device, rate_hz=1000), motion=replace(wrapping.motion, cycles=30))
    )
    bench.tell(p.Start(1))
    bench.wait(70.0, step_s=0.1)
    samples = bench.all(p.Orientation)
    assert len(samples) == pytest.approx(70_000, abs=3)
    assert [each.sequence for each in samples] == [k % 65_536 for k in range(len(samples))]
    times_us = np.unwrap([each.device_time_us for each in samples], period=2**32)
    assert set(np.diff(times_us).astype(int)) == {1000}
    assert samples[0].device_time_us > 4e9 > 1e8 > samples[-1].device_time_us


def test_reset_gives_a_new_boot_a_new_clock_and_a_new_sequence(bench):
    bench.tell(p.Start(1))
    bench.wait(2.0)
    bench.object.firmware.reset(bench.now_s, off_s=0.5)
    before = len(bench.packets)
    bench.wait(0.49)
    assert len(bench.packets) == before
    assert bench.tell(p.GetInfo(1)) == []
    bench.wait(0.52)
    first, second = bench.all(p.Info)
    assert first.boot_id != second.boot_id
    assert first.device_id == second.device_id
    assert bench.all(p.Status)[-1].uptime_us == pytest.approx(500_000, abs=2)
    bench.tell(p.Start(2))
    bench.wait(0.1)
    assert bench.all(p.Orientation)[-1].sequence == 9
    assert bench.object.firmware.counters.samples_produced == 210


def test_a_clock_step_keeps_the_pace(bench):
    bench.tell(p.Start(1))
    bench.wait(1.0)
    bench.object.firmware.step_clock(bench.now_s, 3_000_000)
    bench.wait(1.0)
    times_us = np.array([each.device_time_us for each in bench.all(p.Orientation)])
    steps = np.diff(times_us)
    assert np.count_nonzero(steps == 10_000) == len(steps) - 1
    assert steps.max() == 3_010_000
    status = bench.all(p.Status)[-1]
    assert status.uptime_us == times_us[status.samples_produced - 1]


def test_battery_falls_and_is_reported_low():
    ideal = load_scenario("ideal")
    bench = Bench(replace(ideal, device=replace(ideal.device, battery_mv=3301))).wait(180.0, step_s=1.0)
    assert bench.all(p.Status)[-1].battery_mv == 3298
    assert bench.all(p.Status)[-1].errors == p.DeviceError.LOW_BATTERY


def test_packed_samples_are_the_bytes_of_the_codec():
    rng = np.random.default_rng(1)
    n = 500
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    flags = rng.integers(0, 16, n).astype(np.uint8)
    readings = Readings(quats, flags, rng.uniform(-2000, 2000, (n, 3)), rng.uniform(-16, 16, (n, 3)))
    sequence, uptime_us = np.arange(n) + 65_400, np.arange(n) * 5_000_000 + 2**40
    rows = zip(sequence.tolist(), uptime_us.tolist(), quats.tolist(), flags.tolist(), strict=True)
    assert pack_orientations(sequence, uptime_us, quats, flags) == [
        encode_packet(p.Orientation(s % 65_536, t % 2**32, tuple(q), p.OrientationFlag(f))) for s, t, q, f in rows
    ]
    gyro, acceleration = readings.gyro_dps.tolist(), readings.acceleration_g.tolist()
    assert pack_raw_imu(sequence, uptime_us, readings) == [
        encode_packet(p.RawImu(s % 65_536, t % 2**32, tuple(g), tuple(a)))
        for s, t, g, a in zip(sequence.tolist(), uptime_us.tolist(), gyro, acceleration, strict=True)
    ]


def test_memory_link_frames_are_what_a_stream_decoder_reads():
    link = MemoryLink()
    link.put(p.GetInfo(1))
    virtual = VirtualObject(load_scenario("default"))
    (command,) = link.receive()
    virtual.firmware.receive(command, 0.0)
    virtual.firmware.step(0.0, link.send)
    assert [type(each) for each in StreamDecoder().feed(link.take())] == [p.Info, p.Ack, p.Info]
