"""python-can's SLCAN bus, reading whatever has come instead of byte by byte.

The library reads one byte a call: 22 system calls a frame, and on ``socket://`` too slow for 1000 frames a second. And
a byte that is not ASCII stays in its buffer and fails every later read; and what is not SLCAN at all it skips in
silence. Here a line that cannot be read fails once and is gone.
"""

from __future__ import annotations

import os
import select
import sys
import time
from collections import deque
from typing import Any

from can.interfaces.slcan import slcanBus

from host.links.serial.port import close_port

READ_BYTES = 65536
KINDS = frozenset(b"tTrRdDbBxzZVvNFCE\r\a")
"""How a line of an adapter starts: frames, answers, and the names and errors that CANables print."""
MAX_LINE_BYTES = 256
"""Longest line of any adapter: an FD frame with 29-bit id and time stamp has 150."""


class ChunkedSlcanBus(slcanBus):
    """An SLCAN adapter on a port that can be waited for; elsewhere (Windows) the library's own reading is used."""

    reads_lines = sys.platform != "win32"
    """Whether the port is read here."""
    _is_open = False

    def __init__(self, channel: str, *, data_bitrate: int | None = None, **options: Any) -> None:  # noqa: ANN401
        self._data_bitrate = data_bitrate
        self._lines: deque[bytes] = deque()
        self._lock = _locked(channel)  # before the library's own opening, which discards what has come
        try:
            super().__init__(channel, **options)
        except BaseException:
            port = self.__dict__.get("serialPortOrig")
            if port is not None:  # open already, but what was sent first has failed
                close_port(port)
            self._unlock()
            raise
        self._is_open = True
        if self.reads_lines:
            self.serialPortOrig.timeout = 0

    def set_bitrate(self, bitrate: int, data_bitrate: int | None = None) -> None:
        """Set the bit rates; called by the library's constructor, which has no parameter for that of CAN FD alone."""
        super().set_bitrate(bitrate, data_bitrate or self._data_bitrate)

    def shutdown(self) -> None:
        """Close the channel and the port."""
        try:
            super().shutdown()
        finally:
            close_port(self.serialPortOrig)
            self._unlock()

    def _unlock(self) -> None:
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)

    def _read(self, timeout: float | None) -> str | None:
        if not (self.reads_lines and self._is_open):
            return super()._read(timeout)
        deadline = None if timeout is None else time.monotonic() + timeout
        while not self._lines:
            left = None if deadline is None else max(deadline - time.monotonic(), 0.0)
            ready, _, _ = select.select([self.serialPortOrig.fileno()], [], [], left)
            if not ready:
                return None
            data = self.serialPortOrig.read(READ_BYTES)
            if data:
                self._split(data)
        line = self._lines.popleft()
        if line[0] < 0x80 and line[0] not in KINDS:
            raise ValueError("this is not SLCAN")
        return line.decode("ascii")

    def _split(self, data: bytes) -> None:
        # Answers end with CR, refusals are a BEL: both end a line.
        *lines, rest = (bytes(self._buffer) + data.replace(b"\a", b"\a\r")).split(b"\r")
        self._lines.extend(line + b"\r" for line in lines)
        if len(rest) > MAX_LINE_BYTES:  # not a line of an adapter: reported once, as a line that cannot be read
            self._lines.append(b"\xff")
            rest = b""
        self._buffer[:] = rest

    def skip_unreadable(self) -> None:
        """Let reading go on behind a line that cannot be read; the library's own reading must discard all for it."""
        if not self.reads_lines:
            self.flush()

    def flush(self) -> None:
        """Discard what has come and was not read."""
        self._lines.clear()
        super().flush()


def _locked(channel: str) -> int | None:
    """Lock a port as pyserial's ``exclusive`` does, and return the descriptor that holds the lock.

    Raises
    ------
    OSError
        There is no such port, or another program has locked it.
    """
    if sys.platform == "win32" or "://" in channel:  # Windows opens every port exclusively by itself
        return None
    import fcntl

    descriptor = os.open(channel, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
