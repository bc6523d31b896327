"""The virtual object behind an SLCAN adapter, on a pseudo-terminal or on loopback TCP."""

from __future__ import annotations

from pathlib import Path

from emulator import LinkError
from emulator.links.can.byte_link import CanByteLink
from emulator.links.can.link import CanAddress
from emulator.links.can.slcan_adapter import SlcanAdapter
from emulator.links.pty_link import PtyLink
from emulator.links.pty_link import from_address as pty_from_address
from emulator.links.tcp_link import TcpLink
from emulator.links.tcp_link import from_address as tcp_from_address


def from_can_address(address: CanAddress) -> CanByteLink:
    """Return the link of ``can:slcan:pty``, ``can:slcan:pty:PATH`` or ``can:slcan:tcp:PORT``.

    Raises
    ------
    LinkError
        Neither of these.
    """
    kind, _, rest = address.channel.partition(":")
    if kind == "pty":
        return SlcanPtyLink(address, pty_from_address(rest).symlink)
    if kind == "tcp":
        return SlcanTcpLink(address, tcp_from_address(rest).port)
    raise LinkError(
        f"can:slcan:{address.channel} is not a place for an adapter: write can:slcan:pty, can:slcan:pty:PATH or "
        "can:slcan:tcp:PORT"
    )


class SlcanPtyLink(CanByteLink, PtyLink):
    """An adapter that appears as a serial device."""

    def __init__(self, address: CanAddress, symlink: Path | None) -> None:
        PtyLink.__init__(self, symlink)
        self.prepare(address, SlcanAdapter())

    @property
    def host_uri(self) -> str:
        """``can:slcan:/dev/pts/N?…``."""
        return self.address.host_uri(str(self.symlink or self._device))


class SlcanTcpLink(CanByteLink, TcpLink):
    """An adapter behind a TCP port on loopback."""

    def __init__(self, address: CanAddress, port: int) -> None:
        TcpLink.__init__(self, port)
        self.prepare(address, SlcanAdapter())

    @property
    def host_uri(self) -> str:
        """``can:slcan:socket://127.0.0.1:PORT?…``."""
        return self.address.host_uri(f"socket://127.0.0.1:{self.port}")
