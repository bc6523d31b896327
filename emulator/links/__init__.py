"""How packets leave the virtual object and commands reach it: one class per kind of link.

The boundary is *packets*, not framed bytes: the firmware hands over encoded packets (type byte and fields, no framing),
and the link does the framing of its own wire: COBS and CRC on a serial line, frames with arbitration ids on CAN. What
comes back from ``receive`` are encoded command packets without framing.

A link never blocks but in ``wait``, and never raises on what the other end does: a reader that goes away, comes back or
does not read is ordinary. ``send`` accepts as many whole packets as it has room for and returns how many; the firmware
keeps the rest and drops when its queue is full. ``None`` means that nobody is at the other end: the object then drops
at once, as a USB device does whose port is not open.

To add a kind: a module here with ``from_address(rest) -> Link``, where ``rest`` is what follows ``kind:``, and a row in
``_MODULES``; the module is imported only when its kind is asked for. Serial-like links derive from
:class:`emulator.links.byte_stream.ByteLink` and only move bytes; others derive from :class:`Link`.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Sequence

from emulator import LinkError

__all__ = ["Link", "open_link"]

_MODULES = {
    "pty": "emulator.links.pty_link",
    "tcp": "emulator.links.tcp_link",
    "file": "emulator.links.file_link",
    "can": "emulator.links.can.link",
}


class Link(ABC):
    """One end of a wire; made closed, used as a context manager or between :meth:`open` and :meth:`close`."""

    carries_damage: bool = False
    """Whether damaged bytes reach the other end: CAN controllers find them by the checksum and send the frame again."""
    virtual_time: bool = False
    """True for a link without a live other end: the run then goes as fast as it can."""

    same_process: bool = False
    """True for a link that ends in this process: no other program can reach it."""

    @property
    @abstractmethod
    def host_uri(self) -> str:
        """The link as the host names it, e.g. ``serial:/dev/pts/3``; known once open."""

    @abstractmethod
    def open(self) -> None:
        """Open the link.

        Raises
        ------
        LinkError
            It cannot be opened; the message has the reason and a remedy.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the link and leave nothing behind; may be called twice."""

    @abstractmethod
    def send(self, packets: Sequence[bytes]) -> int | None:
        """Accept encoded packets without blocking.

        Parameters
        ----------
        packets : sequence of bytes
            In order, each type byte and fields. None at all asks whether anybody is there.

        Returns
        -------
        int or None
            How many were accepted, from the front; None when nobody is at the other end.
        """

    @abstractmethod
    def receive(self) -> list[bytes]:
        """Return the encoded commands that have arrived since the last call, without blocking."""

    @abstractmethod
    def wait(self, timeout_s: float) -> None:
        """Block until something arrives or the time is over; may return early."""

    def unplug(self) -> None:
        """Vanish as an unplugged device does; :meth:`replug` brings it back under the same name where it can."""
        self.close()

    def replug(self) -> None:
        """Come back after :meth:`unplug`."""
        self.open()

    def __enter__(self) -> Link:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_link(address: str) -> Link:
    """Make the link of an address; still closed, :func:`emulator.runner.run` opens it.

    Parameters
    ----------
    address : str
        ``pty:`` or ``pty:PATH`` (a symbolic link to make), ``tcp:PORT`` (loopback; 0 is any free one),
        ``file:PATH`` (a new byte file, in virtual time), ``can:...``.

    Raises
    ------
    LinkError
        No such kind, or the rest of the address is wrong.
    """
    kind, colon, rest = address.partition(":")
    if not colon or kind not in _MODULES:
        raise LinkError(f"no link {address!r}: write pty:, pty:PATH, tcp:PORT, file:PATH or can:INTERFACE:CHANNEL")
    try:
        module = importlib.import_module(_MODULES[kind])
    except ModuleNotFoundError as error:
        raise LinkError(f"{kind}: links need the Python package {error.name!r}: install it") from error
    link = module.from_address(rest)
    assert isinstance(link, Link)
    return link
