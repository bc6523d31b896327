"""The serial ports of this machine."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from serial.tools import list_ports

from host.plain_text import plain
from host.transports.port_owner import port_owners

_list_ports: Any = list_ports


@dataclass(frozen=True, slots=True)
class SerialPort:
    """One serial port."""

    link: str
    """The URI to capture from."""
    device: str
    description: str
    """What the driver calls it."""
    vid_pid: str
    """``2341:0043``; empty where it is no USB device."""
    serial_number: str
    owners: tuple[str, ...]
    """Programs that have it open, where the system tells."""

    def to_json(self) -> dict[str, Any]:
        """Turn into plain values."""
        return asdict(self)


def list_serial_ports() -> list[SerialPort]:
    """List the ports, sorted by name. Texts come from devices and are made plain."""
    ports = []
    for port in sorted(_list_ports.comports(), key=lambda found: str(found.device)):
        known = port.vid is not None and port.pid is not None
        description = "" if port.description in {None, "n/a"} else str(port.description)
        ports.append(
            SerialPort(
                link=f"serial:{port.device}",
                device=str(port.device),
                description=plain(description, 60),
                vid_pid=f"{port.vid:04x}:{port.pid:04x}" if known else "",
                serial_number=plain(port.serial_number or "", 60),
                owners=tuple(port_owners(str(port.device))),
            )
        )
    return ports
