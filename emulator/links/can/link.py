"""CAN links of the virtual object: real peers for python-can, most of them without a CAN driver in the kernel.

====================================  ==========================================================================
``can:slcan:pty`` or ``…:pty:PATH``   an SLCAN adapter on a pseudo-terminal (CAN FD in the CANable dialect)
``can:slcan:tcp:PORT``                the same on ``socket://127.0.0.1:PORT``; port 0 is any free one
``can:socketcand:PORT``               a socketcand server on loopback; its only bus is ``vcan0``
``can:INTERFACE:CHANNEL``             a bus of python-can: ``virtual`` (same process), ``udp_multicast``, ``socketcan``
====================================  ==========================================================================

Options after ``?``: ``node`` (1-31, default 1), ``fd=1``, ``bitrate`` and ``data_bitrate`` (of real interfaces).
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from urllib.parse import parse_qsl

from emulator import LinkError
from emulator.links import Link
from firmware_protocol.can.mapping import MAX_NODE, MIN_NODE

MAX_PACKETS_AT_ONCE = 64
DEFAULT_BITRATE = 500_000
DEFAULT_DATA_BITRATE = 2_000_000

_MODULES = {"slcan": "emulator.links.can.slcan", "socketcand": "emulator.links.can.socketcand"}
_OPTIONS = ("node", "fd", "bitrate", "data_bitrate")


@dataclass(frozen=True, slots=True)
class CanAddress:
    """What follows ``can:``, parsed."""

    interface: str
    """``slcan``, ``socketcand``, or an interface of python-can."""
    channel: str
    """The rest before ``?``."""
    node: int = 1
    """Node id, 1-31."""
    fd: bool = False
    """Whether to send CAN FD frames."""
    bitrate: int = DEFAULT_BITRATE
    """Bit/s."""
    data_bitrate: int = DEFAULT_DATA_BITRATE
    """Bit/s in the data phase of CAN FD frames."""

    def host_uri(self, channel: str) -> str:
        """Return the link as the host names it."""
        uri = f"can:{self.interface}:{channel}?bitrate={self.bitrate}&node={self.node}"
        return uri + (f"&fd=1&data_bitrate={self.data_bitrate}" if self.fd else "")


def parse_address(rest: str) -> CanAddress:
    """Parse what follows ``can:``.

    Raises
    ------
    LinkError
        No interface or channel, an unknown option, a number out of range.
    """
    body, _, query = rest.partition("?")
    interface, _, channel = body.partition(":")
    if not interface or not channel:
        raise LinkError(f"can:{rest} names no interface and channel: write can:slcan:pty or can:socketcan:vcan0")
    options = dict(parse_qsl(query, keep_blank_values=True))
    for name, value in options.items():
        if name not in _OPTIONS:
            raise LinkError(f"can: links have no option {name!r}: there are {', '.join(_OPTIONS)}")
        if not value.isascii() or not value.isdigit():
            raise LinkError(f"can: {name} must be a whole number, not {value!r}")
    numbers = {name: int(value) for name, value in options.items()}
    node = numbers.get("node", 1)
    if not MIN_NODE <= node <= MAX_NODE:
        raise LinkError(f"can: node must be from {MIN_NODE} to {MAX_NODE}, not {node}")
    return CanAddress(
        interface,
        channel,
        node,
        bool(numbers.get("fd", 0)),
        numbers.get("bitrate", DEFAULT_BITRATE),
        numbers.get("data_bitrate", DEFAULT_DATA_BITRATE),
    )


def from_address(rest: str) -> Link:
    """Return the link of ``can:REST``; see the module.

    Raises
    ------
    LinkError
        The address is wrong.
    """
    address = parse_address(rest)
    module = importlib.import_module(_MODULES.get(address.interface, "emulator.links.can.python_bus"))
    link = module.from_can_address(address)
    assert isinstance(link, Link)
    return link
