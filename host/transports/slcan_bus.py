"""python-can's SLCAN bus, reading whatever has come instead of byte by byte.

The library reads one byte a call: 22 system calls a frame, and on ``socket://`` too slow for 1000 frames a second. And
a byte that is no ASCII stays in its buffer and fails every later read. Here a line that cannot be read fails once and
is gone.
"""

from __future__ import annotations

import select
import sys
import time
from collections import deque
from typing import Any

from can.interfaces.slcan import slcanBus

READ_BYTES = 65536
MAX_LINE_BYTES = 256
"""Longest line of any adapter: an FD frame with 29-bit id and time stamp has 150."""


class ChunkedSlcanBus(slcanBus):
    """An SLCAN adapter on a port that can be waited for; elsewhere (Windows) the library's own reading is used."""

    reads_lines = sys.platform != "win32"
    """Whether the port is read here."""
    _is_open = False

    def __init__(self, *arguments: Any, **options: Any) -> None:  # noqa: ANN401 (those of slcanBus)
        self._lines: deque[bytes] = deque()
        super().__init__(*arguments, **options)
        self._is_open = True
        if self.reads_lines:
            self.serialPortOrig.timeout = 0

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
        return self._lines.popleft().decode("ascii")

    def _split(self, data: bytes) -> None:
        # Answers end with CR, refusals are a BEL: both end a line.
        *lines, rest = (bytes(self._buffer) + data.replace(b"\a", b"\a\r")).split(b"\r")
        self._lines.extend(line + b"\r" for line in lines)
        if len(rest) > MAX_LINE_BYTES:  # no line of an adapter: said once as a line that cannot be read
            self._lines.append(b"\xff")
            rest = b""
        self._buffer[:] = rest

    def pass_over_unreadable(self) -> bool:
        """After a line that cannot be read: see to it that reading goes on with the next.

        Returns
        -------
        bool
            Whether all that had come was thrown away for it, as the library's own reading needs.
        """
        if not self.reads_lines:
            self.flush()
        return not self.reads_lines

    def flush(self) -> None:
        """Throw away what has come and was not read."""
        self._lines.clear()
        super().flush()
