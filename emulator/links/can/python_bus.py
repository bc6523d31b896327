"""The virtual object on a bus of python-can: ``virtual``, ``udp_multicast``, ``socketcan``, or real hardware.

Nothing shows whether anybody listens, so samples are sent from power-up on, as on a real bus.
"""

from __future__ import annotations

import contextlib
import socket
import sys
import time
from collections.abc import Sequence
from typing import Any

import can

from emulator import LinkError
from emulator.links import Link
from emulator.links.can.link import MAX_PACKETS_AT_ONCE, CanAddress
from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import CanFrame, FrameFlag
from firmware_protocol.errors import ProtocolError

UNTIMED = ("virtual", "udp_multicast", "socketcan")
"""Interfaces without a bit rate of their own."""
MAX_UNSENT_FRAMES = 512
_DRIVER_ERRORS = (can.CanError, OSError, ValueError, TypeError, NotImplementedError, ImportError)


def from_can_address(address: CanAddress) -> PythonCanLink:
    """Return the link of ``can:INTERFACE:CHANNEL``.

    Raises
    ------
    LinkError
        python-can has no such interface.
    """
    if address.interface not in can.VALID_INTERFACES:
        raise LinkError(f"can: python-can has no interface {address.interface!r}: try slcan, socketcan or virtual")
    return PythonCanLink(address)


class PythonCanLink(Link):
    """A node on a bus."""

    def __init__(self, address: CanAddress) -> None:
        self.address = address
        self.same_process = address.interface == "virtual"
        self.object_end = CanObject(address.node, address.fd)
        self._bus: can.BusABC | None = None
        self._unsent: list[CanFrame] = []
        self._early: can.Message | None = None

    @property
    def host_uri(self) -> str:
        """``can:INTERFACE:CHANNEL?…``."""
        return self.address.host_uri(self.address.channel)

    def open(self) -> None:
        """Open the bus."""
        address = self.address
        options: dict[str, Any] = {}
        if address.interface not in UNTIMED:
            options["bitrate"] = address.bitrate
            if address.fd:
                options["data_bitrate"] = address.data_bitrate
        if address.fd:
            options["protocol" if address.interface == "virtual" else "fd"] = (
                can.CanProtocol.CAN_FD if address.interface == "virtual" else True
            )
        try:
            self._bus = can.Bus(interface=address.interface, channel=address.channel, **options)
        except _DRIVER_ERRORS as error:
            raise LinkError(f"can:{address.interface}:{address.channel} does not open: {error}") from error
        if address.interface == "udp_multicast":
            _hear_own_group_only(self._bus)

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None
        self._unsent.clear()
        self.object_end.reset()

    def send(self, packets: Sequence[bytes]) -> int | None:
        """Send as frames; see :meth:`emulator.links.Link.send`."""
        if self._bus is None:
            return None
        if self._unsent:
            self._put(())
            if self._unsent:
                return 0
        accepted = packets[:MAX_PACKETS_AT_ONCE]
        try:
            frames = self.object_end.encode(accepted)
        except ProtocolError:
            frames = []
        self._put(frames)
        return len(accepted)

    def _put(self, frames: Sequence[CanFrame]) -> None:
        self._unsent += frames
        del self._unsent[MAX_UNSENT_FRAMES:]
        sent = 0
        assert self._bus is not None
        for frame in self._unsent:
            try:
                self._bus.send(_message(frame))
            except (can.CanError, OSError):  # the queue is full, or the bus is down
                break
            sent += 1
        del self._unsent[:sent]

    def receive(self) -> list[bytes]:
        """Return the commands that have arrived; see :meth:`emulator.links.Link.receive`."""
        commands: list[bytes] = []
        while (message := self._next(0.0)) is not None:
            if message.is_error_frame:
                continue
            found, replies = self.object_end.receive(_frame(message))
            commands += found
            self._put(replies)
        if self._bus is not None:
            self._put(self.object_end.poll())
        return commands

    def _next(self, timeout_s: float) -> can.Message | None:
        if self._early is not None:
            message, self._early = self._early, None
            return message
        if self._bus is None:
            return None
        try:
            return self._bus.recv(timeout_s)
        except (can.CanError, OSError):
            return None

    def wait(self, timeout_s: float) -> None:
        """Wait for a frame."""
        if self._early is None and timeout_s > 0:
            started = time.monotonic()
            self._early = self._next(timeout_s)
            if self._early is None:  # a bus that is down fails at once
                time.sleep(max(min(timeout_s - (time.monotonic() - started), timeout_s), 0.0))


def _hear_own_group_only(bus: Any) -> None:  # noqa: ANN401 (its socket is no part of BusABC)
    """End what Linux does by default: a socket receives the groups that anybody on this machine has joined."""
    sock = getattr(getattr(bus, "_multicast", None), "_socket", None)
    if sock is not None and sys.platform == "linux":
        level, option = (41, 29) if sock.family == socket.AF_INET6 else (0, 49)  # IPV6_/IP_MULTICAST_ALL
        with contextlib.suppress(OSError):
            sock.setsockopt(level, option, 0)


def _message(frame: CanFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.arbitration_id,
        is_extended_id=bool(frame.flags & FrameFlag.EXTENDED),
        is_remote_frame=bool(frame.flags & FrameFlag.REMOTE),
        is_fd=frame.is_fd,
        bitrate_switch=bool(frame.flags & FrameFlag.BITRATE_SWITCH),
        dlc=frame.remote_length if frame.flags & FrameFlag.REMOTE else len(frame.data),
        data=frame.data,
    )


def _frame(message: can.Message) -> CanFrame:
    flags = FrameFlag(0)
    flags |= FrameFlag.EXTENDED if message.is_extended_id else FrameFlag(0)
    flags |= FrameFlag.REMOTE if message.is_remote_frame else FrameFlag(0)
    flags |= FrameFlag.FD if message.is_fd else FrameFlag(0)
    return CanFrame(message.arbitration_id, bytes(message.data), flags)
