"""Hostile bytes, frames and texts: counted or answered in a sentence, never an exception, a hang or an escape."""

import io
import socket
import time

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from rich.console import Console

from analysis.sensor.baseline_file import load_baseline
from analysis.series import AnalysisError
from emulator import ScenarioError
from emulator.links import open_link
from emulator.scenario import load_scenario
from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Event, EventKind, Info, Orientation, OrientationFlag, Status
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import MAX_PIECE_BYTES, encode_frame
from host.capture.operator_desk import OperatorDesk
from host.capture.snapshot import Snapshots
from host.cards.definitions import load_cards
from host.errors import HostError
from host.links.transport import Chunk
from host.screen.dashboard.picture import View, picture
from host.stream.samples import SampleAssembler
from host.text import plain
from host.trial.live import Trial
from host.trial.state import LinkView, RecordingView
from tests.can_traffic import object_at, sample_packets, timed
from tests.fuzz.memory import limited_memory
from tests.fuzz.mutation import mutated, seeds_of
from tests.fuzz.targets import TARGETS, check_ledger
from tests.waiting import HANG_S, SLOW_S

RUNS = {"stream": 600, "can": 250, "recording": 150, "cards": 1500, "scenario": 1500, "series": 800, "bag": 300}
RUNS |= {"mcap": 300, "parquet": 300, "can_log": 300, "endpoints": 800, "commands": 50}


@pytest.mark.parametrize("name", sorted(TARGETS))
def test_inputs_made_from_the_seeds_find_nothing(name):
    with limited_memory():
        for data in seeds_of(name):
            TARGETS[name](data)
        for data in mutated(name, RUNS[name], seed=20):
            TARGETS[name](data)


def test_a_whole_packets_id_on_a_classic_frame_is_malformed():
    decoder = CanStreamDecoder(3)
    wrong = CanFrame(arbitration_id(CanFunction.ORIENTATION, 3, whole_packet=True), b"\x07" + bytes(7))
    assert decoder.feed(pack_frames([wrong])) == []
    assert decoder.counters.malformed == 1


SMALL = st.integers(0, 70_000)


class SerialLink(RuleBasedStateMachine):
    """A serial link on which anything may be sent, in any order and cut anywhere."""

    def __init__(self):
        super().__init__()
        self.trial = Trial()
        self.sent = bytearray()
        self.now_ns = 10**12
        self.n_bytes = 0

    @rule(data=st.binary(max_size=80))
    def noise(self, data):
        self.sent += data

    @rule(sequence=SMALL, time_us=st.integers(0, 2**32 - 1), n=st.integers(1, 20), step_us=st.integers(0, 10**6))
    def samples(self, sequence, time_us, n, step_us):
        for k in range(n):
            packet = Orientation(
                (sequence + k) % 65536, (time_us + k * step_us) % 2**32, (0.5, 0.5, -0.5, 0.5), OrientationFlag(0)
            )
            self.sent += encode_frame(encode_packet(packet))

    @rule(produced=st.integers(0, 2**40), dropped=st.integers(0, 2**32 - 1), uptime_us=st.integers(0, 2**64 - 1))
    def status(self, produced, dropped, uptime_us):
        packet = Status(uptime_us=uptime_us, samples_produced=produced, samples_dropped=dropped)
        self.sent += encode_frame(encode_packet(packet))

    @rule(device=st.integers(0, 2), boot=st.integers(0, 2), name=st.text("abcθ 1", max_size=8))
    def introduction(self, device, boot, name):
        self.sent += encode_frame(encode_packet(Info(device_id=device, boot_id=boot, name=name)))

    @rule(time_us=st.integers(0, 2**32 - 1))
    def event(self, time_us):
        self.sent += encode_frame(encode_packet(Event(time_us, EventKind.BUTTON, 1)))

    @rule(at=st.integers(0, 3000), bit=st.integers(0, 7))
    def flip(self, at, bit):
        if at < len(self.sent):
            self.sent[at] ^= 1 << bit

    @rule(size=st.integers(1, 400), later_ns=st.integers(0, 10**11))
    def arrive(self, size, later_ns):
        data = bytes(self.sent[:size])
        del self.sent[:size]
        self.now_ns += later_ns
        if data:
            self.n_bytes += len(data)
            self.trial.feed(Chunk(data, self.now_ns))

    @rule()
    def reopened(self):
        self.trial.feed(Chunk(b"", self.now_ns))

    @invariant()
    def everything_is_accounted_for(self):
        counters = self.trial.link.counters
        assert counters.bytes == self.n_bytes
        assert counters.bytes == (
            counters.delimiters + counters.frame_bytes + counters.skipped_bytes + counters.pending_bytes
        )
        assert counters.pending_bytes <= MAX_PIECE_BYTES
        losses = self.trial.assembler.losses()
        check_ledger(losses)
        assert losses.received <= counters.frames


class CanBus(RuleBasedStateMachine):
    """A bus on which others send frames with our ids and any content between those of a real object."""

    @initialize(seed=st.integers(0, 5))
    def begin(self, seed):
        self.frames = timed(object_at(), sample_packets(200, first=seed * 97), period_ns=1_000_000)
        self.decoder = CanStreamDecoder()
        self.assembler = SampleAssembler()
        self.at = 0
        self.fed = 0

    @rule(n=st.integers(1, 20))
    def object_sends(self, n):
        self.give(self.frames[self.at : self.at + n])
        self.at += n

    @rule(n=st.integers(1, 20))
    def frames_get_lost(self, n):
        self.at += n

    @rule(
        identifier=st.integers(0, 0x7FF),
        data=st.binary(max_size=8),
        flags=st.sampled_from([FrameFlag(0), FrameFlag.ERROR, FrameFlag.REMOTE, FrameFlag.EXTENDED, FrameFlag.SENT]),
    )
    def another_sends(self, identifier, data, flags):
        data = b"" if flags & FrameFlag.REMOTE else data
        self.give([CanFrame(identifier, data, flags, host_time_ns=10**9 + self.at * 10**6)])

    @rule(function=st.sampled_from(list(CanFunction)), data=st.binary(max_size=64))
    def a_long_frame(self, function, data):
        length = next(size for size in (0, 8, 12, 16, 20, 24, 32, 48, 64) if len(data) <= size)
        frame = CanFrame(arbitration_id(function, 3, whole_packet=True), data.ljust(length, b"\0"), FrameFlag.FD)
        self.give([frame])

    @rule(data=st.binary(max_size=200))
    def a_damaged_record(self, data):
        self.decoder.feed(data)

    @rule()
    def the_link_is_opened_again(self):
        self.decoder.restart()
        self.assembler.reopened()

    def give(self, frames):
        if not frames:
            return
        items = self.decoder.feed(pack_frames(frames))
        self.fed += len(frames)
        for block in self.assembler.feed(items, 10**9 + self.at * 10**6):
            assert np.abs(np.linalg.norm(block.quats_wxyz, axis=1) - 1).max() < 1e-9

    @invariant()
    def everything_is_accounted_for(self):
        if hasattr(self, "assembler"):
            check_ledger(self.assembler.losses())
            assert self.assembler.losses().received <= self.fed


TestSerialLink = SerialLink.TestCase
TestSerialLink.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)
TestCanBus = CanBus.TestCase
TestCanBus.settings = settings(max_examples=40, stateful_step_count=30, deadline=None)


@pytest.mark.parametrize("piece", [b"\x00", b"\xff", b"\x00\x02\x01\x02\x00", b"a" * 300 + b"\x00"])
def test_time_is_linear_in_the_bytes_and_memory_bounded(piece):
    def seconds(n):
        decoder = StreamDecoder()
        data = (piece * (n // len(piece) + 1))[:n]
        started = time.process_time()
        for at in range(0, n, 4096):
            decoder.feed(data[at : at + 4096])
        assert decoder.counters.pending_bytes <= MAX_PIECE_BYTES
        return time.process_time() - started

    seconds(50_000)
    short = min(seconds(200_000) for _ in range(3))
    assert seconds(1_600_000) < 8 * 4 * short + 0.05  # eight times the bytes; four times that is not linear


HOSTILE = "\x1b[2J\x1b]0;owned\x07[bold red]x[/] <script>alert(1)</script> \u202e\x9b31m\r\n"


def test_texts_from_outside_carry_nothing_but_text():
    clean = plain(HOSTILE, 200)
    assert clean.isprintable()
    assert "\x1b" not in clean
    assert "\u202e" not in clean


def test_a_hostile_name_reaches_no_screen():
    trial = Trial()
    hostile = HOSTILE.encode()[:28]
    packet = encode_packet(Info(device_id=1, boot_id=2, name="X" * 28)).replace(b"X" * 28, hostile)
    assert hostile in packet  # our encoder would refuse it; another's firmware may not
    trial.feed(Chunk(encode_frame(packet), 1))
    link, recording = LinkView(name=plain(HOSTILE)), RecordingView(plain(HOSTILE))
    state = Snapshots(trial, OperatorDesk(trial)).at(10**9, 1.0, link, recording, (plain(HOSTILE, 200),))
    stream = io.StringIO()
    console = Console(width=120, height=40, file=stream, force_terminal=True, color_system="truecolor")
    for line in picture((state,), View(), 120, 40):
        console.print(line, no_wrap=True)
    shown = stream.getvalue()
    assert "owned" in shown  # as text
    assert "[bold red]" in shown or "[bold" in shown
    for escape in ("\x1b[2J", "\x1b]", "\x07", "\x9b", "\u202e"):
        assert escape not in shown


@pytest.mark.parametrize("load", [load_cards, load_scenario, load_baseline])
def test_a_card_as_deep_as_a_well_is_a_sentence(tmp_path, load):
    path = tmp_path / "deep.toml"
    path.write_text("a = " + "[" * 5000)
    with pytest.raises((HostError, ScenarioError, AnalysisError)):
        load(path)


def test_a_card_that_is_too_long_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "long.toml"
    path.write_bytes(b"# " + b"x" * 10_000_000)
    started = time.process_time()
    with pytest.raises(HostError, match="larger than"):
        load_cards(path)
    assert time.process_time() - started < SLOW_S


def test_a_scenario_that_is_too_long_is_refused(tmp_path):
    path = tmp_path / "long.toml"
    path.write_bytes(b"# " + b"x" * 50_000_000)
    with pytest.raises(ScenarioError):
        load_scenario(str(path))


def test_the_virtual_objects_server_listens_on_loopback_only():
    with open_link("tcp:0") as link:
        host, port = link.host_uri.split("://")[1].split(":")
        assert host == "127.0.0.1"
        others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
        for address in others - {"127.0.0.1"}:
            if address.startswith("127."):
                continue
            with pytest.raises(OSError), socket.create_connection((address, int(port)), timeout=HANG_S):
                pass
