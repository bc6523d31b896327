"""A byte file in place of a wire, in virtual time: a trial of minutes is written in seconds.

Nobody is at the other end, so the link itself plays the host that starts the stream: the first thing it delivers is
START.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from emulator import EmulatorError, LinkError
from emulator.links.byte_stream import ByteLink
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Start
from firmware_protocol.serial.framing import encode_frame


def from_address(rest: str) -> FileLink:
    """Return the link of ``file:PATH``.

    Raises
    ------
    LinkError
        There is no path.
    """
    if not rest:
        raise LinkError("file: needs a path: file:out.bin")
    return FileLink(Path(rest).expanduser())


class FileLink(ByteLink):
    """Everything the object sends on a serial line, framed, in a new file."""

    virtual_time = True

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self._unplugged = False
        self._start = b""
        self._file: BinaryIO | None = None

    @property
    def host_uri(self) -> str:
        """``file:`` and the path."""
        return f"file:{self.path}"

    def open(self) -> None:
        """Make the file.

        Raises
        ------
        EmulatorError
            It exists already or cannot be written.
        """
        try:
            self._file = self.path.open("xb")
        except FileExistsError:
            raise EmulatorError(f"{self.path} exists already: choose another name, or remove it") from None
        except OSError as error:
            raise EmulatorError(f"cannot write {self.path}: {error.strerror}") from error
        self._start = encode_frame(encode_packet(Start(0)))

    def close(self) -> None:
        """Close the file; it stays."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def unplug(self) -> None:
        """Do nothing: what the object sends while unplugged is lost because nobody is connected."""
        self._unplugged = True

    def replug(self) -> None:
        """End :meth:`unplug`."""
        self._unplugged = False

    def _connected(self) -> bool:
        return self._file is not None and not self._unplugged

    def _write(self, data: bytes) -> int:
        assert self._file is not None
        try:
            return self._file.write(data)
        except OSError as error:  # nobody to wait for, unlike on a live link
            raise EmulatorError(f"cannot write {self.path}: {error.strerror}") from error

    def _read(self) -> bytes:
        data, self._start = self._start, b""
        return data

    def wait(self, timeout_s: float) -> None:
        """Return at once: time is virtual."""
