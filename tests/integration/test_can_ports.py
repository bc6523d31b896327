"""``rotdrift ports``: CAN interfaces, and objects found by listening."""

from __future__ import annotations

import json
import os
from pathlib import Path

import can
import pytest

from firmware_protocol.can.mapping import HOST_FUNCTIONS, split_id
from host.cli import main
from host.doctor.object_probe import objects_on
from host.links.can.listing import list_can_ports
from host.links.serial.listing import SerialPort
from tests.can_link_run import object_on


def interface(root: Path, name: str, kind: int, flags: int, real: bool) -> None:
    (root / name).mkdir(parents=True)
    (root / name / "type").write_text(f"{kind}\n")
    (root / name / "flags").write_text(f"{flags:#x}\n")
    if real:
        (root / name / "device").mkdir()


def test_can_interfaces_are_listed_with_their_links(tmp_path: Path) -> None:
    interface(tmp_path, "can0", 280, 0x40081, True)
    interface(tmp_path, "vcan1", 280, 0x80, False)
    interface(tmp_path, "eth0", 1, 0x1003, True)
    canable = SerialPort("serial:/dev/ttyACM3", "/dev/ttyACM3", "CANable2", "16d0:117e", "1", ())
    board = SerialPort("serial:/dev/ttyUSB0", "/dev/ttyUSB0", "board", "1a86:7523", "1", ())
    ports = {port.link: port for port in list_can_ports([canable, board], tmp_path)}
    assert ports["can:socketcan:can0"].state == "up"
    assert ports["can:socketcan:vcan1"].state == "down"
    assert "virtual" in ports["can:socketcan:vcan1"].description
    assert "CANable 2" in ports["can:slcan:/dev/ttyACM3?bitrate=500000"].description
    assert not any("eth0" in link or "ttyUSB0" in link for link in ports)
    assert all(port.can_listen for port in ports.values())


def test_objects_are_found_by_listening_and_nothing_is_sent(request: pytest.FixtureRequest) -> None:
    bus = f"can:virtual:{request.node.name}"
    spy = can.Bus(interface="virtual", channel=request.node.name)
    objects = object_on(f"{bus}?node=4"), object_on(f"{bus}?node=9&fd=1"), object_on("can:slcan:pty?node=3")
    with spy, objects[0], objects[1], objects[2] as (uri, _):
        device = uri.partition("?")[0]
        found = objects_on([bus, device, "can:virtual:nobody-here"], 2.5)
        assert found == {
            bus: [f"{bus}?node=4", f"{bus}?node=9&fd=1"],
            device: [f"{device}?node=3"],
            "can:virtual:nobody-here": [],
        }
        on_bus = []
        while (message := spy.recv(0.0)) is not None:
            on_bus.append(split_id(message.arbitration_id).function)
    assert len(on_bus) > 10
    assert not HOST_FUNCTIONS & set(on_bus)


@pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals")
def test_a_probe_finds_serial_and_slcan_objects_and_sends_nothing_to_other_devices(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)

    def port(uri: str, vid_pid: str, owners: tuple[str, ...] = ()) -> SerialPort:
        device = uri.partition("?")[0].rpartition(":")[2]
        return SerialPort(f"serial:{device}", device, "a board with quite a long description", vid_pid, "", owners)

    with object_on("pty:") as (serial, _), object_on("can:slcan:pty?node=3") as (slcan, _):
        listed = [
            port(serial, "1a86:7523"),
            port(slcan, "16d0:117e"),
            port(os.ttyname(slave), "0483:5740"),
            port("/dev/ttyACM99", "1a86:7523", ("minicom (process 4711)",)),
        ]
        monkeypatch.setattr("host.links.serial.listing.list_serial_ports", lambda: listed)
        assert main(["ports", "--probe"]) == 0
    said = capsys.readouterr().out
    with pytest.raises(BlockingIOError):
        os.read(master, 100)
    os.close(master)
    os.close(slave)
    adapter = slcan.partition("?")[0]
    heard = said.partition("objects heard:\n")[2].partition("\n\n")[0].split()
    assert heard == [serial, f"{adapter}?bitrate=500000&node=3"]
    skipped = said.partition("not listened to:\n")[2]
    assert "ttyACM99  (held by minicom (process 4711))" in skipped
    assert f"can:slcan:{listed[2].device}?bitrate=500000  (opening it could disturb what is there)" in skipped
    assert f"{listed[1].link}  (an SLCAN adapter" in skipped
    assert "…" not in said


def test_the_command_prints_a_list_for_machines(capsys: pytest.CaptureFixture) -> None:
    assert main(["ports", "--json"]) == 0
    assert isinstance(json.loads(capsys.readouterr().out), list)
    assert main(["ports", "--json", "--probe"]) == 0
    assert all("objects" in row for row in json.loads(capsys.readouterr().out))
