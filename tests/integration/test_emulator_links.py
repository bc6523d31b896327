"""The virtual object on real links: a second process, a pseudo-terminal, TCP, a byte file."""

import json
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import serial

from emulator import EmulatorError, LinkError
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol import packets as p
from firmware_protocol.codec import encode_packet
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import encode_frame
from tests.command_line import Program, running
from tests.sequence_oracle import counted
from tests.waiting import HANG_S, wait_for, wait_for_event, wait_for_thread

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are a thing of Unix")

EMULATE = """
import sys
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario

scenario, link, truth = sys.argv[1:]
run(load_scenario(scenario), open_link(link), truth_path=truth, on_ready=lambda uri: print(uri, flush=True))
print("ended", flush=True)
"""


class Host:
    """A small real host on a pyserial port."""

    def __init__(self, url):
        self.port = serial.serial_for_url(url, timeout=0.05)
        self.decoder = StreamDecoder()
        self.items = []

    def tell(self, command):
        self.port.write(encode_frame(encode_packet(command)))

    def read_until(self, condition):
        """Read until the condition holds."""
        wait_for(lambda: condition(self), lambda: f"packets; there are {self.decoder.counters}", self.read)
        return self

    def read(self):
        self.items += self.decoder.feed(self.port.read(self.port.in_waiting or 1))

    def count(self, packet_type):
        return self.decoder.counters.packets.get(packet_type, 0)

    def all(self, kind):
        return [item for item in self.items if isinstance(item, kind)]


@contextmanager
def emulator_process(scenario, link, truth):
    with running(Program([sys.executable, "-P", "-c", EMULATE, scenario, link, truth])) as program:
        yield program, program.stdout.up_to("\n")[0].strip()


@contextmanager
def emulator_thread(scenario, link, **options):
    """Run in a thread of this process; gives the uri and the result, which is filled in at the end."""
    stop, ready, result = threading.Event(), threading.Event(), {}

    def work():
        result["value"] = run(
            scenario, link, stop=stop, on_ready=lambda uri: (result.update(uri=uri), ready.set()), **options
        )

    thread = threading.Thread(target=work)
    thread.start()
    try:
        wait_for_event(ready, "an object that is ready")
        yield result["uri"].removeprefix("serial:"), result
    finally:
        stop.set()
        wait_for_thread(thread)


def test_a_second_process_is_read_through_pyserial(tmp_path):
    device, truth_path = tmp_path / "object", tmp_path / "truth.json"
    with emulator_process("default", f"pty:{device}", truth_path) as (process, uri):
        assert uri == f"serial:{device}"
        assert json.loads(truth_path.read_text())["complete"] is False
        host = Host(str(device))
        host.tell(p.GetInfo(1))
        host.tell(p.SetRate(2, 200))
        host.tell(p.TimeRequest(3))
        host.tell(p.Start(4))
        host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 400)
        assert host.count(p.PacketType.STATUS) >= 2
        assert [ack.command_id for ack in host.all(p.Ack)] == [1, 2, 4]
        assert host.all(p.Info)[0].name == "virtual cube"
        assert len(host.all(p.TimeReply)) == 1
        counters = host.decoder.counters
        assert counters.crc_errors == counters.skipped_bytes == counted(host.items)["sequence_gaps"] == 0
        host.port.close()
        process.send_signal(signal.SIGINT)
        done = process.finish()
        assert (done.returncode, done.stdout) == (0, f"{uri}\nended\n")
        assert not os.path.lexists(device)
        truth = json.loads(truth_path.read_text())
        assert truth["complete"] is True
        assert truth["device"]["samples_produced"] >= 400


def test_truth_survives_a_killed_run(tmp_path):
    scenario = tmp_path / "quick.toml"
    scenario.write_text("[motion]\nperiod_s = 0.5\nlead_in_s = 0.0\ncycles = 200\n")
    device, truth_path = tmp_path / "object", tmp_path / "truth.json"
    with emulator_process(str(scenario), f"pty:{device}", truth_path) as (process, _):
        host = Host(str(device))
        host.tell(p.Start(1))
        host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 350)
        process.send_signal(signal.SIGKILL)
        process.exit_code()
    truth = json.loads(truth_path.read_text())
    assert truth["complete"] is False
    assert truth["endpoints"][1]["sequence"] == pytest.approx(75, abs=2)
    assert truth["hand_start_s"] is not None


def test_a_pty_that_nobody_opens_does_not_block_and_counts():
    mute = load_scenario("mute")
    result = run(replace(mute, device=replace(mute.device, rate_hz=1000)), open_link("pty:"), duration_s=0.5)
    assert result["device"]["samples_produced"] == pytest.approx(500, abs=3)
    assert result["device"]["samples_dropped"] == result["device"]["samples_produced"]


def test_a_pty_that_is_open_but_not_read_does_not_block_and_counts():
    mute = load_scenario("mute")
    scenario = replace(mute, device=replace(mute.device, rate_hz=1000))
    with emulator_thread(scenario, open_link("pty:"), duration_s=2.5) as (device, result):
        port = serial.Serial(device, timeout=0.05)
        wait_for(lambda: "value" in result, "the end of the run")
        # The pseudo-terminal is gone by now; what its buffer held cannot be read any more.
        port.close()
    counts = result["value"]["device"]
    assert counts["samples_produced"] == pytest.approx(2500, abs=3)
    assert counts["samples_dropped"] > 500


def test_what_was_dropped_while_nobody_read_is_told_exactly_afterwards():
    with emulator_thread(load_scenario("high-rate"), open_link("pty:")) as (device, _):
        host = Host(device)
        host.tell(p.Start(1, with_raw_imu=True))  # 45 kB/s: more than every buffer on the way takes
        host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 100)
        busy_until = time.monotonic() + 1.5
        wait_for(lambda: time.monotonic() > busy_until, "a while")  # the reader is busy with something else
        host.read_until(lambda h: any(s.errors & p.DeviceError.TRANSMIT_OVERFLOW for s in h.all(p.Status)))
        host.tell(p.Stop(2))
        host.read_until(lambda h: h.all(p.Ack)[-1].command_id == 2)
        statuses = host.count(p.PacketType.STATUS)
        host.read_until(lambda h: h.count(p.PacketType.STATUS) > statuses)
        last = host.all(p.Status)[-1]
        assert last.state is p.DeviceState.IDLE
        assert last.samples_dropped > 100
        assert host.count(p.PacketType.ORIENTATION) == last.samples_produced - last.samples_dropped
        assert counted(host.items)["samples_lost"] == last.samples_dropped
        host.port.close()


def test_a_reader_may_go_and_come_back_and_gets_no_stale_samples():
    mute = load_scenario("mute")
    with emulator_thread(mute, open_link("pty:")) as (device, _):
        last_time_us = 0
        for _ in range(3):
            host = Host(device)
            host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 10)
            batch = host.all(p.OrientationBatch)[0]
            assert int(batch.device_time_us[0]) > last_time_us
            last_time_us = int(host.all(p.OrientationBatch)[-1].device_time_us[-1])
            assert host.decoder.counters.crc_errors == 0
            host.port.close()
            gone = time.monotonic() + 0.2
            wait_for(lambda gone=gone: time.monotonic() > gone, "a while")


def test_symbolic_links_and_files_at_the_path(tmp_path):
    path = tmp_path / "object"
    path.write_text("precious")
    with pytest.raises(LinkError, match="exists and is not a symbolic link"):
        run(load_scenario("static"), open_link(f"pty:{path}"), duration_s=0.0)
    assert path.read_text() == "precious"

    elsewhere = tmp_path / "elsewhere"
    elsewhere.symlink_to(path)
    with pytest.raises(LinkError, match="not a device"):
        run(load_scenario("static"), open_link(f"pty:{elsewhere}"), duration_s=0.0)

    dangling = tmp_path / "dangling"
    dangling.symlink_to("/dev/pts/99999")
    seen = []
    run(
        load_scenario("static"),
        open_link(f"pty:{dangling}"),
        duration_s=0.01,
        on_ready=lambda _: seen.append(dangling.readlink()),
    )
    assert seen[0] != Path("/dev/pts/99999")
    assert not os.path.lexists(dangling)

    with pytest.raises(LinkError, match="cannot make the symbolic link"):
        run(load_scenario("static"), open_link(f"pty:{tmp_path}/no/folder"), duration_s=0.0)


def test_a_name_that_another_object_has_is_refused(tmp_path):
    path = tmp_path / "object"
    first, second = open_link(f"pty:{path}"), open_link(f"pty:{path}")
    first.open()
    taken = path.readlink()
    with pytest.raises(LinkError, match="the device of another virtual object"):
        second.open()
    assert path.readlink() == taken
    first.close()
    second.open()
    second.close()
    assert not os.path.lexists(path)


def test_a_name_left_behind_by_a_crash_is_used_again(tmp_path):
    path = tmp_path / "object"
    primary, secondary = os.openpty()
    path.symlink_to(os.ttyname(secondary))
    os.close(primary)
    os.close(secondary)
    with open_link(f"pty:{path}"):
        assert path.exists()


def test_a_name_that_leads_elsewhere_meanwhile_is_left_there(tmp_path):
    path = tmp_path / "object"
    link = open_link(f"pty:{path}")
    link.open()
    path.unlink()
    path.symlink_to("/dev/null")
    link.close()
    assert str(path.readlink()) == "/dev/null"


def test_unplug_and_replug_keep_the_name(tmp_path):
    path = tmp_path / "object"
    with open_link(f"pty:{path}") as link:
        port = serial.Serial(str(path), timeout=0.05)
        link.unplug()
        assert not os.path.lexists(path)
        assert link.send([b"\x01"]) is None
        assert link.receive() == []
        with pytest.raises((serial.SerialException, OSError)):
            port.read(1)
        port.close()
        link.replug()
        with serial.Serial(str(path), timeout=HANG_S) as again:
            assert link.send([b"\x05\x81\x01\x00"]) == 1
            assert again.read(1) == b"\0"


def test_tcp_serves_one_client_after_another_and_none_beside():
    with emulator_thread(load_scenario("default"), open_link("tcp:0")) as (url, result):
        assert url.startswith("socket://127.0.0.1:")
        host = Host(url)
        host.tell(p.Start(1))
        host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 20)
        second = serial.serial_for_url(url, timeout=0.2)
        with pytest.raises(serial.SerialException):
            wait_for(lambda: second.read(1), "the refusal")  # it gets nothing and is cut off
        second.close()
        host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 40)
        host.port.close()
        third = Host(url).read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 20)
        assert third.decoder.counters.crc_errors == 0
        third.port.close()
    assert result["value"]["device"]["commands"] == 1


def test_a_tcp_client_that_does_not_read_does_not_block():
    mute = load_scenario("mute")
    scenario = replace(mute, device=replace(mute.device, rate_hz=1000))
    with emulator_thread(scenario, open_link("tcp:0"), duration_s=0.5) as (url, result):
        client = serial.serial_for_url(url, timeout=0.05)
        wait_for(lambda: "value" in result, "the end of the run")
        client.close()
    assert result["value"]["device"]["samples_produced"] == pytest.approx(500, abs=3)


def test_addresses_that_are_wrong(tmp_path):
    for address, says in [
        ("usb:3", "no link 'usb:3'"),
        ("pty", "no link 'pty'"),
        ("tcp:", "needs a port"),
        ("tcp:99999", "needs a port"),
        ("tcp:-1", "needs a port"),
        ("tcp:²", "needs a port"),
        ("tcp:0.0.0.0:5000", "127.0.0.1 only"),
        ("file:", "needs a path"),
    ]:
        with pytest.raises(LinkError, match=says):
            open_link(address)
    taken = open_link("tcp:0")
    with taken, pytest.raises(LinkError, match="cannot listen on port"):
        open_link(f"tcp:{taken.port}").open()
    with pytest.raises(EmulatorError, match="cannot write"):
        open_link(f"file:{tmp_path}/no/folder").open()
    with pytest.raises(EmulatorError, match="cannot write the truth"):
        run(load_scenario("static"), open_link("pty:"), duration_s=0.0, truth_path=tmp_path / "no" / "truth.json")


def test_a_ten_minute_trial_in_virtual_time_to_a_byte_file(tmp_path):
    default = load_scenario("default")
    scenario = replace(default, motion=replace(default.motion, cycles=149))
    started = time.monotonic()
    result = run(scenario, open_link(f"file:{tmp_path}/trial.bin"), truth_path=tmp_path / "truth.json")
    print(f"{result['duration_s']:.0f} s of trial in {time.monotonic() - started:.2f} s")
    assert result["duration_s"] == 600.0
    decoder = StreamDecoder()
    items = decoder.feed((tmp_path / "trial.bin").read_bytes())
    assert decoder.counters.packets[p.PacketType.ORIENTATION] == result["device"]["samples_produced"]
    assert decoder.counters.crc_errors == counted(items)["sequence_gaps"] == 0
    assert json.loads((tmp_path / "truth.json").read_text()) == json.loads(json.dumps(result))
    with pytest.raises(EmulatorError, match="exists"):
        run(scenario, open_link(f"file:{tmp_path}/trial.bin"))


def test_the_same_seed_gives_the_same_file(tmp_path):
    for name in ("a", "b"):
        run(load_scenario("tempo"), open_link(f"file:{tmp_path}/{name}"), duration_s=20.0, seed=5)
    run(load_scenario("tempo"), open_link(f"file:{tmp_path}/c"), duration_s=20.0, seed=6)
    a, b, c = ((tmp_path / name).read_bytes() for name in "abc")
    assert a == b != c


def test_a_run_that_would_never_end_in_virtual_time_is_refused(tmp_path):
    long = replace(load_scenario("default"), motion=replace(load_scenario("default").motion, cycles=2000, period_s=600))
    with pytest.raises(EmulatorError, match="a duration of at most 7 days"):
        run(long, open_link(f"file:{tmp_path}/x"))


def test_a_stop_event_ends_a_run_soon():
    with emulator_thread(load_scenario("static"), open_link("pty:")) as (_, result):
        pass
    assert result["value"]["complete"] is True


def test_samples_leave_when_they_are_made_not_in_bunches():
    with emulator_thread(load_scenario("ideal"), open_link("pty:")) as (device, _):
        host = Host(device)
        host.tell(p.Start(1))
        host.read_until(lambda h: h.count(p.PacketType.ORIENTATION) >= 100)
        sizes = [len(batch) for batch in host.all(p.OrientationBatch)]
        # A busy machine may bunch some; all of them would be a fault of ours.
        assert len(sizes) >= 30
        host.port.close()
