"""Checks of machine and link, on every platform's findings with small fakes, and the command itself."""

import json
import sys
import threading
from dataclasses import replace

import pytest

from emulator.faults.definitions import FaultSettings
from host.doctor import machine_check
from host.doctor.findings import Finding, Verdict, judged
from host.doctor.link_check import check_link
from host.links.can.listing import CanPort
from host.links.serial.listing import SerialPort
from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import quick_scenario, rotdrift, rotdrift_here
from tests.faulty_trials import faulty_chunks
from tests.recorded_trials import scenario, write_recording

PORT = SerialPort("serial:/dev/ttyUSB0", "/dev/ttyUSB0", "USB Serial", "0403:6001", "A1", ())


def found(findings):
    return {finding.topic: finding for finding in findings}


def test_a_missing_library_is_bad(monkeypatch):
    assert found(machine_check.versions())["libraries"].verdict is Verdict.OK
    monkeypatch.setattr(machine_check, "LIBRARIES", ("numpy", "no-such-library"))
    libraries = found(machine_check.versions())["libraries"]
    assert libraries.verdict is Verdict.BAD
    assert "no-such-library missing" in libraries.text


@pytest.mark.parametrize(("source", "verdict"), [("tsc", Verdict.OK), ("jiffies", Verdict.DOUBTFUL)])
def test_a_coarse_clock_source_is_doubtful(tmp_path, source, verdict):
    folder = tmp_path / "devices/system/clocksource/clocksource0"
    folder.mkdir(parents=True)
    (folder / "current_clocksource").write_text(source + "\n")
    clock = found(machine_check.clock_source(tmp_path))["clock"]
    assert clock.verdict is verdict
    assert source in clock.text
    assert "source" not in found(machine_check.clock_source(tmp_path / "none"))["clock"].text


def test_the_disk_is_measured_and_left_clean(tmp_path):
    findings = found(machine_check.disk(tmp_path))
    assert findings["disk speed"].text.endswith("MB/s written")
    assert list(tmp_path.iterdir()) == []
    nowhere = found(machine_check.disk(tmp_path / "nowhere"))
    assert nowhere["disk"].verdict is Verdict.BAD


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
def test_a_disk_that_cannot_be_written_is_bad():
    from pathlib import Path

    assert found(machine_check.disk(Path("/proc")))["disk speed"].verdict is Verdict.BAD


def test_a_port_of_another_group_says_what_to_do_on_linux():
    usb, uart = PORT, replace(PORT, device="/dev/ttyS0", vid_pid="", description="")
    findings = found(machine_check.serial_ports([usb, uart], "linux", may_open=lambda _device: False))
    assert findings["/dev/ttyUSB0"].verdict is Verdict.BAD
    assert 'ATTRS{idVendor}=="0403", ATTRS{idProduct}=="6001"' in findings["/dev/ttyUSB0"].remedy
    assert "usermod -aG dialout" in findings["/dev/ttyS0"].remedy
    assert findings["/dev/ttyS0"].text == "no USB device; you may not open it"


def test_a_held_port_names_the_holder():
    held = replace(PORT, owners=("minicom (process 4711)",))
    finding = found(machine_check.serial_ports([held], "linux", may_open=lambda _device: True))["/dev/ttyUSB0"]
    assert finding.verdict is Verdict.DOUBTFUL
    assert "held by minicom (process 4711)" in finding.text


@pytest.mark.parametrize(("timer", "verdict"), [("16", Verdict.DOUBTFUL), ("1", Verdict.OK), ("?", Verdict.INFO)])
def test_the_latency_timer_of_an_ftdi_adapter(tmp_path, timer, verdict):
    folder = tmp_path / "bus/usb-serial/devices/ttyUSB0"
    folder.mkdir(parents=True)
    (folder / "latency_timer").write_text(timer + "\n")
    finding = found(machine_check.serial_ports([PORT], "linux", tmp_path, lambda _device: True))[
        "/dev/ttyUSB0 latency timer"
    ]
    assert finding.verdict is verdict
    if timer == "16":
        assert finding.remedy.startswith("echo 1 | sudo tee ")


@pytest.mark.parametrize(("system", "said"), [("win32", "Device Manager"), ("darwin", "/dev/cu.*"), ("linux", "dmesg")])
def test_no_port_at_all_says_where_to_look(system, said):
    (finding,) = machine_check.serial_ports([], system)
    assert said in finding.remedy


def test_other_systems_cannot_read_the_latency_timer():
    for system, said in (("win32", "Device Manager"), ("darwin", "driver")):
        assert said in found(machine_check.serial_ports([PORT], system))["/dev/ttyUSB0 latency timer"].remedy


def test_a_finding_is_good_or_comes_with_a_remedy():
    assert judged("a", "b", good=True, remedy="c") == Finding("a", Verdict.OK, "b", "")
    assert judged("a", "b", good=False, remedy="c").to_json() == {
        "topic": "a",
        "verdict": "doubtful",
        "text": "b",
        "mend": "c",
    }


# ---- links ----------------------------------------------------------------------------------------------------------


def checked_recording(tmp_path, **faults):
    """What is found on a link that a virtual object's recording stands behind."""
    chosen = replace(scenario("ideal", motion={"cycles": 2}), faults=FaultSettings(**faults))
    chunks, _ = faulty_chunks(chosen)
    return found(check_link(f"replay:{write_recording(tmp_path / 'x.mcap', chunks)}", 3600.0, threading.Event()))


def test_a_good_link_is_good(tmp_path):
    findings = checked_recording(tmp_path)
    assert findings["object"].text.startswith("virtual cube ")
    assert findings["rate"].text == "100.0 Hz (100 promised)"
    assert findings["losses"].text.startswith("0 of ")
    judged = {name: finding.verdict for name, finding in findings.items() if not name.startswith("disk")}
    assert set(judged.values()) <= {Verdict.OK, Verdict.INFO}, judged  # the disk's speed is the machine's


def test_a_lossy_link_is_bad(tmp_path):
    findings = checked_recording(tmp_path, drop_probability=0.1, bit_error_rate=2e-4)
    assert findings["losses"].verdict is Verdict.BAD
    assert findings["rate"].verdict is Verdict.DOUBTFUL
    assert "another cable" in findings["losses"].remedy


def test_a_link_that_is_not_there_is_bad(tmp_path):
    (finding,) = check_link(f"serial:{tmp_path / 'none'}", 1.0, threading.Event())
    assert finding.verdict is Verdict.BAD
    assert "there is no port" in finding.text


@pytest.mark.skipif(sys.platform == "win32", reason="needs ptys")
def test_the_command_reports_a_live_link_and_its_exit_code(tmp_path):
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        done = rotdrift("doctor", virtual.link, "--seconds", 1.5, "--json", "--folder", tmp_path)
    findings = {finding["topic"]: finding for finding in json.loads(done.stdout)}
    assert {"rotdrift", "clock", "disk room", "link", "object", "rate", "jitter", "losses"} <= set(findings)
    assert findings["object"]["verdict"] == findings["link"]["verdict"] == findings["losses"]["verdict"] == "ok"
    assert done.returncode in {0, 1}
    gone = rotdrift_here("doctor", virtual.link, "--folder", tmp_path)
    assert gone.returncode == 3
    assert "! link" in gone.stdout
    assert rotdrift_here("doctor", "--seconds", "0").returncode == 2


def test_can_interfaces_are_named_and_one_that_is_down_says_how_to_bring_it_up():
    up = CanPort("can:socketcan:can0", "SocketCAN interface", "up", True)
    down = CanPort("can:socketcan:can1", "SocketCAN interface", "down", True)
    findings = found(machine_check.can_interfaces([up, down]))
    assert findings[up.link].verdict is Verdict.OK
    assert findings[down.link].verdict is Verdict.INFO  # nobody asked for it
    assert "ip link set can1 up" in findings[down.link].remedy
