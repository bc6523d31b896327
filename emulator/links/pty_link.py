"""A pseudo-terminal: the virtual object appears as a serial device that pyserial opens like any other.

While nobody has the device open, nothing is written, as a USB serial device does; so a reader never gets stale samples.
A reader that has it open but does not read fills the kernel's buffer, after which nothing more can be written.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import stat
import sys
import time
from pathlib import Path

from emulator import LinkError
from emulator.links.byte_stream import ByteLink

if sys.platform != "win32":
    import termios
    import tty

_IDLE_POLL_S = 0.01
_READ_BYTES = 65_536


def from_address(rest: str) -> PtyLink:
    """Return the link of ``pty:`` (the system's name only) or ``pty:PATH`` (a symbolic link at PATH)."""
    return PtyLink(Path(rest).expanduser() if rest else None)


class PtyLink(ByteLink):
    """The master side of a pseudo-terminal.

    The symbolic link to the device, where one is asked for, replaces an old one but no file, and is removed at the end.
    """

    def __init__(self, symlink: Path | None = None) -> None:
        super().__init__()
        self.symlink = symlink
        self._master = -1
        self._device = ""
        self._had_reader = False

    @property
    def host_uri(self) -> str:
        """``serial:`` and the path of the symbolic link or the device."""
        return f"serial:{self.symlink or self._device}"

    def open(self) -> None:
        """Make the device and its symbolic link."""
        if sys.platform == "win32":
            raise LinkError("this system has no pseudo-terminals: use tcp:PORT")
        self._check_symlink()
        try:
            self._master, slave = os.openpty()
        except OSError as error:
            raise LinkError(f"no pseudo-terminal is available: {error.strerror}") from error
        tty.setraw(slave)
        self._device = os.ttyname(slave)
        os.close(slave)  # so that the master sees whether anybody else has it open
        os.set_blocking(self._master, False)
        self._had_reader = False
        try:
            self._make_symlink()
        except OSError as error:
            self.close()
            raise LinkError(f"cannot make the symbolic link {self.symlink}: {error.strerror}") from error

    def _check_symlink(self) -> None:
        path = self.symlink
        if path is None or not os.path.lexists(path):
            return
        if not path.is_symlink():
            raise LinkError(f"{path} exists and is not a symbolic link: choose another path")
        if path.exists() and not stat.S_ISCHR(path.stat().st_mode):
            raise LinkError(f"{path} is a symbolic link to something that is not a device: choose another path")
        if _in_use(path):
            raise LinkError(f"{path} is the device of another virtual object: choose another path, or end that one")

    def _make_symlink(self) -> None:
        if self.symlink is None:
            return
        fresh = self.symlink.with_name(f".{self.symlink.name}.{os.getpid()}")
        fresh.symlink_to(self._device)
        try:
            fresh.replace(self.symlink)
        except OSError:
            fresh.unlink()
            raise

    def close(self) -> None:
        """Remove the device and its symbolic link, if that is still ours."""
        if self._master < 0:
            return
        if self.symlink is not None:
            with contextlib.suppress(OSError):
                if self.symlink.readlink() == Path(self._device):
                    self.symlink.unlink()
        os.close(self._master)
        self._master = -1
        self._restart()

    def _hung_up(self) -> bool:
        """Return whether nobody has the device open, as POLLHUP of the master shows."""
        if self._master < 0:
            return True
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        return any(events & select.POLLHUP for _, events in poll.poll(0))

    def _connected(self) -> bool:
        connected = not self._hung_up()
        if self._had_reader and not connected:
            self._forget_unread()
        self._had_reader = connected
        return connected

    def _forget_unread(self) -> None:
        """Throw away what the last reader left unread, so that the next one does not get stale samples."""
        self._restart()
        with contextlib.suppress(OSError):
            device = os.open(self._device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflush(device, termios.TCIFLUSH)
            finally:
                os.close(device)

    def _write(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except OSError:  # full (EAGAIN), or the reader has just gone (EIO)
            return 0

    def _read(self) -> bytes:
        if self._master < 0:
            return b""
        try:
            return os.read(self._master, _READ_BYTES)
        except OSError:
            return b""

    def wait(self, timeout_s: float) -> None:
        """Wait for commands; while nobody is there, check for a reader every 10 ms."""
        if self._connected():
            # Not poll: its milliseconds would make every sample late by up to one.
            with contextlib.suppress(OSError, ValueError):  # closed meanwhile, as a pulled cable
                select.select([self._master], [], [], max(timeout_s, 0.0))
        else:  # POLLHUP is always ready: poll would return at once and make a busy loop
            time.sleep(max(min(timeout_s, _IDLE_POLL_S), 0.0))


def _in_use(device: Path) -> bool:
    """Return whether the other side of a pseudo-terminal is open; after a crash its link stays behind, without one."""
    try:
        os.close(os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
    except OSError as error:
        return error.errno == errno.EBUSY  # a capture has it for itself
    return True
