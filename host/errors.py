"""What the host raises on purpose: one sentence each, and what to do.

HostError
    UsageError      2   wrong use: an impossible link, an unknown scenario, a foreign package in our place
    LinkError       3   device or link
        PortNotFoundError       the port does not exist
        PortBusyError           another program holds it
        PortPermissionError     the user may not open it
        LinkLostError           it was open and is gone: unplugged, reset by peer, driver failure
        NoAnswerError           open, but neither an answer nor data
        WrongObjectError        what answers is not what can be captured: protocol version, refused command
    FileError       4   a file: missing, not a recording, empty, exists already, cannot be written

The number is the exit code of the command. Driver errors are translated once, in ``host/links``, ``from error``.
"""

from __future__ import annotations

import errno
from typing import ClassVar


class HostError(Exception):
    """Something a person can mend.

    Parameters
    ----------
    message : str
        What is wrong, one sentence without a full stop.
    mend : str
        What to do about it; may be empty where nothing can be done.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, mend: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.mend = mend

    def __str__(self) -> str:
        return f"{self.message}: {self.mend}" if self.mend else self.message


class UsageError(HostError):
    """The command was asked for something it cannot do."""

    exit_code = 2


class LinkError(HostError):
    """The device or the link to it."""

    exit_code = 3


class PortNotFoundError(LinkError):
    """The port does not exist: a wrong name, or the object is not plugged in."""


class PortBusyError(LinkError):
    """Another program holds the port."""


class PortPermissionError(LinkError):
    """The user may not open the port."""


class LinkLostError(LinkError):
    """The link was open and is gone: unplugged, closed by the other side, or the driver failed."""


class NoAnswerError(LinkError):
    """The link is open, but no answer and no data came."""


class WrongObjectError(LinkError):
    """What answers cannot be captured: another protocol version, or it refuses to stream."""


class FileError(HostError):
    """A file that is missing, is not what it should be, exists already or cannot be written."""

    exit_code = 4


def unreadable(path: object, error: OSError) -> FileError:
    """Say why the system does not let a file be read, and what to do about it."""
    if isinstance(error, FileNotFoundError):
        return FileError(f"there is no file {path}", "check the path")
    if isinstance(error, IsADirectoryError):
        return FileError(f"{path} is a folder", "give a file in it")
    if error.errno == errno.ENAMETOOLONG:
        return FileError(f"{path} is too long a name", "check the path")
    mend = "take the right to read it" if isinstance(error, PermissionError) else "look at the disk it is on"
    return FileError(f"{path} cannot be read ({_reason(error)})", mend)


def unwritable(path: object, error: OSError) -> FileError:
    """Say why the system does not let a file be written, and what to do about it."""
    mend = "make room there, or give another place" if error.errno in _FULL else "give another place"
    return FileError(f"{path} cannot be written ({_reason(error)})", mend)


_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
