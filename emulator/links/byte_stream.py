"""What all serial-like links share: framing, a small output buffer, and a place for faults on the framed bytes."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TypeAlias

from emulator.links import Link
from firmware_protocol.serial.framing import FrameDecoder, encode_frame

Tamper: TypeAlias = Callable[[bytes, bytes], bytes]
"""A packet and its frame as it should be on the wire in, the bytes that really go out."""

_ACCEPTED_AT_ONCE_BYTES = 4096


class ByteLink(Link):
    """A link that moves bytes; a subclass knows how.

    A write that the wire accepts only in part leaves its rest here, at most ``_ACCEPTED_AT_ONCE_BYTES`` and a frame,
    and no further packet is accepted until it is gone: frames never mix.
    """

    carries_damage = True

    def __init__(self) -> None:
        self.tamper: Tamper | None = None
        """Faults on the framed bytes."""
        self._rest = b""
        self._decoder = FrameDecoder()

    @abstractmethod
    def _connected(self) -> bool:
        """Return whether somebody is at the other end."""

    @abstractmethod
    def _write(self, data: bytes) -> int:
        """Write what the wire accepts now and return how many bytes; never blocks, never raises OSError."""

    @abstractmethod
    def _read(self) -> bytes:
        """Return what has arrived, possibly nothing; never blocks, never raises OSError."""

    def _restart(self) -> None:
        """Forget half-sent and half-received frames: there is a new other end."""
        self._rest = b""
        self._decoder = FrameDecoder()

    def send(self, packets: Sequence[bytes]) -> int | None:
        """Frame and write; see :meth:`Link.send`."""
        if not self._connected():
            self._rest = b""
            return None
        if not self._flush():
            return 0
        frames: list[bytes] = []
        size = 0
        for packet in packets:
            frame = encode_frame(packet)
            frames.append(frame if self.tamper is None else self.tamper(packet, frame))
            size += len(frames[-1])
            if size >= _ACCEPTED_AT_ONCE_BYTES:
                break
        self._rest = b"".join(frames)
        self._flush()
        return len(frames)

    def inject(self, data: bytes) -> None:
        """Put bytes on the wire that are not a frame, behind what is on its way."""
        if self._connected():
            self._rest += data
            self._flush()

    def _flush(self) -> bool:
        if self._rest:
            written = self._write(self._rest)
            self._rest = self._rest[written:]
        return not self._rest

    def receive(self) -> list[bytes]:
        """Read and remove the framing; see :meth:`Link.receive`."""
        data = self._read()
        return self._decoder.feed(data) if data else []
