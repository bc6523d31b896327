"""The machine check of ``rotdrift doctor``: versions, clock, disk, and ports with whatever blocks them.

Whatever differs between systems gets platform and folders as arguments, so that all platforms are tested on one.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from host.doctor.findings import Finding, Verdict, judged
from host.errors import reason_of
from host.links.serial.listing import SerialPort
from host.text import plain
from host.version import VERSION

if TYPE_CHECKING:
    from host.links.can.listing import CanPort

LIBRARIES = ("numpy", "scipy", "pyserial", "python-can", "mcap", "rich", "construct", "cobs", "matplotlib")
DISK_TEST_MIB = 16
NAPS = 20
MIN_FREE_BYTES = 2**30
MIN_DISK_MB_S = 5.0
"""A capture writes 0.2 MB/s at 1 kHz; a disk slower than this hangs for seconds now and then."""
FTDI_VENDOR = "0403"
LATENCY_TIMER_MS = 2
SYS = Path("/sys")
MAX_LATENESS_MS = 5.0


def versions() -> list[Finding]:
    """Return the versions of rotdrift, Python and the libraries that matter."""
    found = []
    for name in LIBRARIES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            found.append(f"{name} missing")
    python = f"{platform.python_implementation()} {platform.python_version()}"
    bad = [item for item in found if item.endswith("missing")]
    return [
        Finding("rotdrift", Verdict.INFO, f"{VERSION}, {python}, {platform.system()} {platform.release()}"),
        judged("libraries", ", ".join(found), good=not bad, remedy="install rotdrift again", verdict=Verdict.BAD),
    ]


def clock_source(sys_folder: Path = SYS) -> list[Finding]:
    """Return which clock stamps chunks, and how late this machine wakes up from naps of 1 ms."""
    info = time.get_clock_info("monotonic")
    text = f"{info.implementation}, resolution {info.resolution * 1e9:.0f} ns"
    try:
        source = (sys_folder / "devices/system/clocksource/clocksource0/current_clocksource").read_text().strip()
        text += f", source {plain(source, 40)}"
    except OSError:
        source = ""
    late_ms = []
    for _ in range(NAPS):
        before = time.monotonic()
        time.sleep(0.001)
        late_ms.append(1e3 * (time.monotonic() - before) - 1.0)
    worst_ms = max(late_ms)
    return [
        judged(
            "clock",
            text,
            good=source not in {"jiffies", "refined-jiffies"} and info.resolution <= 1e-6,
            remedy="time stamps are coarse; choose another clock source (Linux: tsc)",
        ),
        judged(
            "wake-ups",
            f"late by at most {worst_ms:.2f} ms in {NAPS}",
            good=worst_ms < MAX_LATENESS_MS,
            remedy="the machine is busy: end other programs; chunks are stamped late while it is",
        ),
    ]


def disk(folder: Path) -> list[Finding]:
    """Return free space and speed of the disk that a recording would go to; the file written for it is removed."""
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return [
            Finding("disk", Verdict.BAD, f"{folder} cannot be looked at ({error.strerror})", "go to another folder")
        ]
    found = [
        judged(
            "disk room",
            f"{free / 1e9:.1f} GB free at {folder}",
            good=free >= MIN_FREE_BYTES,
            remedy="make room: an hour at 200 Hz takes 0.15 GB, and the system wants some",
        )
    ]
    path = folder / f".rotdrift-doctor-{os.getpid()}"
    try:
        block = bytes(2**20)
        started = time.monotonic()
        with path.open("xb") as file:
            for _ in range(DISK_TEST_MIB):
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
        speed = DISK_TEST_MIB * len(block) / 1e6 / max(time.monotonic() - started, 1e-6)
    except OSError as error:
        text = f"{folder} cannot be written ({reason_of(error)})"
        return [*found, Finding("disk speed", Verdict.BAD, text, "give --out in a folder that can be written")]
    finally:
        path.unlink(missing_ok=True)
    remedy = "record to another disk, not to a network or SD card"
    return [*found, judged("disk speed", f"{speed:.0f} MB/s written", good=speed >= MIN_DISK_MB_S, remedy=remedy)]


def can_interfaces(ports: Iterable[CanPort]) -> list[Finding]:
    """Return every CAN interface and adapter, and how to bring one up that is down."""
    found = []
    for port in ports:
        name = port.link.rpartition(":")[2]
        remedy = f"`sudo ip link set {name} up type can bitrate 500000`" if port.state == "down" else ""
        verdict = Verdict.INFO if port.state in ("", "down") else Verdict.OK
        found.append(Finding(port.link, verdict, f"{port.description} {port.state}".strip(), remedy))
    return found


def serial_ports(
    ports: Iterable[SerialPort],
    system: str = sys.platform,
    sys_folder: Path = SYS,
    may_open: Callable[[str], bool] | None = None,
) -> list[Finding]:
    """Return the state of every serial port: its holders, whether we may open it, the latency timer of an FTDI adapter.

    ``may_open`` reports whether a device may be read and written; by default the system is asked.
    """
    may_open = may_open or (lambda device: os.access(device, os.R_OK | os.W_OK))
    found = []
    for port in ports:
        what = " ".join(part for part in (port.vid_pid, port.description) if part) or "no USB device"
        if port.owners:
            remedy = "end that program before a capture"
            found.append(Finding(port.device, Verdict.DOUBTFUL, f"{what}; held by {', '.join(port.owners)}", remedy))
        elif system.startswith("linux") and not may_open(port.device):
            found.append(Finding(port.device, Verdict.BAD, f"{what}; you may not open it", _linux_remedy(port)))
        else:
            found.append(Finding(port.device, Verdict.OK, what))
        if port.vid_pid.startswith(FTDI_VENDOR):
            found.append(_latency_timer(port, system, sys_folder))
    return found or [Finding("serial ports", Verdict.INFO, "none here", _no_port_remedy(system))]


def _linux_remedy(port: SerialPort) -> str:
    vendor, _, product = port.vid_pid.partition(":")
    if not product:
        return "sudo usermod -aG dialout $USER (uucp on Arch), then log out and in"
    rule = f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", TAG+="uaccess"'
    return f"sudo usermod -aG dialout $USER (uucp on Arch), or put into /etc/udev/rules.d/70-rotdrift.rules: {rule}"


def _latency_timer(port: SerialPort, system: str, sys_folder: Path) -> Finding:
    """Return how long an FTDI adapter keeps bytes back: 16 ms unless set otherwise."""
    topic = f"{port.device} latency timer"
    remedies = {
        "win32": "Device Manager > port > Port Settings > Advanced > Latency Timer: 1",
        "darwin": "use FTDI's own driver",
    }
    if system in remedies:
        return Finding(topic, Verdict.INFO, "not readable from here; 16 ms unless changed", remedies[system])
    path = sys_folder / "bus/usb-serial/devices" / Path(port.device).name / "latency_timer"
    try:
        timer_ms = int(path.read_text())
    except (OSError, ValueError):
        return Finding(topic, Verdict.INFO, "not known")
    remedy = f"echo 1 | sudo tee {path}"
    return judged(topic, f"{timer_ms} ms", good=timer_ms <= LATENCY_TIMER_MS, remedy=remedy)


def _no_port_remedy(system: str) -> str:
    if system == "win32":
        return "plug the object in; if none appears, Device Manager shows whether its driver is missing"
    if system == "darwin":
        return "plug the object in; ports are /dev/cu.*; an adapter may want its maker's driver allowed in Settings"
    return "plug the object in; `dmesg | tail` says what the system made of it"
