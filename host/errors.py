"""Errors that the host raises on purpose: what happened, and the remedy, in one sentence.

HostError           1   a measurement without a result: `rotdrift baseline` of an object that was moved
    UsageError      2   what the command line asks for is impossible: a link without a port, an unknown marker
    LinkError       3   the object or the link: the port is not a serial port, nothing that came can be decoded
        PortNotFoundError       no such port: a typing error, or the object is not plugged in
        PortBusyError           another program holds the port: a second capture, a serial monitor
        PortPermissionError     the user may not open the port: not in its group
        LinkLostError           the link was open and failed: cable pulled, TCP peer gone, adapter reset
        NoAnswerError           the link is open but silent: wrong baud rate, object switched off
        WrongObjectError        what answers cannot be captured: another protocol version, another object
    FileError       4   a file is missing, not a recording, empty, exists already, or cannot be written
    InternalError  70   a fault of this program that ends a capture in order: recording and decoding themselves

The number is the exit code of the command. A driver's error is translated once, in ``host/links``, ``from error``.
"""

from __future__ import annotations

import errno
from typing import ClassVar


class HostError(Exception):
    """An error that a person can do something about.

    Parameters
    ----------
    message : str
        What happened, one sentence without a full stop.
    remedy : str, optional
        What to do about it; empty where nothing can be done.
    """

    exit_code: ClassVar[int] = 1

    def __init__(self, message: str, remedy: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.message}: {self.remedy}" if self.remedy else self.message


class UsageError(HostError):
    """The command was asked for something it cannot do."""

    exit_code = 2


class LinkError(HostError):
    """The object, or the link to it."""

    exit_code = 3


class PortNotFoundError(LinkError):
    """The port does not exist: a wrong name, or the object is not plugged in."""


class PortBusyError(LinkError):
    """Another program holds the port."""


class PortPermissionError(LinkError):
    """The user may not open the port."""


class LinkLostError(LinkError):
    """The link was open and failed: unplugged, closed by the other side, or a failure of the driver."""


class NoAnswerError(LinkError):
    """The link is open, but neither an answer nor data came."""


class WrongObjectError(LinkError):
    """The object cannot be captured: another protocol version, another object, or it refuses to stream."""


class FileError(HostError):
    """A file is missing, is not what it should be, exists already or cannot be written."""

    exit_code = 4


class InternalError(HostError):
    """A fault of this program: an exception in decoding or recording, which the capture survived to its end."""

    exit_code = 70

    def __init__(self, error: BaseException) -> None:
        super().__init__(f"internal error ({type(error).__name__}: {error})", "run again with --debug and report it")
        self.__cause__ = error


def already_there(path: object, remedy: str = "give another name with --out, or move it away") -> FileError:
    """Return the error for a file that would have to be overwritten."""
    return FileError(f"{path} exists already", remedy)


def unreadable(path: object, error: OSError) -> FileError:
    """Return the error for a file that the system does not let us read."""
    if isinstance(error, FileNotFoundError):
        return FileError(f"there is no file {path}", "check the path")
    if isinstance(error, IsADirectoryError):
        return FileError(f"{path} is a folder", "give a file in it")
    if error.errno == errno.ENAMETOOLONG:
        return FileError(f"{path} is too long a name", "check the path")
    remedy = "check the file's permissions" if isinstance(error, PermissionError) else "check the disk"
    return FileError(f"{path} cannot be read ({reason_of(error)})", remedy)


def no_memory(path: object) -> FileError:
    """Return the error for a file that needs more memory than this process can have."""
    return FileError(f"{path} needs more memory than there is", "cut it into trials, or close other programs")


def unwritable(path: object, error: OSError) -> FileError:
    """Return the error for a file that the system does not let us write."""
    remedy = "free some space, or give another place" if error.errno in _FULL else "give another place"
    return FileError(f"{path} cannot be written ({reason_of(error)})", remedy)


_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def reason_of(error: OSError) -> str:
    """Return the system's words for an error."""
    return (error.strerror or str(error)).lower()
