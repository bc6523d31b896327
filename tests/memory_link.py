"""A link of the emulator in memory: commands are put in, bytes taken out, and its other end has knobs."""

from __future__ import annotations

from collections import deque

from emulator.links.byte_stream import ByteLink
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Command
from firmware_protocol.serial.framing import encode_frame


class MemoryLink(ByteLink):
    """A serial line in memory, without time of its own.

    It imitates framing, refusal to take more, and an absent other end. It does not imitate speed or latency.

    Attributes
    ----------
    connected
        Whether somebody is at the other end.
    room_bytes
        How much the wire still takes; infinite unless set.
    """

    virtual_time = True

    def __init__(self) -> None:
        super().__init__()
        self.connected = True
        self.room_bytes: float = float("inf")
        self._sent = bytearray()
        self._commands: deque[bytes] = deque()

    @property
    def host_uri(self) -> str:
        """``memory:``."""
        return "memory:"

    def open(self) -> None:
        """Connect."""
        self.connected = True

    def close(self) -> None:
        """Disconnect."""
        self.connected = False
        self._restart()

    def put(self, *commands: Command) -> None:
        """Send commands to the object."""
        for command in commands:
            self.put_bytes(encode_frame(encode_packet(command)))

    def put_bytes(self, data: bytes) -> None:
        """Send any bytes to the object."""
        self._commands.append(data)

    def take(self) -> bytes:
        """Return what the object has sent since the last call."""
        data = bytes(self._sent)
        self._sent.clear()
        return data

    def _connected(self) -> bool:
        return self.connected

    def _write(self, data: bytes) -> int:
        n = int(min(len(data), self.room_bytes))
        self.room_bytes -= n
        self._sent += data[:n]
        return n

    def _read(self) -> bytes:
        data = b"".join(self._commands)
        self._commands.clear()
        return data

    def wait(self, timeout_s: float) -> None:
        """Return at once: time is virtual."""
