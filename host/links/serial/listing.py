"""The serial ports of this machine, and who holds one open, where the system reports it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from serial.tools import list_ports

from host.text import plain

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
    """``2341:0043``; empty where it is not a USB device."""
    serial_number: str
    owners: tuple[str, ...]
    """Programs that have it open, where the system reports them."""


def list_serial_ports() -> list[SerialPort]:
    """Return the ports, sorted by name. Texts come from devices, so they are made plain."""
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


def existing_ports() -> list[str]:
    """Return the names of the ports, sorted."""
    try:
        return sorted(str(port.device) for port in _list_ports.comports())
    except OSError:  # a listing that fails must not hide the failure that asked for it
        return []


def port_owners(device: str, proc: Path = Path("/proc")) -> list[str]:
    """Return the other processes that have a device open, as ``"minicom (process 4711)"``.

    Reads ``/proc/*/fd``; processes of other users are not visible without privilege, and other systems have no
    ``/proc``, so an empty list does not mean that nobody holds it.
    """
    owners = []
    try:
        target = os.path.realpath(device)
        processes = [entry for entry in proc.iterdir() if entry.name.isdigit() and entry.name != str(os.getpid())]
    except OSError:
        return []
    for process in sorted(processes, key=lambda entry: int(entry.name)):
        try:
            held = any(str(link.readlink()) == target for link in (process / "fd").iterdir())
            if held:
                owners.append(f"{_name(process)} (process {process.name})")
        except OSError:  # gone meanwhile, or another user's
            continue
    return owners


def _name(process: Path) -> str:
    arguments = (process / "cmdline").read_bytes().split(b"\0")
    words = [word.decode(errors="replace") for word in arguments if word]
    # `python3 /usr/bin/rotdrift capture …` is rotdrift to the person who typed it.
    if len(words) > 1 and Path(words[0]).name.startswith("python"):
        words = [word for word in words[1:] if not word.startswith("-")] or words
    name = Path(words[0]).name if words else (process / "comm").read_text(errors="replace")
    return plain(name, 60)
