"""The capture loop with a virtual object behind a link in memory: no process, no driver, no waiting for the wall clock.

The object runs on the host's own clock, so its half-second cycles take half a second each; everything else is at once.
"""

import json
import threading
import time
from datetime import datetime

import pytest

from emulator.virtual_object import VirtualObject
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Ack, AckCode, GetInfo, Info
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import encode_frame
from host.capture import run as capture_run
from host.capture.loop import Capture
from host.capture.settings import CaptureSettings
from host.errors import FileError, LinkError, LinkLostError, NoAnswerError, WrongObjectError
from host.links.transport import Chunk
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.recording.writer import RecordingWriter
from host.screen.screens import QuietScreen
from host.stream.session import SessionSettings
from host.trial.live import Trial
from tests.memory_link import MemoryLink
from tests.memory_transport import MemoryTransport
from tests.recorded_trials import scenario, virtual_chunks
from tests.waiting import HANG_S, wait_for_thread

QUICK = {"motion": {"cycles": 60, "period_s": 0.5, "swing_deg": 20.0, "lead_in_s": 0.1}}


class Bench:
    """A capture, its screen, and a virtual object that a thread of the test drives in real time."""

    def __init__(self, tmp_path, settings, chosen=None, link=None):
        self.link = link or MemoryTransport(on_write=self._heard)
        self.screen = QuietScreen()
        self.stop = threading.Event()
        self.path = tmp_path / "trial.mcap"
        self.writer = RecordingWriter(self.path, self.link.name, time.time_ns(), time.monotonic_ns())
        self.trial = Trial()
        self.capture = Capture(self.link, self.writer, self.trial, self.screen, settings, self.stop)
        self._wire = MemoryLink()
        self._virtual = VirtualObject(chosen) if chosen is not None else None
        self._done = threading.Event()
        self._lock = threading.Lock()

    def _heard(self, data):
        with self._lock:
            self._wire.put_bytes(data)

    def run(self):
        thread = threading.Thread(target=self._drive, daemon=True)
        if self._virtual is not None:
            thread.start()
        try:
            return self.capture.run()
        finally:
            self._done.set()
            if self._virtual is not None:
                wait_for_thread(thread)

    def _drive(self):
        self._wire.open()
        started = time.monotonic()
        while not self._done.wait(0.005):
            now_s = time.monotonic() - started
            with self._lock:
                for command in self._wire.receive():
                    self._virtual.firmware.receive(command, now_s)
            self._virtual.firmware.step(now_s, self._wire.send)
            data = self._wire.take()
            if data:
                self.link.deliver(data)


def chunks_recorded(tmp_path):
    return len(list(RecordingReader(tmp_path / "trial.mcap").chunks()))


def leftover_threads():
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("rotdrift")]


def test_a_capture_ends_after_its_cycles_and_leaves_nothing_behind(tmp_path):
    bench = Bench(tmp_path, CaptureSettings(cycles=3), scenario("ideal", **QUICK))
    outcome = bench.run()
    assert outcome.reason == "3 cycles are done"
    assert outcome.error is None
    assert outcome.warnings == ()
    assert bench.trial.n_endpoints == 4
    assert bench.link.closed
    assert leftover_threads() == []
    trial = load_trial(bench.path)
    assert trial.damage == ()
    assert len(trial.series) == trial.losses.received == trial.losses.produced
    sent = b"".join(chunk.data for chunk in RecordingReader(bench.path).chunks("/raw/sent"))
    assert sent == b"".join(bench.link.written)
    endpoints = [message.values() for message in RecordingReader(bench.path).messages(["/trial/endpoint"])]
    assert [endpoint["number"] for endpoint in endpoints] == [0, 1, 2, 3]


def test_a_duration_ends_it_too(tmp_path):
    bench = Bench(tmp_path, CaptureSettings(duration_s=0.4), scenario("ideal", **QUICK))
    outcome = bench.run()
    assert outcome.reason == "0.4 s are over"
    assert 0.35 <= outcome.elapsed_s < HANG_S


def test_a_motion_of_just_so_many_end_points_ends_with_the_pause_after_it(tmp_path):
    motion = {**QUICK["motion"], "cycles": 3, "lead_out_s": 0.1}
    outcome = Bench(tmp_path, CaptureSettings(cycles=3), scenario("ideal", motion=motion)).run()
    assert outcome.reason == "the hand rests"


def test_the_operator_ends_it(tmp_path):
    bench = Bench(tmp_path, CaptureSettings(), scenario("ideal", **QUICK))
    timer = threading.Timer(0.5, bench.stop.set)
    timer.start()
    outcome = bench.run()
    assert outcome.reason == "stopped by the operator"
    wait_for_thread(timer)


def test_a_lost_link_keeps_what_came(tmp_path):
    link = MemoryTransport()
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=1.0)
    now_ns = time.monotonic_ns()
    for chunk in chunks:
        link.deliver(Chunk(chunk.data, now_ns + chunk.host_time_ns - chunks[0].host_time_ns))
    link.fail(LinkLostError("memory: is gone"))
    outcome = Bench(tmp_path, CaptureSettings(), link=link).run()
    assert outcome.reason == "the link was lost"
    assert str(outcome.error) == "memory: is gone"
    assert chunks_recorded(tmp_path) == len(chunks)
    assert len(load_trial(tmp_path / "trial.mcap").series) == pytest.approx(100, abs=2)


def test_an_object_that_falls_silent_ends_it_with_a_reason(tmp_path):
    link = MemoryTransport()
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=0.5)
    now_ns = time.monotonic_ns()
    for chunk in chunks:
        link.deliver(Chunk(chunk.data, now_ns + chunk.host_time_ns - chunks[-1].host_time_ns))
    settings = CaptureSettings(silence_limit_s=0.3, session=SessionSettings(answer_s=10.0))
    outcome = Bench(tmp_path, settings, link=link).run()
    assert outcome.reason == "the object fell silent"
    assert isinstance(outcome.error, LinkError)


def test_nobody_there_is_no_answer(tmp_path):
    outcome = Bench(tmp_path, CaptureSettings(session=SessionSettings(handshake_s=0.3))).run()
    assert isinstance(outcome.error, NoAnswerError)
    assert chunks_recorded(tmp_path) == 0


def test_another_protocol_version_is_refused(tmp_path):
    outcome = Bench(tmp_path, CaptureSettings(), scenario("future-protocol")).run()
    assert isinstance(outcome.error, WrongObjectError)
    assert "protocol version" in str(outcome.error)


def test_a_full_disk_is_told_and_loses_nothing(tmp_path, monkeypatch):
    import os

    bench = Bench(tmp_path, CaptureSettings(duration_s=0.6), scenario("ideal", **QUICK))

    def full(descriptor, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    outcome = bench.run()
    monkeypatch.undo()
    assert any("the disk is full" in warning for warning in outcome.warnings)
    assert any("the disk is full" in sentence for sentence in bench.screen.reported)
    trial = load_trial(bench.path, outcome.unwritten)
    assert trial.losses.missing == 0
    assert len(trial.series) > 40


# ---- the whole of it, with files ------------------------------------------------------------------------------------


@pytest.fixture
def replayed(tmp_path):
    """A link that a recording stands behind."""
    chunks, _ = virtual_chunks(scenario("ideal", motion={"cycles": 5}))
    writer = RecordingWriter(tmp_path / "first.mcap", "serial:x", 0, chunks[0].host_time_ns)
    for chunk in chunks:
        writer.add_received(chunk)
    writer.close()
    return f"replay:{tmp_path / 'first.mcap'}"


def test_a_recording_can_be_captured_again_and_scores_the_same(tmp_path, replayed):
    again = tmp_path / "again.mcap"
    finished = capture_run.run_capture(replayed, again, CaptureSettings(), QuietScreen(), threading.Event())
    assert finished.outcome.reason == "the recording is over"
    assert list(RecordingReader(again).chunks()) == list(RecordingReader(tmp_path / "first.mcap").chunks())
    written = json.loads(finished.result.read_text())
    assert written["theta_bar_deg"] == finished.score.theta_bar_deg == pytest.approx(0.8, abs=0.01)
    assert written["capture"]["recording"] == str(again)


@pytest.mark.parametrize("start_ns", [10**9, 10**17])
def test_a_recording_of_any_day_can_be_captured_again(tmp_path, start_ns):
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=3.0)
    chunks = [Chunk(chunk.data, start_ns + chunk.host_time_ns - chunks[0].host_time_ns) for chunk in chunks]
    outcome = Bench(tmp_path, CaptureSettings(duration_s=2.0), link=MemoryTransport(chunks, ends=True)).run()
    assert outcome.reason in {"2 s are over", "the recording is over"}
    assert outcome.error is None


class OneByOne(MemoryTransport):
    """A recording on a busy machine: it has nothing to say between its first chunk and the second for a while."""

    reads = 0

    def read(self, timeout_s):
        self.reads += 1
        if 1 < self.reads < 50:
            time.sleep(0.002)
            return None
        return super().read(timeout_s)


def test_a_recording_of_any_day_and_with_pauses_is_read_to_its_end_however_slowly(tmp_path):
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=3.0)
    sampleless = Chunk(encode_frame(encode_packet(Info(device_id=1, boot_id=2))), 10**17)
    day_later = [Chunk(chunk.data, chunk.host_time_ns + 10**17) for chunk in chunks[1:]]
    outcome = Bench(tmp_path, CaptureSettings(), link=OneByOne([sampleless, *day_later], ends=True)).run()
    assert outcome.reason == "the recording is over"
    assert outcome.error is None
    assert chunks_recorded(tmp_path) == len(chunks)


def test_neither_recording_nor_result_is_ever_written_over(tmp_path, replayed):
    (tmp_path / "taken.json").write_text("mine")
    (tmp_path / "other.mcap").write_text("mine")
    for link in (replayed, "serial:/dev/ttyNOPE"):  # said before the link is opened, and an object started
        for name in ("taken.mcap", "other.mcap"):
            with pytest.raises(FileError, match="exists already"):
                capture_run.run_capture(link, tmp_path / name, CaptureSettings(), QuietScreen(), threading.Event())
    assert (tmp_path / "taken.json").read_text() == (tmp_path / "other.mcap").read_text() == "mine"
    assert not (tmp_path / "taken.mcap").exists()


def test_a_capture_without_a_sample_leaves_no_file(tmp_path):
    writer = RecordingWriter(tmp_path / "empty.mcap", "serial:x", 0, 0)
    writer.close()
    out = tmp_path / "out.mcap"
    with pytest.raises(LinkError, match="before the first sample"):
        capture_run.run_capture(
            f"replay:{tmp_path / 'empty.mcap'}", out, CaptureSettings(), QuietScreen(), threading.Event()
        )
    assert not out.exists()


def test_names_made_up_from_the_date_do_not_collide(tmp_path):
    now = datetime(2026, 3, 4, 5, 6, 7, 89_000)
    first = capture_run.default_recording(now, tmp_path)
    assert first.name == "2026-03-04_05-06-07-089.mcap"
    first.touch()
    second = capture_run.default_recording(now, tmp_path)
    assert second.name == "2026-03-04_05-06-07-089_2.mcap"
    second.with_suffix(".json").touch()
    assert capture_run.default_recording(now, tmp_path).name == "2026-03-04_05-06-07-089_3.mcap"


def test_an_object_that_answers_but_never_sends_a_sample_ends_it_with_a_reason(tmp_path):
    link = MemoryTransport(on_write=lambda data: answer(link, data))
    settings = CaptureSettings(silence_limit_s=0.4)
    outcome = Bench(tmp_path, settings, link=link).run()
    assert outcome.reason == "the object fell silent"
    assert "nothing came at all" in str(outcome.error)


def answer(link, data):
    """An object that says yes to everything and does nothing."""
    for command in StreamDecoder().feed(data):
        reply = encode_frame(encode_packet(Ack(command.packet_type, command.command_id, AckCode.OK)))
        if isinstance(command, GetInfo):
            reply += encode_frame(encode_packet(Info(device_id=1, boot_id=2, name="idle")))
        link.deliver(reply)


def boots(spacing_s, n=8):
    """Chunks of an object that is reset again and again: each boot introduces itself and sends a few samples."""
    chunks = virtual_chunks(scenario("ideal"), duration_s=0.3)[0][2:]  # behind its own INFO
    start_ns = time.monotonic_ns()
    for boot in range(n):
        base_ns = start_ns + round(boot * spacing_s * 1e9)
        yield Chunk(encode_frame(encode_packet(Info(device_id=1, boot_id=10 + boot))), base_ns)
        for chunk in chunks:
            yield Chunk(chunk.data, base_ns + chunk.host_time_ns - chunks[0].host_time_ns + 1)


@pytest.mark.parametrize(("spacing_s", "ends"), [(1.0, True), (7.0, True), (8.0, False), (60.0, False)])
def test_an_object_in_a_boot_loop_ends_the_capture(tmp_path, spacing_s, ends):
    link = MemoryTransport()
    for chunk in boots(spacing_s):
        link.deliver(chunk)
    if not ends:
        link.fail(LinkLostError("memory: is gone"))
    outcome = Bench(tmp_path, CaptureSettings(session=SessionSettings(answer_s=10.0)), link=link).run()
    assert ("the object was reset 5 times within 30 s" in str(outcome.error)) is ends
    assert isinstance(outcome.error, LinkError)


def test_a_link_that_opens_again_and_again_brings_no_new_time(tmp_path):
    link = MemoryTransport()
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=0.5)
    now_ns = time.monotonic_ns()
    for chunk in chunks:
        link.deliver(Chunk(chunk.data, now_ns + chunk.host_time_ns - chunks[-1].host_time_ns))
    over = threading.Event()

    def reopen():
        while not over.wait(0.02):
            link.deliver(b"")

    thread = threading.Thread(target=reopen, daemon=True)
    thread.start()
    settings = CaptureSettings(silence_limit_s=0.3, session=SessionSettings(answer_s=10.0))
    try:
        outcome = Bench(tmp_path, settings, link=link).run()
    finally:
        over.set()
        wait_for_thread(thread)
    assert outcome.reason == "the object fell silent"
