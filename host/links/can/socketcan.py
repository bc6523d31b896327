"""What the Linux kernel knows of a CAN link: whether the interface is up, and what the queue of its socket had to drop.

By default the queue holds some 270 frames: a computer that is busy for a quarter of a second loses samples of an object
at 1000 Hz. Without privileges it can be made as long as ``net.core.rmem_max`` allows: twice the default, mostly.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from pathlib import Path
from typing import Any

QUEUE_BYTES = 8_000_000
"""Asked for: some 10,000 frames, ten seconds of an object at 1000 Hz."""
_SO_RCVBUFFORCE = 33  # include/uapi/asm-generic/socket.h; needs CAP_NET_ADMIN
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")  # include/uapi/linux/sock_diag.h, SK_MEMINFO_*; the last is the count of drops


def is_down(interface: str, sys_net: Path = Path("/sys/class/net")) -> bool:
    """Return whether an interface is known to be down."""
    try:
        return not int((sys_net / interface / "flags").read_text().strip(), 16) & 1
    except (OSError, ValueError):
        return False


def interface_index(interface: str) -> int:
    """Return the kernel's number of an interface: another one when the adapter was pulled and is back; 0 where none."""
    try:
        return socket.if_nametoindex(interface)
    except (OSError, AttributeError):
        return 0


def queue_of(bus: Any) -> socket.socket | None:  # noqa: ANN401 (its socket is no part of BusABC)
    """Return the socket whose queue holds what was received: that of SocketCAN and of udp_multicast; None elsewhere."""
    sock = getattr(bus, "socket", None) or getattr(getattr(bus, "_multicast", None), "_socket", None)
    return sock if isinstance(sock, socket.socket) else None


def lengthen_queue(bus: Any) -> None:  # noqa: ANN401
    """Make the queue as long as the system allows; on other systems and buses nothing happens."""
    sock = queue_of(bus)
    if sock is None:
        return
    for option in (socket.SO_RCVBUF, _SO_RCVBUFFORCE):
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, option, QUEUE_BYTES)


def dropped_frames(bus: Any) -> int:  # noqa: ANN401
    """Return how many frames the queue had no room for since the bus was opened; 0 where it is not known."""
    sock = queue_of(bus)
    if sock is None:
        return 0
    with contextlib.suppress(OSError, struct.error):
        drops: int = _MEMINFO.unpack(sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size))[-1]
        return drops
    return 0
