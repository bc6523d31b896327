"""The virtual object behind a socketcand server on loopback: CAN over TCP in plain words, classic frames only.

Source: github.com/linux-can/socketcand, doc/protocol.md (raw mode).
"""

from __future__ import annotations

import re

from emulator import LinkError
from emulator.links.can.byte_link import CanByteLink
from emulator.links.can.link import CanAddress
from emulator.links.tcp_link import TcpLink
from firmware_protocol.can.frames import CLASSIC_BYTES, CanFrame, FrameFlag

BUS = "vcan0"
"""The only bus the server has."""
QUIET_MS = 50
"""No frame is sent for so long after ``rawmode``: clients read its answer alone."""
MAX_PENDING_BYTES = 1024

_SEND = re.compile(r"send ([0-9a-fA-F]{1,8}) (\d{1,2})((?: [0-9a-fA-F]{1,2}){0,8})$")
_OK = b"< ok >"


def from_can_address(address: CanAddress) -> SocketcandLink:
    """Return the link of ``can:socketcand:PORT``.

    Raises
    ------
    LinkError
        No port, or CAN FD, which the protocol does not have.
    """
    if address.fd:
        raise LinkError("socketcand carries classic CAN frames only: leave fd out, or use can:slcan:tcp:PORT")
    if not address.channel.isascii() or not address.channel.isdigit() or int(address.channel) > 65_535:
        raise LinkError(f"can:socketcand: needs a port from 0 to 65535, not {address.channel!r}")
    return SocketcandLink(address, int(address.channel))


class SocketcandSession:
    """The server's side of one connection, without I/O: no bus, then raw mode (broadcast mode is not imitated)."""

    greeting = b"< hi >"

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Start a new connection."""
        self._pending = ""
        self._has_bus = False
        self._raw_asked = False
        self._raw_since_ms: int | None = None

    def hears(self, time_ms: int) -> bool:
        """Return whether frames are passed on: in raw mode, and a while after its answer."""
        if not self._raw_asked:
            return False
        if self._raw_since_ms is None:
            self._raw_since_ms = time_ms
        return time_ms - self._raw_since_ms >= QUIET_MS

    def from_bus(self, frame: CanFrame, time_ms: int) -> bytes:
        """Return the line of a classic data frame; other kinds are not passed on."""
        unfit = frame.flags & (FrameFlag.REMOTE | FrameFlag.FD | FrameFlag.ERROR)
        if unfit or not self.hears(time_ms):
            return b""
        extended = frame.flags & FrameFlag.EXTENDED
        identifier = f"{frame.arbitration_id:08X}" if extended else f"{frame.arbitration_id:03X}"
        return f"< frame {identifier} {time_ms / 1000:.6f} {frame.data.hex().upper()} >".encode()

    def from_host(self, data: bytes) -> tuple[bytes, list[CanFrame]]:
        """Process words from the client; return the answers and the frames for the bus."""
        self._pending = (self._pending + data.decode("latin-1"))[-MAX_PENDING_BYTES:]
        answers = b""
        frames: list[CanFrame] = []
        while (end := self._pending.find(">")) >= 0:
            text, self._pending = self._pending[:end], self._pending[end + 1 :]
            words = text.rpartition("<")[2].strip()
            answers += self._command(words, frames)
        return answers, frames

    def _command(self, words: str, frames: list[CanFrame]) -> bytes:
        if words == f"open {BUS}":
            self._has_bus = True
            return _OK
        if words == "rawmode" and self._has_bus:
            self._raw_asked = True
            return _OK
        if words == "echo":
            return b"< echo >"
        found = _SEND.match(words) if self._raw_asked else None
        if found is not None:
            data = bytes(int(part, 16) for part in found[3].split())
            if len(data) == int(found[2]) <= CLASSIC_BYTES:
                flags = FrameFlag.EXTENDED if len(found[1]) > 3 else FrameFlag(0)
                frames.append(CanFrame(int(found[1], 16), data, flags))
                return b""
        return b"< error could not open bus >" if words.startswith("open") else b"< error unknown command >"


class SocketcandLink(CanByteLink, TcpLink):
    """A socketcand server with the object on its bus; one client at a time, and the newest it is."""

    # A real server has many; so a client that comes back must not wait until its old connection is found dead.
    newest_wins = True

    def __init__(self, address: CanAddress, port: int) -> None:
        TcpLink.__init__(self, port)
        self.prepare(address, SocketcandSession())

    @property
    def host_uri(self) -> str:
        """``can:socketcand:127.0.0.1:PORT/vcan0?…``."""
        return self.address.host_uri(f"127.0.0.1:{self.port}/{BUS}")
