"""What CAN adapters on byte links share: an adapter between the virtual object and a pseudo-terminal or TCP port."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Protocol

from emulator.links.byte_stream import ByteLink
from emulator.links.can.link import MAX_PACKETS_AT_ONCE, CanAddress
from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import CanFrame
from firmware_protocol.packets import PacketType


class Adapter(Protocol):
    """The protocol between an adapter and its host, without I/O."""

    greeting: bytes
    """What the adapter sends to a new host unasked."""

    def hears(self, time_ms: int) -> bool:
        """Return whether the host has opened the channel and frames may be passed on now."""

    def reset(self) -> None:
        """Forget everything: there is a new host."""

    def from_bus(self, frame: CanFrame, time_ms: int) -> bytes:
        """Return what the host is sent for a frame."""

    def from_host(self, data: bytes) -> tuple[bytes, list[CanFrame]]:
        """Return answers to the host, and frames for the bus."""


class CanByteLink(ByteLink):
    """A byte link with an adapter. The object is heard only while the host has the channel open."""

    carries_damage = False  # the damage meant is that of the object's own line: the bus

    def prepare(self, address: CanAddress, adapter: Adapter) -> None:
        """Put the adapter in; to be called once by the subclass."""
        self.address = address
        self.adapter = adapter
        self.object_end = CanObject(address.node, address.fd)
        self._greeted = False
        self._commands: list[bytes] = []

    def _restart(self) -> None:
        super()._restart()
        self.adapter.reset()
        self._greeted = False

    def send(self, packets: Sequence[bytes]) -> int | None:
        """Send as frames through the adapter; see :meth:`emulator.links.Link.send`."""
        self._exchange()
        if not self._connected() or not self.adapter.hears(time.monotonic_ns() // 1_000_000):
            # Whoever opens the channel later gets the sample state again; the object's identity stays known.
            self.object_end.encode([packet for packet in packets if packet[0] == PacketType.INFO])
            self.object_end.reset()
            return None
        if not self._flush():
            return 0
        accepted = packets[:MAX_PACKETS_AT_ONCE]
        self._put(self.object_end.encode(accepted))
        return len(accepted)

    def _put(self, frames: Sequence[CanFrame]) -> None:
        if not frames:
            return
        time_ms = time.monotonic_ns() // 1_000_000
        self._rest += b"".join(self.adapter.from_bus(frame, time_ms) for frame in frames)
        self._flush()

    def _exchange(self) -> None:
        if not self._connected():
            return
        if not self._greeted:
            self._greeted = True
            self._rest += self.adapter.greeting
        data = self._read()
        if data:
            answers, frames = self.adapter.from_host(data)
            self._rest += answers
            for frame in frames:
                commands, replies = self.object_end.receive(frame)
                self._commands += commands
                self._put(replies)
        self._flush()

    def receive(self) -> list[bytes]:
        """Return the commands that have arrived; see :meth:`emulator.links.Link.receive`."""
        self._exchange()
        self._put(self.object_end.poll())
        commands, self._commands = self._commands, []
        return commands
