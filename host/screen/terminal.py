"""The terminal itself: taken, written to without ever waiting for long, read key by key, and always given back.

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
from typing import Any

from host.screen.keys import PASTE_OFF, PASTE_ON

CLEAR = "\x1b[2J"
ENTER = f"\x1b[?1049h\x1b[?25l\x1b[?7l{PASTE_ON}{CLEAR}"
"""Other screen, no cursor, no wrapping; pastes are told from keys."""
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
            kernel = ctypes.windll.kernel32
            self._handle = msvcrt.get_osfhandle(self._out.fileno())
            mode = ctypes.c_uint32()
            kernel.GetConsoleMode(self._handle, ctypes.byref(mode))
            self._mode = mode.value
            kernel.SetConsoleMode(self._handle, mode.value | 0x0004)  # escape sequences

        def take(self) -> None:
            """Begin."""

        def size(self) -> tuple[int, int]:
            """Width and height, cells."""
            size = os.get_terminal_size(self._out.fileno())
            return size.columns, size.lines

        def write(self, data: bytes) -> int:
            """Write all of it."""
            self._out.write(data.decode("utf-8", "replace"))
            self._out.flush()
            return len(data)

        def read(self, timeout_s: float) -> str:
            """Wait for keys; empty when none came."""
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

        def in_foreground(self) -> bool:
            """Windows has no background jobs at a console."""
            return True

        def give_back(self) -> None:
            """Restore the console."""
            ctypes.windll.kernel32.SetConsoleMode(self._handle, self._mode)
            self._out.close()

else:
    import select
    import termios

    class Terminal:
        """A POSIX terminal.

        Parameters
        ----------
        descriptor : int
            Any open descriptor of it.
        """

        def __init__(self, descriptor: int) -> None:
            try:
                self._fd = os.open(os.ttyname(descriptor), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            except OSError:
                self._fd = os.dup(descriptor)  # a terminal of another user; writing may wait then
            self._before: list[Any] | None = None
            self._ours: list[Any] | None = None
            self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

        def take(self) -> None:
            """Keys one by one, without echo; to be called again after the process was stopped and continued.

            Raises
            ------
            TerminalLostError
                It is gone.
            """
            try:
                self._take()
            except termios.error as error:
                raise TerminalLostError(str(error)) from error

        def _take(self) -> None:
            mode = termios.tcgetattr(self._fd)
            if self._before is None:
                self._before = termios.tcgetattr(self._fd)
            mode[0] &= ~(termios.IXON | termios.ICRNL)
            mode[3] &= ~(termios.ICANON | termios.ECHO | termios.IEXTEN)
            off = os.fpathconf(self._fd, "PC_VDISABLE")
            mode[6][termios.VSUSP] = bytes([off & 0xFF])
            mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
            termios.tcsetattr(self._fd, termios.TCSANOW, mode)
            self._ours = termios.tcgetattr(self._fd)

        def in_foreground(self) -> bool:
            """Whether the terminal is ours to use: a shell that stopped the capture, or outlived it, has it back.

            Raises
            ------
            TerminalLostError
                It is gone.
            """
            try:
                return os.tcgetpgrp(self._fd) == os.getpgrp()
            except OSError as error:
                raise TerminalLostError(str(error)) from error

        def size(self) -> tuple[int, int]:
            """Width and height, cells; 80 x 24 where the terminal does not say.

            Raises
            ------
            TerminalLostError
                It is gone.
            """
            try:
                size = os.get_terminal_size(self._fd)
            except OSError as error:
                raise TerminalLostError(str(error)) from error
            return (size.columns or 80), (size.lines or 24)

        def write(self, data: bytes) -> int:
            """Write what the terminal takes now; returns how much.

            Raises
            ------
            TerminalLostError
                It is gone.
            """
            try:
                return os.write(self._fd, data[:MAX_PIECE])
            except BlockingIOError:
                return 0
            except OSError as error:
                raise TerminalLostError(str(error)) from error

        def read(self, timeout_s: float) -> str:
            """Wait for keys; empty when none came.

            Raises
            ------
            TerminalLostError
                It is gone.
            """
            try:
                ready, _, _ = select.select([self._fd], [], [], timeout_s)
                if ready and not self.in_foreground():  # it is typed for somebody else
                    time.sleep(timeout_s)
                    return ""
                data = os.read(self._fd, 1024) if ready else None
            except BlockingIOError:
                return ""
            except OSError as error:
                raise TerminalLostError(str(error)) from error
            if data is None:
                return ""
            if not data:
                raise TerminalLostError("end of file")
            return self._decoder.decode(data)

        def give_back(self) -> None:
            """Restore the modes found at the beginning, unless a shell has set its own already; never waits."""
            if self._before is not None:
                with contextlib.suppress(termios.error, OSError, TerminalLostError):
                    if termios.tcgetattr(self._fd) == self._ours or self.in_foreground():
                        termios.tcsetattr(self._fd, termios.TCSANOW, self._before)
            os.close(self._fd)

    def in_foreground(descriptor: int) -> bool:
        """Whether this program may use the terminal: it is not in the shell's background."""
        try:
            return os.tcgetpgrp(descriptor) == os.getpgrp()
        except OSError:
            return False

    def save_modes(descriptor: int) -> list[Any] | None:
        """Remember the modes of a terminal."""
        try:
            return termios.tcgetattr(descriptor)
        except (termios.error, OSError):
            return None

    def restore(descriptor: int, modes: list[Any] | None) -> None:
        """Give a terminal back that somebody else left as it was; never waits."""
        try:
            fd = os.open(os.ttyname(descriptor), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            return
        with contextlib.suppress(termios.error, OSError):
            if modes is not None:
                termios.tcsetattr(fd, termios.TCSANOW, modes)
            os.write(fd, LEAVE.encode())
        os.close(fd)


if sys.platform == "win32":

    def in_foreground(descriptor: int) -> bool:
        """Windows has no background jobs at a console."""
        del descriptor
        return True

    def save_modes(descriptor: int) -> list[Any] | None:
        """Nothing to remember: the console's mode belongs to the screen."""
        del descriptor
        return None

    def restore(descriptor: int, modes: list[Any] | None) -> None:
        """Show the cursor and the usual screen again."""
        del descriptor, modes
        with contextlib.suppress(OSError), open("CONOUT$", "w", encoding="utf-8") as console:  # noqa: PTH123
            console.write(LEAVE)
