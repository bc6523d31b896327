"""The CAN interfaces of this machine: SocketCAN from the kernel's own list, adapters from python-can's drivers."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from host.links.can.drivers import LISTENING
from host.links.serial.listing import SerialPort
from host.text import plain

ARPHRD_CAN = "280"
"""Kind of a CAN interface in ``/sys/class/net/*/type``."""
SYS_NET = Path("/sys/class/net")
SLCAN_ADAPTERS = {"16d0:117e": "CANable 2 (SLCAN)", "ad50:60c4": "CANable (SLCAN)", "0403:ffa8": "Lawicel CANUSB"}
"""USB ids of adapters that speak SLCAN on a serial port."""
PERHAPS_SLCAN = {"0483:5740": "STM32 virtual COM port, may be an SLCAN adapter"}
"""USB ids of adapters and of other devices: nothing must be sent to them unasked."""
DRIVERS = ("gs_usb", "pcan", "kvaser", "ixxat", "vector", "canalystii", "cantact", "neovi", "nican", "systec")
"""Interfaces of python-can that can list their adapters without a pause and without sending."""


@dataclass(frozen=True, slots=True)
class CanPort:
    """One CAN interface."""

    link: str
    """The URI to capture from."""
    description: str
    state: str
    """``up``, ``down``, or empty where nobody knows before it is opened."""
    can_listen: bool
    """Whether it can be opened without disturbing the bus, or what else may be there."""


def list_can_ports(serial_ports: Iterable[SerialPort] = (), sys_net: Path = SYS_NET) -> list[CanPort]:
    """Return the CAN interfaces, sorted by link, and the serial ports that may be SLCAN adapters by their USB ids."""
    ports = _socketcan(sys_net) + _adapters()
    ports += [
        CanPort(f"can:slcan:{port.device}?bitrate=500000", what, "", port.vid_pid in SLCAN_ADAPTERS)
        for port in serial_ports
        if (what := (SLCAN_ADAPTERS | PERHAPS_SLCAN).get(port.vid_pid)) is not None
    ]
    return sorted(ports, key=lambda port: port.link)


def _socketcan(sys_net: Path) -> list[CanPort]:
    ports = []
    with contextlib.suppress(OSError):
        for interface in sys_net.iterdir():
            with contextlib.suppress(OSError):
                if (interface / "type").read_text().strip() != ARPHRD_CAN:
                    continue
                # Virtual interfaces have no carrier: "unknown" there means up.
                flags = int((interface / "flags").read_text().strip(), 16)
                virtual = not (interface / "device").exists()
                description = "virtual SocketCAN interface" if virtual else "SocketCAN interface"
                state = "up" if flags & 1 else "down"
                ports.append(CanPort(f"can:socketcan:{plain(interface.name, 20)}", description, state, True))
    return ports


def _adapters() -> list[CanPort]:
    ports = []
    for interface in DRIVERS:
        found: list[Any] = []
        with contextlib.suppress(Exception):  # a driver that fails to list has nothing to list
            found = list(can.detect_available_configs([interface]))
        for config in found:
            channel = plain(str(config.get("channel", "")), 60)
            link = f"can:{interface}:{channel}?bitrate=500000"
            ports.append(CanPort(link, f"{interface} adapter", "", interface in LISTENING))
    return ports
