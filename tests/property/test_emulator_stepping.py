"""Whatever is sent to the object and however its time is cut, it behaves and gives the same bytes."""

from collections import Counter
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from emulator import ScenarioError
from emulator.motion.hand_motion import DriftSettings, HandMotion, MotionSettings
from emulator.scenario import Scenario, load_scenario
from emulator.settings import read_table
from emulator.virtual_object import VirtualObject
from firmware_protocol import packets as p
from firmware_protocol.codec import decode_packet, encode_packet
from firmware_protocol.serial.decoder import StreamDecoder
from tests.memory_link import MemoryLink
from tests.sequence_oracle import counted

DEFAULT = load_scenario("default")
COMMANDS = [
    (0.3, p.GetInfo(1)),
    (0.7, p.Calibrate(2)),
    (2.75, p.SetRate(3, 333)),
    (3.0, p.Start(4, with_raw_imu=True)),
    (4.2, p.Mark(5, 9)),
    (5.1, p.TimeRequest(6)),
    (6.0, p.SetRate(7, 90)),
    (8.0, p.Stop(8)),
    (8.5, p.Start(9)),
]


def bytes_of_a_run(cuts, scenario=DEFAULT, commands=tuple(COMMANDS)):
    virtual, link = VirtualObject(scenario, seed=11), MemoryLink()
    commands = dict(commands)
    for now_s in sorted({*cuts, *commands, 10.0}):
        virtual.firmware.step(now_s, link.send)
        if now_s in commands:
            virtual.firmware.receive(encode_packet(commands[now_s]), now_s)
            virtual.firmware.step(now_s, link.send)
    return link.take()


IDS = st.integers(0, 9)  # few, so that retries happen
REFERENCE = bytes_of_a_run([])


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(0.0, 10.0), max_size=200))
def test_the_same_seed_gives_the_same_bytes_for_any_stepping(cuts):
    assert bytes_of_a_run(cuts) == REFERENCE


@settings(deadline=None, max_examples=10)
@given(st.lists(st.floats(8.5, 10.0), max_size=5))
def test_a_long_step_is_not_cut_short_by_a_link_that_takes_a_little_at_a_time(cuts):
    fast = replace(DEFAULT, device=replace(DEFAULT.device, rate_hz=1000))
    start = [(0.5, p.Start(1))]
    assert bytes_of_a_run(cuts, fast, start) == bytes_of_a_run(list(np.arange(0.0, 10.0, 0.1)), fast, start)


def test_the_reference_run_is_a_run():
    decoder = StreamDecoder()
    items = decoder.feed(REFERENCE)
    counts = decoder.counters.packets
    assert counts[p.PacketType.ORIENTATION] == 3 * 333 + 2 * 90 + 134 + 1
    assert counts[p.PacketType.RAW_IMU] == 3 * 333 + 2 * 90
    assert counted(items)["sequence_gaps"] == 0


def test_another_seed_gives_other_bytes():
    runs = []
    for seed in (11, 12):
        virtual, link = VirtualObject(DEFAULT, seed), MemoryLink()
        virtual.firmware.receive(encode_packet(p.Start(1)), 0.0)
        virtual.firmware.step(1.0, link.send)
        runs.append(link.take())
    assert runs[0] != runs[1]


class AnyHost(RuleBasedStateMachine):
    """A host that sends commands, retries and garbage to an object whose link is now open, now stuck, now gone."""

    def __init__(self):
        super().__init__()
        self.link = MemoryLink()
        self.object = VirtualObject(replace(DEFAULT, device=replace(DEFAULT.device, transmit_queue_bytes=600)))
        self.decoder = StreamDecoder()
        self.now_s = 0.0
        self.lost_link = False
        self.acks = Counter()
        self.expected_acks = Counter()
        self.samples = 0

    def _run(self):
        self.object.firmware.step(self.now_s, self.link.send)
        for command in self.link.receive():
            self.object.firmware.receive(command, self.now_s)
        self.object.firmware.step(self.now_s, self.link.send)
        for item in self.decoder.feed(self.link.take()):
            if isinstance(item, p.Ack):
                self.acks[item.command_type, item.command_id] += 1
            elif isinstance(item, p.OrientationBatch):
                self.samples += len(item)

    @rule(seconds=st.floats(0.0, 3.0))
    def wait(self, seconds):
        self.now_s += seconds
        self._run()

    @rule(
        command=st.one_of(
            st.builds(p.GetInfo, IDS),
            st.builds(p.Start, IDS, st.booleans()),
            st.builds(p.Stop, IDS),
            st.builds(p.SetRate, IDS, st.integers(0, 65_535)),
            st.builds(p.Identify, IDS, st.integers(0, 255)),
            st.builds(p.Calibrate, IDS),
            st.builds(p.Mark, IDS, st.integers(0, 2)),
        )
    )
    def command(self, command):
        self.expected_acks[int(command.packet_type), command.command_id] += 1
        self.link.put(command)
        self._run()

    @rule(data=st.binary(max_size=300))
    def garbage(self, data):
        self.link.put_bytes(data)
        self.link.put_bytes(b"\0")
        self._run()

    @rule(packet=st.binary(min_size=1, max_size=20))
    def framed_garbage(self, packet):
        self.object.firmware.step(self.now_s, self.link.send)
        self.object.firmware.receive(packet, self.now_s)
        if len(packet) >= 2 and packet[0] >= 0x80 and packet[0] != p.PacketType.TIME_REQUEST:
            self.expected_acks[packet[0], packet[1]] += 1
        self._run()

    @rule(room=st.sampled_from([0.0, 30.0, 2000.0, float("inf")]))
    def change_room(self, room):
        self.lost_link |= room < float("inf")
        self.link.room_bytes = room
        self._run()

    @rule(connected=st.booleans())
    def change_connection(self, connected):
        self.lost_link |= not connected
        self.link.connected = connected
        self._run()

    @rule(off_s=st.floats(0.0, 1.0))
    def reset(self, off_s):
        self.lost_link = True  # what was queued is gone
        self.object.firmware.reset(self.now_s, off_s)
        self._run()

    @rule(by_us=st.integers(-(10**9), 10**9))
    def step_clock(self, by_us):
        self.object.firmware.step_clock(self.now_s, by_us)
        self._run()

    @invariant()
    def all_bytes_are_good_frames(self):
        counters = self.decoder.counters
        assert counters.malformed == counters.unknown_types == 0
        if not self.lost_link:
            assert counters.crc_errors == counters.cobs_errors == counters.skipped_bytes == 0

    @invariant()
    def every_command_is_answered_once_and_no_sample_is_lost_on_a_good_link(self):
        produced = self.object.firmware.counters.samples_produced
        dropped = self.object.firmware.counters.samples_dropped
        assert self.samples + dropped <= produced
        if not self.lost_link:
            assert self.acks == self.expected_acks
            assert dropped == 0
            assert self.samples == produced

    @invariant()
    def the_queue_is_bounded(self):
        assert self.object.firmware.backlog <= (600 + 1024) // 4


AnyHost.TestCase.settings = settings(deadline=None, max_examples=40, stateful_step_count=25)
test_any_host = AnyHost.TestCase


@settings(deadline=None, max_examples=60)
@given(
    motion=st.builds(
        MotionSettings,
        shape=st.sampled_from(["cosine", "trapezoid", "two-hump", "double-peak"]),
        period_s=st.floats(0.5, 20.0),
        swing_deg=st.floats(1.0, 170.0),
        cycles=st.integers(1, 20),
        start_phase=st.floats(0.0, 0.999),
        tempo_variation=st.floats(0.0, 0.3),
        tempo_trend=st.floats(-0.5, 0.5),
        amplitude_variation=st.floats(0.0, 0.3),
    ),
    drift=st.builds(DriftSettings, mode=st.sampled_from(["none", "constant", "alternating", "random-walk"])),
    seed=st.integers(0, 1000),
)
def test_any_motion_is_continuous_and_passes_its_end_points(motion, drift, seed):
    hand = HandMotion(motion, drift, seed)
    primary, other = hand.primary(), hand.other()
    assert len(primary.times_s) == len(other.times_s) == motion.cycles
    assert primary.times_s[0] < other.times_s[0]
    both = np.sort(np.concatenate([primary.times_s, other.times_s]))
    assert (np.diff(both) > 0).all()
    for extremes in (primary, other):
        np.testing.assert_allclose(hand.orientation(extremes.times_s), extremes.quats_wxyz, atol=1e-9)
    times_s = np.linspace(0.0, hand.duration_s, 4000)
    quats, dt = hand.orientation(times_s), times_s[1]
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1.0, atol=1e-12)
    turned_rad = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(np.diff(quats, axis=0), axis=1), 0.0, 1.0)) * 2.0
    fastest = np.linalg.norm(hand.angular_velocity(np.linspace(0.0, hand.duration_s, 40_000)), axis=1).max()
    assert turned_rad.max() <= fastest * dt * 1.01 + 1e-6


JSON_LIKE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=10,
)
KNOWN = {
    "motion": ["period_s", "cycles", "axis", "shape"],
    "device": ["name", "rate_hz", "card", "answers"],
    "imu": ["gyro_bias_dps", "noise_deg"],
}


@settings(deadline=None)
@given(
    st.fixed_dictionaries(
        {},
        optional={
            **{table: JSON_LIKE | st.dictionaries(st.sampled_from(keys), JSON_LIKE) for table, keys in KNOWN.items()},
            "seed": JSON_LIKE,
            "purpose": JSON_LIKE,
        },
    )
)
def test_any_table_is_a_scenario_or_a_scenario_error(document):
    try:
        scenario = read_table(Scenario, document)
    except ScenarioError:
        return
    VirtualObject(replace(scenario, motion=replace(scenario.motion, cycles=min(scenario.motion.cycles, 50))))


@settings(deadline=None, max_examples=200)
@given(st.binary(max_size=40))
def test_whatever_the_object_sends_is_decodable(packet):
    virtual = VirtualObject(DEFAULT)
    sent = []
    virtual.firmware.receive(packet, 0.0)
    virtual.firmware.step(0.2, lambda packets: sent.extend(packets) or len(packets))
    for each in sent:
        decode_packet(each)
