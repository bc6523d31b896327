"""Faults on a real pseudo-terminal in real time, started by live commands."""

import os
import sys
import threading
from contextlib import contextmanager
from dataclasses import replace
from queue import SimpleQueue

import pytest
import serial

from emulator.faults.definitions import FaultSettings, parse_fault_command
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol import packets as p
from firmware_protocol.serial.decoder import StreamDecoder
from tests.sequence_oracle import counted
from tests.waiting import wait_for, wait_for_event, wait_for_thread

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are a thing of Unix")

MUTE = load_scenario("mute")


@contextmanager
def running(scenario, path):
    """A virtual object at a path; gives the queue of live faults and, at the end, the truth."""
    stop, ready, live, truth = threading.Event(), threading.Event(), SimpleQueue(), {}

    def work():
        result = run(scenario, open_link(f"pty:{path}"), stop=stop, on_ready=lambda _: ready.set(), live_faults=live)
        truth.update(result)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        wait_for_event(ready, "an object that is ready")
        yield live, truth
    finally:
        stop.set()
        wait_for_thread(thread)


class Reader:
    def __init__(self, path):
        self.port = serial.Serial(str(path), timeout=0.05)
        self.decoder, self.items, self.sizes = StreamDecoder(), [], []

    def read(self):
        data = self.port.read(self.port.in_waiting or 1)
        self.sizes += [len(data)] if data else []
        self.items += self.decoder.feed(data)
        return data

    def read_until(self, condition):
        wait_for(lambda: condition(self), lambda: f"packets; there are {self.decoder.counters}", self.read)
        return self

    def count(self, packet_type):
        return self.decoder.counters.packets.get(packet_type, 0)


def test_unplugging_takes_the_device_away_and_brings_it_back_under_its_name(tmp_path):
    path = tmp_path / "object"
    with running(MUTE, path) as (live, truth):
        reader = Reader(path).read_until(lambda r: r.count(p.PacketType.ORIENTATION) >= 10)
        live.put(parse_fault_command("unplug for_s=0.3"))
        with pytest.raises((serial.SerialException, OSError)):
            wait_for(lambda: False, "the end of the link", reader.read)
        reader.port.close()
        assert not os.path.lexists(path)
        wait_for(path.exists, "the device")
        again = Reader(path).read_until(lambda r: r.count(p.PacketType.ORIENTATION) >= 10)
        assert again.decoder.counters.crc_errors == 0
        again.port.close()
    assert truth["fault_counts"] == {"unplug": 1}
    assert not os.path.lexists(path)


def test_a_reset_shows_as_a_new_boot(tmp_path):
    with running(MUTE, tmp_path / "object") as (live, truth):
        reader = Reader(tmp_path / "object").read_until(lambda r: r.count(p.PacketType.ORIENTATION) >= 30)
        reader.items.clear()  # the first boot's INFO may be there, if the reader was quick
        live.put(parse_fault_command("reset for_s=0.1"))
        reader.read_until(lambda r: any(isinstance(item, p.Info) for item in r.items))
        (info,) = (item for item in reader.items if isinstance(item, p.Info))
        reader.read_until(lambda r: r.count(p.PacketType.ORIENTATION) >= 60)
        batch = [item for item in reader.items if isinstance(item, p.OrientationBatch)][-1]
        assert batch.device_time_us[-1] < 60 * 10_000 + 10_000_000
        reader.port.close()
    assert info.boot_id == truth["device"]["boot_ids"][1] != truth["device"]["boot_ids"][0]


def test_a_delivery_interval_makes_bunches(tmp_path):
    faults = FaultSettings(delivery_interval_ms=100.0)
    scenario = replace(MUTE, device=replace(MUTE.device, rate_hz=200), faults=faults)
    with running(scenario, tmp_path / "object") as (_, truth):
        reader = Reader(tmp_path / "object").read_until(lambda r: r.count(p.PacketType.ORIENTATION) >= 200)
        assert max(reader.sizes) >= 10 * 22  # about 20 samples of 22 bytes each time
        assert counted(reader.items)["sequence_gaps"] == 0
        reader.port.close()
    assert truth["sent"]["ORIENTATION"] >= 200
