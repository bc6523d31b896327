"""The terminal itself: acquired, written to without ever waiting for long, read key by key, and always released.

POSIX
    The terminal is opened a second time, so that making *our* end non-blocking does not change the shell's. Control-Z
    and Control-S come as keys, not as signals: neither may stop a capture.
Windows
    The console through ``CONOUT$`` and :mod:`msvcrt`.
"""

from __future__ import annotations

import codecs
import contextlib
import os
import sys
import time
from collections.abc import Iterator
from typing import Any

from host.screen.keys import PASTE_OFF, PASTE_ON

CLEAR = "\x1b[2J"
ENTER = f"\x1b[?1049h\x1b[?25l\x1b[?7l{PASTE_ON}{CLEAR}"
"""Other screen, no cursor, no wrapping; pastes are marked, so that they differ from keys."""
LEAVE = f"\x1b[0m{PASTE_OFF}\x1b[?7h\x1b[?25h\x1b[?1049l"
MAX_PIECE = 65536


class TerminalLostError(Exception):
    """The terminal is gone: closed window, lost ssh connection."""


if sys.platform == "win32":
    import ctypes
    import msvcrt

    class Terminal:
        """A Windows console."""

        def __init__(self, descriptor: int) -> None:
            del descriptor
            self._out = open("CONOUT$", "w", encoding="utf-8", newline="")  # noqa: PTH123, SIM115 - a device
            self._handle = msvcrt.get_osfhandle(self._out.fileno())
            mode = ctypes.c_uint32()
            ctypes.windll.kernel32.GetConsoleMode(self._handle, ctypes.byref(mode))
            self._before = mode.value

        def acquire(self) -> None:
            """Have escape sequences understood."""
            ctypes.windll.kernel32.SetConsoleMode(self._handle, self._before | 0x0004)

        def in_foreground(self) -> bool:
            """Return True: Windows has no background jobs at a console."""
            return True

        def size(self) -> tuple[int, int]:
            """Return width and height, cells."""
            size = os.get_terminal_size(self._out.fileno())
            return size.columns, size.lines

        def write(self, data: bytes) -> int:
            """Write all of it; return how much that is."""
            self._out.write(data.decode("utf-8", "replace"))
            self._out.flush()
            return len(data)

        def read(self, timeout_s: float) -> str:
            """Return the keys typed; wait for one at most so long."""
            end = time.monotonic() + timeout_s
            while not msvcrt.kbhit():
                if time.monotonic() >= end:
                    return ""
                time.sleep(0.02)
            keys = ""
            while msvcrt.kbhit():
                key = msvcrt.getwch()
                keys += "" if key in "\x00\xe0" and msvcrt.getwch() else key
            # What is not in the first 65,536 characters comes in two halves.
            return keys.encode("utf-16", "surrogatepass").decode("utf-16", "replace")

        def release(self) -> None:
            """Restore the console."""
            ctypes.windll.kernel32.SetConsoleMode(self._handle, self._before)
            self._out.close()

        def rescue(self) -> None:
            """Show the cursor and the usual screen again."""
            with contextlib.suppress(OSError):
                self.write(LEAVE.encode())

else:
    import select
    import termios

    @contextlib.contextmanager
    def _translated() -> Iterator[None]:
        """Raise :class:`TerminalLostError` for what the system raises where a terminal is gone."""
        try:
            yield
        except (OSError, termios.error) as error:
            raise TerminalLostError(str(error)) from error

    class Terminal:
        """A POSIX terminal, by any open descriptor of it.

        Raises
        ------
        TerminalLostError
            By every method but :meth:`release` and :meth:`rescue`: it is gone.
        """

        def __init__(self, descriptor: int) -> None:
            try:
                self._fd = os.open(os.ttyname(descriptor), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            except OSError:
                self._fd = os.dup(descriptor)  # a terminal of another user; writing may wait then
            self._before: list[Any] | None = None
            with contextlib.suppress(termios.error, OSError):
                self._before = termios.tcgetattr(self._fd)
            self._ours: list[Any] | None = None
            self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

        @_translated()
        def acquire(self) -> None:
            """Have keys come one by one, without echo; to be called again after the process was stopped."""
            mode = termios.tcgetattr(self._fd)
            mode[0] &= ~(termios.IXON | termios.ICRNL)
            mode[3] &= ~(termios.ICANON | termios.ECHO | termios.IEXTEN)
            off = os.fpathconf(self._fd, "PC_VDISABLE")
            mode[6][termios.VSUSP] = bytes([off & 0xFF])
            mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
            termios.tcsetattr(self._fd, termios.TCSANOW, mode)
            self._ours = termios.tcgetattr(self._fd)

        @_translated()
        def in_foreground(self) -> bool:
            """Return whether the terminal is ours: a shell that stopped the capture, or outlived it, has it back."""
            return os.tcgetpgrp(self._fd) == os.getpgrp()

        @_translated()
        def size(self) -> tuple[int, int]:
            """Return width and height, cells; 80 x 24 where the terminal does not know."""
            size = os.get_terminal_size(self._fd)
            return (size.columns or 80), (size.lines or 24)

        @_translated()
        def write(self, data: bytes) -> int:
            """Write what the terminal accepts now; return how much that is."""
            try:
                return os.write(self._fd, data[:MAX_PIECE])
            except BlockingIOError:
                return 0

        @_translated()
        def read(self, timeout_s: float) -> str:
            """Return the keys typed; wait for one at most so long."""
            ready, _, _ = select.select([self._fd], [], [], timeout_s)
            if not ready:
                return ""
            if not self.in_foreground():  # it is typed for somebody else
                time.sleep(timeout_s)
                return ""
            try:
                data = os.read(self._fd, 1024)
            except BlockingIOError:
                return ""
            if not data:
                raise TerminalLostError("end of file")
            return self._decoder.decode(data)

        def release(self) -> None:
            """Restore the modes found at the start, unless a shell has set its own already; never waits."""
            with contextlib.suppress(termios.error, OSError, TerminalLostError):
                before = None if self._ours is None else self._before
                if before is not None and (termios.tcgetattr(self._fd) == self._ours or self.in_foreground()):
                    termios.tcsetattr(self._fd, termios.TCSANOW, before)
            os.close(self._fd)

        def rescue(self) -> None:
            """Restore what another process of ours has left acquired, unless a shell has the terminal; never waits."""
            with contextlib.suppress(termios.error, OSError, TerminalLostError):
                if self._before is not None and self.in_foreground():
                    termios.tcsetattr(self._fd, termios.TCSANOW, self._before)
                    if not os.get_blocking(self._fd):
                        self.write(LEAVE.encode())


def in_foreground(descriptor: int) -> bool:
    """Return whether this program may use a terminal: it is not in the shell's background."""
    terminal = Terminal(descriptor)
    try:
        return terminal.in_foreground()
    except TerminalLostError:
        return False
    finally:
        terminal.release()
