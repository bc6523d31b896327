"""Opening buses through python-can: what each interface wants, and its errors as sentences with a remedy."""

from __future__ import annotations

import contextlib
import errno
import logging
import re
import socket
import sys
import time
import warnings
from dataclasses import dataclass, replace
from typing import Any

import can
import serial

from firmware_protocol.can.mapping import MAX_NODE, MIN_NODE, NODE_MASK
from host.errors import LinkError, NoAnswerError, PortBusyError, PortNotFoundError, PortPermissionError, UsageError
from host.links.can.slcan import ChunkedSlcanBus
from host.links.can.socketcan import is_down, lengthen_queue, queue_of
from host.links.can.socketcand import WatchedSocketcandBus
from host.links.serial.errors import translate_open_error
from host.links.uri import LinkUri
from host.text import plain

# Without a handler of their own, python-can's warnings would go to the terminal, into the middle of a display.
logging.getLogger("can").addHandler(logging.NullHandler())

DEFAULT_BITRATE = 500_000
DEFAULT_DATA_BITRATE = 2_000_000
UNTIMED = frozenset({"virtual", "udp_multicast", "socketcan", "socketcand"})
"""Interfaces whose bit rate is set elsewhere."""
CLASSIC_ONLY = frozenset({"socketcand"})
LISTENING = frozenset({"socketcan", "slcan", "pcan", "kvaser", "virtual", "udp_multicast"})
"""Interfaces that can be set to listen only, or on whose bus listening disturbs nobody; others acknowledge frames."""
DRIVER_FILTERS = frozenset({"socketcan", "etas", "ixxat", "kvaser", "systec", "vector"})
"""Interfaces whose filters work in the driver, on data frames only."""
SLCAN_ANSWER_S = 3.0
"""Within what time an SLCAN adapter must send anything: boards that reset when their port is opened need 2 s."""
RETRY_S = 1.0
"""How long a socketcand server that refuses is asked again."""
DRIVER_REMEDIES = {
    "gs_usb": 'pip install "python-can[gs-usb]", or on Linux can:socketcan:can0',
    "pcan": "install PCAN-Basic of PEAK-System, or on Linux can:socketcan:can0",
    "kvaser": "install CANlib of Kvaser, or on Linux can:socketcan:can0",
    "vector": "install the XL driver library of Vector (Windows)",
    "ixxat": "install the VCI driver of HMS (Windows), or on Linux can:socketcan:can0",
    "canalystii": 'pip install "python-can[canalystii]"',
    "cantact": 'pip install "python-can[cantact]"',
    "neovi": 'pip install "python-can[neovi]"',
    "udp_multicast": 'pip install "rotdrift[multicast]"',
}
"""What an interface needs that python-can does not bring."""


@dataclass(frozen=True, slots=True)
class CanSettings:
    """A ``can:`` link, parsed."""

    interface: str
    """Name of the interface in python-can."""
    channel: str
    """What the interface calls the bus; for socketcand the bus name after the last ``/``."""
    host: str = ""
    """socketcand server."""
    port: int = 0
    """Its port."""
    node: int | None = None
    """Node id of the object; None is for the first that is heard."""
    fd: bool = False
    bitrate: int = DEFAULT_BITRATE
    data_bitrate: int = DEFAULT_DATA_BITRATE
    listen_only: bool = False
    """Send nothing, not even acknowledge bits where the adapter can be set so."""
    baud: int = 115_200
    """Of the serial port of an SLCAN adapter on a UART; USB adapters ignore it."""


def can_settings(uri: LinkUri) -> CanSettings:
    """Parse a ``can:INTERFACE:CHANNEL`` link.

    Raises
    ------
    UsageError
        No such interface, no channel, an option or number that cannot be.
    """
    uri.allow_options({"node", "bitrate", "fd", "data_bitrate", "listen_only", "baud"})
    interface, _, channel = uri.target.partition(":")
    if interface not in can.VALID_INTERFACES:
        raise UsageError(
            f"{interface or 'nothing'} in the link {uri} is not a CAN interface of python-can",
            "write it like can:socketcan:can0 or can:slcan:/dev/ttyACM0; `rotdrift ports` lists what is here",
        )
    if not channel:
        raise UsageError(f"the link {uri} names no channel", "write it like can:socketcan:can0")
    host, port = "", 0
    if interface == "socketcand":
        found = re.fullmatch(r"([^/:]+|\[[^\]]+\]):(\d{1,5})/(\S+)", channel)
        if found is None:
            raise UsageError(f"the link {uri} names no socketcand bus", "write it like can:socketcand:host:29536/can0")
        host, port, channel = found[1].strip("[]"), int(found[2]), found[3]
    uri = replace(uri, options={name: _in_full(name, text) for name, text in uri.options.items()})
    fd = bool(uri.integer("fd", 0, 0, 1))
    if fd and interface in CLASSIC_ONLY:
        raise UsageError(f"{interface} carries no CAN FD frames", "leave fd=1 out, or use another interface")
    return CanSettings(
        interface,
        channel,
        host,
        port,
        uri.integer("node", 0, MIN_NODE, MAX_NODE) or None,
        fd,
        uri.integer("bitrate", DEFAULT_BITRATE, 10_000, 1_000_000),
        uri.integer("data_bitrate", DEFAULT_DATA_BITRATE, 500_000, 8_000_000),
        bool(uri.integer("listen_only", 0, 0, 1)),
        uri.integer("baud", 115_200, 300, 12_000_000),
    )


def _in_full(name: str, text: str) -> str:
    """Return a bit rate written like ``500k`` or ``1M`` as a number of bit/s; anything else as it is."""
    found = re.fullmatch(r"(\d{1,4})([kKM])", text) if name in ("bitrate", "data_bitrate") else None
    return text if found is None else str(int(found[1]) * (1_000_000 if found[2] == "M" else 1000))


def open_bus(settings: CanSettings, name: str) -> can.BusABC:
    """Open the bus and set its filters.

    Raises
    ------
    LinkError, UsageError
        It does not open; the message has the reason and a remedy.
    """
    try:
        options, end_s = _bus_options(settings), time.monotonic() + RETRY_S
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # python-can's own deprecations are not the user's
            bus: can.BusABC
            if settings.interface == "slcan":
                bus = ChunkedSlcanBus(channel=settings.channel, **options)
            elif settings.interface == "socketcand":
                bus = _socketcand(settings.channel, options, end_s)
            else:
                bus = can.Bus(interface=settings.interface, channel=settings.channel, **options)
    except Exception as error:  # without its library a driver raises anything, NameError among it
        raise _open_error(error, settings, name) from error
    if settings.interface == "socketcan" and is_down(settings.channel):
        bus.shutdown()
        raise LinkError(
            f"the CAN interface {settings.channel} is down",
            f"`sudo ip link set {settings.channel} up type can bitrate {settings.bitrate}`",
        )
    lengthen_queue(bus)
    if settings.interface == "udp_multicast":
        _hear_own_group_only(bus)
    if settings.interface == "slcan":
        try:
            _await_adapter(bus, settings)
        except LinkError:
            with contextlib.suppress(can.CanError, OSError):  # an adapter that has gone does not close its channel
                bus.shutdown()
            raise
    return bus


def _socketcand(channel: str, options: dict[str, Any], end_s: float) -> can.BusABC:
    """Open a bus of a server that may not have noticed yet that its last client has gone."""
    while True:
        try:
            return WatchedSocketcandBus(channel=channel, **options)
        except can.CanError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.05)


def bus_filters(settings: CanSettings) -> list[dict[str, Any]] | None:
    """Return the filters: our 11-bit ids, of one node where it is known; None where they would hide error frames.

    Where python-can itself filters, behind the driver, it drops error frames too, and nothing is gained: there the
    transport filters.
    """
    if settings.interface not in DRIVER_FILTERS:
        return None
    if settings.node is None:
        return [{"can_id": 0, "can_mask": 0, "extended": False}]
    return [{"can_id": settings.node, "can_mask": NODE_MASK, "extended": False}]


def _bus_options(settings: CanSettings) -> dict[str, Any]:
    options: dict[str, Any] = {"can_filters": bus_filters(settings)}
    if settings.interface == "socketcand":
        return options | {"host": settings.host, "port": settings.port}
    if settings.interface == "slcan":
        options |= {"tty_baudrate": settings.baud, "sleep_after_open": 0.0, "listen_only": settings.listen_only}
        return options | {
            "bitrate": settings.bitrate,
            "data_bitrate": settings.data_bitrate if settings.fd else None,
        }
    if settings.interface == "virtual":
        options["protocol"] = can.CanProtocol.CAN_FD if settings.fd else can.CanProtocol.CAN_20
        return options
    if settings.fd and settings.interface == "pcan":
        # Its driver wants the timing of every part of a bit; other adapters know what a bit rate means.
        options["timing"] = can.BitTimingFd.from_sample_point(
            80_000_000, settings.bitrate, 80.0, settings.data_bitrate, 80.0
        )
    if settings.listen_only and settings.interface == "pcan":
        options["state"] = can.BusState.PASSIVE
    if settings.listen_only and settings.interface == "kvaser":
        options["driver_mode"] = False  # canDRIVER_SILENT
    if settings.interface not in UNTIMED:
        options["bitrate"] = settings.bitrate
        if settings.fd:
            options["data_bitrate"] = settings.data_bitrate
    if settings.fd:
        options["fd"] = True
    return options


def _hear_own_group_only(bus: Any) -> None:  # noqa: ANN401 (its socket is no part of BusABC)
    """End what Linux does by default: a socket receives the groups that anybody on this machine has joined."""
    sock = queue_of(bus)
    if sock is not None and sys.platform == "linux":
        level, option = (41, 29) if sock.family == socket.AF_INET6 else (0, 49)  # IPV6_/IP_MULTICAST_ALL
        with contextlib.suppress(OSError):
            sock.setsockopt(level, option, 0)


def _await_adapter(bus: Any, settings: CanSettings) -> None:  # noqa: ANN401 (slcanBus; its port is no part of BusABC)
    """Wait until the adapter sends anything: opening works also where nobody answers."""
    port = bus.serialPortOrig
    deadline = time.monotonic() + SLCAN_ANSWER_S
    queried = 0.0
    try:
        while not port.in_waiting:
            now = time.monotonic()
            if now > deadline:
                raise NoAnswerError(
                    f"{settings.channel} opens, but no SLCAN adapter answers there",
                    "check that it is the adapter's port and that its firmware speaks SLCAN (candlelight firmware is "
                    "can:gs_usb or can:socketcan)",
                )
            if now - queried > 0.5:
                queried = now
                port.write(b"V\r")
            time.sleep(0.005)
    except (serial.SerialException, OSError) as error:
        raise PortNotFoundError(f"{settings.channel} is gone ({plain(str(error), 100)})") from error


def _open_error(error: Exception, settings: CanSettings, name: str) -> LinkError | UsageError:
    cause = error.__cause__ if isinstance(error.__cause__, Exception) else error
    number = getattr(cause, "errno", None) or getattr(error, "error_code", None)
    text = plain(str(error), 160)
    if settings.interface == "slcan":
        if "bitrate" in text.lower():
            return UsageError(
                f"SLCAN adapters cannot do this ({text})", "give ?bitrate=500000 (FD: data_bitrate=2000000)"
            )
        return translate_open_error(cause, settings.channel)
    missing = (ImportError, NameError, AttributeError, can.CanInterfaceNotImplementedError)
    if isinstance(cause, missing) or isinstance(error, missing) or "library not found" in text:
        return LinkError(
            f"the driver for {settings.interface} is not installed ({text})",
            DRIVER_REMEDIES.get(settings.interface, "see this interface in python-can's documentation"),
        )
    if settings.interface == "socketcand":
        return PortNotFoundError(
            f"no socketcand answers at {settings.host}:{settings.port} for bus {settings.channel} ({text})",
            "start socketcand there, or correct host, port and bus",
        )
    if number in {errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT} and settings.interface == "socketcan":
        return LinkError("this kernel has no CAN", "`sudo modprobe can-raw`; within a container, on its host")
    if number in {errno.ENODEV, errno.ENXIO, errno.ENOENT} or "No such device" in text:
        return PortNotFoundError(
            f"there is no CAN interface {settings.channel}",
            f"`sudo ip link set {settings.channel} up type can bitrate {settings.bitrate}`, or see `rotdrift ports`",
        )
    if number in {errno.EPERM, errno.EACCES}:
        return PortPermissionError(f"you may not open {name}", "see the udev notes in docs/can.md")
    if number == errno.EBUSY:
        return PortBusyError(f"{name} is in use by another program", "end that first")
    if settings.interface == "udp_multicast":
        return LinkError(f"{name} does not open ({text})", "give a multicast group: can:udp_multicast:239.74.163.2")
    return LinkError(f"{name} does not open ({text})", "check the adapter and its driver; see docs/can.md")
