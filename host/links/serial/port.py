"""Serial links through pyserial: device files, COM ports, and everything ``serial_for_url`` opens.

What pyserial really does, and what follows from it:

- ``in_waiting`` of a socket is 0 or 1, so it shows *whether*, not *how much*. Where the port has a descriptor the
  wait is a ``select`` on it and the read returns whatever is there; elsewhere (Windows, ``loop://``) it is
  ``read(in_waiting or 1)``.
- An unplugged port raises ``SerialException``, ``OSError``, ``TypeError`` or ``termios.error``, depending on which call
  meets it first. All of them become :class:`LinkLostError` here.
- Closing a port while another thread reads it can block or read a foreign descriptor: the thread that reads closes.
- ``timeout`` is set once: pyserial reconfigures the port whenever it changes.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

import serial

from host.links.serial.errors import translate_io_error, translate_open_error
from host.links.transport import MAX_CHUNK_BYTES, Chunk, Transport
from host.links.uri import LinkUri

DEFAULT_BAUD = 115200
"""USB objects ignore it; a UART behind an adapter needs ``?baud=``."""
WRITE_TIMEOUT_S = 1.0
TTY_READ_BYTES = 4096
"""A tty's line discipline holds no more. Asking for 64 KiB costs 10 µs a read, for its memory."""
POLL_S = 0.05
"""Longest wait inside one read where the port cannot be waited for with ``select``."""

_serial_for_url: Callable[..., Any] = serial.serial_for_url  # not annotated by pyserial

DRIVER_ERRORS: tuple[type[Exception], ...] = (serial.SerialException, OSError, TypeError, ValueError)
if sys.platform != "win32":
    import termios

    DRIVER_ERRORS = (*DRIVER_ERRORS, termios.error)


def open_transport(uri: LinkUri) -> SerialTransport:
    """Open a ``serial:`` link, exclusively.

    Raises
    ------
    UsageError
        Impossible baud rate or URL.
    LinkError
        No such port, port busy, permission denied, not a serial port.
    """
    uri.allow_options({"baud"})
    baud = uri.integer("baud", DEFAULT_BAUD, 50, 12_000_000)
    is_url = "://" in uri.target
    has_lock = not is_url and sys.platform != "win32"  # Windows opens every port exclusively by itself
    has_descriptor = sys.platform != "win32" and (not is_url or uri.target.startswith("socket://"))
    try:
        port = _serial_for_url(
            uri.target,
            baudrate=baud,
            timeout=0 if has_descriptor else POLL_S,
            write_timeout=WRITE_TIMEOUT_S,
            **({"exclusive": True} if has_lock else {}),
        )
    except DRIVER_ERRORS as error:
        raise translate_open_error(error, uri.target) from error
    return SerialTransport(port, str(uri), has_descriptor)


def close_port(port: Any) -> None:  # noqa: ANN401 (pyserial has no class of all its ports)
    """Close a port of pyserial for good: its own closing leaves the socket open where the peer has gone."""
    connection = getattr(port, "_socket", None)
    if type(port).__module__ == "serial.urlhandler.protocol_socket":
        port.is_open = False  # its own closing sleeps for 0.3 s, in which Ctrl-C would wait
    with contextlib.suppress(*DRIVER_ERRORS):
        port.close()
    with contextlib.suppress(OSError):
        if connection is not None:
            connection.shutdown(socket.SHUT_RDWR)
    with contextlib.suppress(OSError):
        if connection is not None:
            connection.close()


class SerialTransport(Transport):
    """An open serial port.

    Parameters
    ----------
    port : SerialBase
        An open ``serial.Serial`` (or what ``serial_for_url`` made).
    name : str
        The link's URI.
    has_descriptor : bool
        Whether ``select`` can wait for it; its ``timeout`` must then be 0.
    """

    def __init__(self, port: serial.SerialBase, name: str, has_descriptor: bool) -> None:
        self._port: Any = port
        self.name = name
        self._has_descriptor = has_descriptor
        self._is_tty = has_descriptor and os.isatty(port.fileno())

    def read(self, timeout_s: float) -> Chunk | None:
        """Wait for the next bytes, at most ``timeout_s``, and read what is there, at most ``MAX_CHUNK_BYTES``."""
        try:
            return self._read_ready(timeout_s) if self._has_descriptor else self._read_polled(timeout_s)
        except DRIVER_ERRORS as error:
            raise translate_io_error(error, self.name) from error

    def _read_ready(self, timeout_s: float) -> Chunk | None:
        descriptor = self._port.fileno()
        ready, _, _ = select.select([descriptor], [], [], timeout_s)
        if not ready:
            return None
        # The driver's own read would wait for the descriptor once more: a third of a live sample's cost.
        data = os.read(descriptor, TTY_READ_BYTES) if self._is_tty else b""
        if not data:
            data = self._port.read(MAX_CHUNK_BYTES)  # a socket; or a port that is gone: the driver raises
        # Stamped after the read: before it, bytes that came in between would seem to arrive before they were sent.
        return Chunk(data, time.monotonic_ns()) if data else None

    def _read_polled(self, timeout_s: float) -> Chunk | None:
        deadline = time.monotonic() + timeout_s
        while True:
            data = self._port.read(min(self._port.in_waiting, MAX_CHUNK_BYTES) or 1)
            if data:
                return Chunk(data, time.monotonic_ns())
            if time.monotonic() >= deadline:
                return None

    def write(self, data: bytes) -> None:
        """Send bytes; a port that accepts none for a second counts as lost."""
        try:
            self._port.write(data)
        except DRIVER_ERRORS as error:
            raise translate_io_error(error, self.name) from error

    def close(self) -> None:
        """Close the port; a pulled one may fail in this too, which is known already."""
        close_port(self._port)
