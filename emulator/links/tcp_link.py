"""A TCP server on loopback: the virtual object for ``socket://`` URLs, and for systems without pseudo-terminals.

One client at a time; a second one is turned away at once, a new one may come after the first has gone.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time

from emulator import LinkError
from emulator.links.byte_stream import ByteLink

_LOOPBACK = "127.0.0.1"
_READ_BYTES = 65_536


def from_address(rest: str) -> TcpLink:
    """Return the link of ``tcp:PORT`` or ``tcp:127.0.0.1:PORT``; port 0 is any free one.

    Raises
    ------
    LinkError
        The port is not a number from 0 to 65535, or the host is not loopback.
    """
    host, _, port = rest.rpartition(":")
    if host not in ("", _LOOPBACK, "localhost"):
        raise LinkError(f"tcp: links listen on {_LOOPBACK} only, not on {host!r}: write tcp:{port}")
    if not port.isascii() or not port.isdigit() or int(port) > 65_535:
        raise LinkError(f"tcp: needs a port from 0 to 65535, not {port!r}")
    return TcpLink(int(port))


class TcpLink(ByteLink):
    """A server for one client; with port 0 the system chooses one, see ``host_uri``."""

    newest_wins = False
    """Whether a second client takes the place of the first, in place of being turned away."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self.port = port
        self._server: socket.socket | None = None
        self._client: socket.socket | None = None

    @property
    def host_uri(self) -> str:
        """``serial:socket://127.0.0.1:PORT``."""
        return f"serial:socket://{_LOOPBACK}:{self.port}"

    def open(self) -> None:
        """Listen."""
        server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        try:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind((_LOOPBACK, self.port))
            server.listen()
        except OSError as error:
            server.close()
            raise LinkError(f"cannot listen on port {self.port}: {error.strerror}; choose another, or tcp:0") from error
        server.setblocking(False)
        self.port = server.getsockname()[1]
        self._server = server

    def close(self) -> None:
        """Close the client's connection and stop listening."""
        self._drop_client()
        if self._server is not None:
            self._server.close()
            self._server = None

    def _drop_client(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
            self._restart()

    def _accept(self) -> None:
        if self._server is None:
            return
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            if self._client is not None and not self.newest_wins:
                client.close()
                return
            self._drop_client()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client

    def _connected(self) -> bool:
        self._accept()
        return self._client is not None

    def _write(self, data: bytes) -> int:
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._drop_client()
            return 0

    def _read(self) -> bytes:
        self._accept()
        if self._client is None:
            return b""
        try:
            data = self._client.recv(_READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop_client()
        return data

    def wait(self, timeout_s: float) -> None:
        """Wait for a client or a command."""
        sockets = [each for each in (self._server, self._client) if each is not None]
        if sockets:
            select.select(sockets, [], [], max(timeout_s, 0.0))
        else:
            time.sleep(max(timeout_s, 0.0))
