"""Failures of serial drivers, translated once into sentences with a remedy.

pyserial raises several families on the same event: ``SerialException`` (an ``OSError``) with or without ``errno``, bare
``OSError`` from ``ioctl`` (``in_waiting`` on a pulled cable), ``termios.error`` (an ``Exception``), ``TypeError`` (the
descriptor became ``None``), ``ValueError`` (an impossible baud rate). On Windows the number stands only in the text.
"""

from __future__ import annotations

import errno
import os
import re
import stat
import sys
from pathlib import Path
from urllib.parse import urlsplit

from host.errors import LinkError, LinkLostError, PortBusyError, PortNotFoundError, PortPermissionError, UsageError
from host.links.serial.listing import existing_ports, port_owners
from host.text import plain

BUSY = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}
GONE = {errno.ENOENT, errno.ENODEV, errno.ENXIO}
DENIED = {errno.EACCES, errno.EPERM}


def translate_open_error(
    error: Exception, target: str, existing: list[str] | None = None, platform: str = sys.platform
) -> LinkError | UsageError:
    """Return the error of a port that did not open: ``target`` is a device path, COM port or URL.

    The ports suggested are those of this machine, if no ``existing`` ones are given. The platform is a parameter, so
    that every platform's sentences are tested on one.
    """
    text = str(error)
    number = _errno(error, text)
    if "://" in target:
        if isinstance(error, ValueError) or not _is_complete(target):
            return UsageError(f"{target} is not a URL that can be opened", "write it like socket://127.0.0.1:5000")
        return PortNotFoundError(
            f"nothing answers at {target} ({_reason(text)})", "start the other side first, or correct host and port"
        )
    if isinstance(error, ValueError) or "baud" in text.lower():
        return UsageError(f"{target} does not open ({_reason(text)})", "give a baud rate the adapter has: ?baud=115200")
    if platform == "win32" and "PermissionError" in text:
        # Windows opens ports exclusively: "access denied" means "in use".
        return PortBusyError(
            f"{target} is in use by another program", "close it there (a serial monitor, an IDE, another capture)"
        )
    if number in BUSY:
        holder = "; ".join(port_owners(target)) or "another program"
        return PortBusyError(f"{target} is in use by {holder}", "end that first, or capture from another port")
    if number in DENIED:
        return _permission(target, platform)
    if number in GONE or "FileNotFoundError" in text:
        existing = existing_ports() if existing is None else existing
        here = f"ports here: {', '.join(existing)}" if existing else "no serial port exists here"
        return PortNotFoundError(f"there is no port {target}", f"{here}; plug the object in or correct the name")
    if number in {errno.ENOTTY, errno.EINVAL, errno.EISDIR} or "Inappropriate ioctl" in text:
        return LinkError(f"{target} is not a serial port", "give the device file of a port, see `rotdrift ports`")
    return LinkError(
        f"{target} does not open ({_reason(text)})",
        "plug the object out and in again; on Windows and macOS check its driver",
    )


def translate_io_error(error: Exception, name: str) -> LinkLostError:
    """Return the error of an open link that is gone, whatever family of exception the driver raised."""
    if type(error).__name__ == "SerialTimeoutException":
        return LinkLostError(f"{name} takes no bytes any more", "check the cable and whether the object still runs")
    reason = _reason(str(error)) or type(error).__name__
    if isinstance(error, TypeError | ValueError) or "returned no data" in reason:
        # The driver's own text explains nothing.
        reason = "unplugged, or another program reads it"
    return LinkLostError(f"{name} is gone ({reason})", "plug the object in again or restart it")


def _permission(target: str, platform: str) -> PortPermissionError:
    sentence = f"you may not open {target}"
    if platform == "linux":
        group = _owning_group(target)
        if group == "root":
            return PortPermissionError(
                f"{sentence}: it belongs to root alone", "give it a group by a udev rule, see docs/first-trial.md"
            )
        return PortPermissionError(
            f"{sentence}: it belongs to the group {group}",
            f"run `sudo usermod -aG {group} $USER`, then log out and in",
        )
    if platform == "darwin":
        return PortPermissionError(sentence, "use its /dev/cu.* name and check the adapter's driver in System Settings")
    return PortPermissionError(sentence, "check the driver of the adapter and the permissions of your account")


def _is_complete(url: str) -> bool:
    """Return whether a URL of a port on the network has host and port, which pyserial does not check."""
    try:
        parts = urlsplit(url)
        return parts.scheme not in {"socket", "rfc2217"} or bool(parts.hostname and parts.port)
    except ValueError:  # not a number, or above 65535
        return False


def _owning_group(target: str) -> str:
    try:
        import grp  # POSIX only

        status = Path(target).stat()
        if status.st_gid == 0 and not status.st_mode & stat.S_IRGRP:
            return "root"
        return grp.getgrgid(status.st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return "dialout" if not Path("/etc/arch-release").exists() else "uucp"


def _errno(error: Exception, text: str) -> int | None:
    number = getattr(error, "errno", None)
    if isinstance(number, int):
        return number
    if error.args and isinstance(error.args[0], int):  # termios.error
        return error.args[0]
    found = re.search(r"\[Errno (\d+)\]|\((\d+), '", text)
    return int(found[1] or found[2]) if found else None


def _reason(text: str) -> str:
    """Return the driver's own text without the parts that repeat the port."""
    found = re.search(r"\[Errno (\d+)\]", text)
    if found and int(found[1]) > 0:
        return os.strerror(int(found[1])).lower()
    repeated = r"^(\[Errno -?\d+\] |read failed: |write failed: |[Cc]ould not open port \S+: )+"
    return plain(re.sub(repeated, "", text), 120)
