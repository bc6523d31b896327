"""CAN links through python-can: any interface it supports, read by the reader's own thread.

What python-can really does, and what follows from it:

- ``Notifier`` ends its thread when a listener raises, so it is not used. ``recv`` is called here, one frame a call.
- Its SLCAN parser keeps a byte that is not ASCII in its buffer and fails on it for ever: our own reading of lines skips
  it, and where that cannot be used (Windows) the buffer is flushed. Its socketcand parser keeps a frame it cannot
  read and fails for ever; and a server that is gone makes ``recv`` return at once, for ever: the bus is opened again.
  All of it is counted.
- ``slcan`` opens where nobody answers; the adapter must send something first.
- An interface that goes down (``ip link set can0 down``) fails one ``recv`` or one ``send``, whichever comes first, and
  works again once it is up. One that was pulled does the same and never works again, not even when it is back: its
  number shows that.

Flow control for long packets is sent from here, within the reading thread, and packets are put together by the decoder
alone: an answer depends on the first frame of a packet only.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from operator import methodcaller
from typing import Any

import can

from firmware_protocol.can.encoder import command_frame
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from firmware_protocol.can.iso_tp import flow_control
from firmware_protocol.can.mapping import ALL_NODES, HOST_FUNCTIONS, NODE_MASK, CanFunction, split_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.errors import ProtocolError
from firmware_protocol.packets import Command
from host.errors import LinkError, LinkLostError, UsageError
from host.links.can.drivers import CanSettings, can_settings, open_bus
from host.links.can.health import BusHealth
from host.links.can.socketcan import dropped_frames, interface_index
from host.links.opening import Opening
from host.links.transport import FrameChunk, Transport
from host.links.uri import LinkUri
from host.text import plain

MAX_FRAMES = 1024
"""No read returns more."""
SEND_TIMEOUT_S = 1.0
DRIVER_NS = 250_000_000
"""Between two queries of kernel and driver: what was dropped, the bus state, whether it is still the same adapter."""
ECHOING = frozenset({"udp_multicast"})
"""Interfaces that return what we sent ourselves, unasked."""
SETTLING_S = 3.0
"""Without a node id in the link, a second object heard within this time is a question to the user."""

IO_ERRORS: tuple[type[Exception], ...] = (can.CanError, OSError, ValueError, TypeError, IndexError, AttributeError)


def open_transport(uri: LinkUri) -> CanTransport:
    """Open a ``can:INTERFACE:CHANNEL?bitrate=…&node=…`` link.

    Raises
    ------
    UsageError
        No such interface, impossible option.
    LinkError
        It does not open, or the adapter is silent.
    """
    settings = can_settings(uri)
    return CanTransport(settings, str(uri), open_bus(settings, str(uri)))


class CanTransport(Transport):
    """An open bus, and the one object on it that is talked to; ``name`` is the link's URI."""

    def __init__(self, settings: CanSettings, name: str, bus: can.BusABC) -> None:
        self.name = name
        self.health = BusHealth()
        """What was noticed on the bus."""
        self._settings = settings
        self._bus: Any = bus
        self._node = settings.node
        self._node_since = time.monotonic()
        self._lock = threading.Lock()
        self._echoes: deque[tuple[int, bytes]] | None = deque(maxlen=64) if settings.interface in ECHOING else None
        self._queried_ns = 0
        self._index = interface_index(settings.channel) if settings.interface == "socketcan" else 0
        self._closed = False
        self._opening: Opening[can.BusABC] | None = None  # again, after its parser or its server failed
        self._heard = True  # whether a frame came since it was opened

    @property
    def node(self) -> int | None:
        """Node id of the object; None while none is known."""
        return self._node

    @property
    def interface_name(self) -> str:
        """What the interface calls itself."""
        name = plain(str(self._bus.channel_info), 120)
        return f"{self._settings.interface} {self._settings.channel}" if name in ("", "unknown") else name

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know about the bus, a sentence each."""
        return self.health.problems(self.name)

    def encode_command(self, command: Command) -> bytes:
        """Return the encoded packet of a command, without framing."""
        return encode_packet(command)

    def read(self, timeout_s: float) -> FrameChunk | None:
        """Wait for the next frame, at most ``timeout_s``, and read what else is there."""
        if self._closed:
            raise LinkLostError(f"{self.name} is closed")
        if self._opening is not None and not self._is_open_again(self._opening, timeout_s):
            return None
        self._query_driver()
        frames: list[CanFrame] = []
        message = self._receive(timeout_s)
        while message is not None:
            frame = received_frame(message, time.monotonic_ns())
            if self._is_wanted(frame):
                frames.append(frame)
            message = self._receive(0.0) if len(frames) < MAX_FRAMES else None
        if not frames:
            return None
        self._heard = True
        self._respond(frames)
        return FrameChunk(pack_frames(frames), frames[-1].host_time_ns)

    def write(self, data: bytes) -> None:
        """Send an encoded command packet to the object; to all objects while none is known.

        Raises
        ------
        LinkLostError
            The bus accepts no frames: nobody acknowledges them, or the interface is gone.
        """
        if self._settings.listen_only:
            return
        try:
            frame = command_frame(data, self._node or ALL_NODES, self._settings.fd)
        except ProtocolError as error:
            raise UsageError(str(error)) from error
        self._send(frame)

    def close(self) -> None:
        """Leave the bus; never raises."""
        self._closed = True
        if self._opening is not None:
            self._opening.abandon()
        with self._lock, contextlib.suppress(*IO_ERRORS):
            self._bus.shutdown()

    def _query_driver(self) -> None:
        now_ns = time.monotonic_ns()
        if now_ns - self._queried_ns < DRIVER_NS:
            return
        self._queried_ns = now_ns
        self.health.dropped_frames = dropped_frames(self._bus)
        with contextlib.suppress(*IO_ERRORS):
            if self._bus.state is can.BusState.ERROR:  # of some drivers; most say "active" whatever happens
                self.health.bus_off()
        if self._index and interface_index(self._settings.channel) != self._index:
            raise self._gone("it was pulled")

    def _gone(self, reason: str) -> LinkLostError:
        return LinkLostError(f"{self.name} is gone ({reason})", "plug the adapter in again")

    def _is_wanted(self, frame: CanFrame) -> bool:
        """Return whether a frame passes: the filter where interfaces have none of their own."""
        node = self._settings.node
        if frame.flags & FrameFlag.ERROR:
            return True
        if self._echoes and (frame.arbitration_id, frame.data) in self._echoes:
            self._echoes.remove((frame.arbitration_id, frame.data))
            return False
        if not frame.flags & FrameFlag.EXTENDED and (node is None or frame.arbitration_id & NODE_MASK == node):
            return True
        self.health.filtered_frames += 1
        return False

    def _receive(self, timeout_s: float) -> can.Message | None:
        try:
            message: can.Message | None = self._bus.recv(timeout_s)
        except IO_ERRORS as error:
            self._recover(error)
            return None
        return message

    def _recover(self, error: Exception) -> None:
        """Repair what a failed read left behind.

        Raises
        ------
        LinkLostError
            It cannot be repaired: the link is gone.
        """
        interface = self._settings.interface
        no_text = isinstance(error, UnicodeDecodeError) or isinstance(error.__cause__, UnicodeDecodeError)
        if interface == "slcan" and (no_text or isinstance(error, ValueError | IndexError)):
            self.health.parser_errors += 1
            # Bytes that are not ASCII stay in the library's own buffer; of other lines nothing is left.
            if no_text:
                with contextlib.suppress(*IO_ERRORS):
                    self._bus.skip_unreadable()
            return
        if interface == "socketcand":
            self.health.parser_errors += 1
            if not self._heard:  # opened again in vain
                raise self._gone(_first_line(error)) from error
            self._reopen()
            return
        if _is_down(error):
            self.health.went_down = True
            return
        raise self._gone(plain(str(error), 120) or type(error).__name__) from error

    def _reopen(self) -> None:
        """Have the bus opened again, in a thread: a server may take its time, or never answer."""
        self._heard = False
        with self._lock, contextlib.suppress(*IO_ERRORS):
            self._bus.shutdown()
        self._opening = Opening(lambda: open_bus(self._settings, self.name), methodcaller("shutdown"))

    def _is_open_again(self, opening: Opening[can.BusABC], timeout_s: float) -> bool:
        if not opening.wait(timeout_s):
            return False
        self._opening = None
        try:
            bus = opening.result()
        except (LinkError, UsageError) as failure:
            raise LinkLostError(
                f"{self.name} is gone and does not open again ({failure.message})", "start its server again"
            ) from failure
        with self._lock:
            self._bus = bus
        self.health.reopens += 1
        return True

    def _send(self, frame: CanFrame) -> None:
        message = can.Message(
            arbitration_id=frame.arbitration_id,
            is_extended_id=False,
            is_fd=frame.is_fd,
            bitrate_switch=bool(frame.flags & FrameFlag.BITRATE_SWITCH),
            data=frame.data,
        )
        if self._opening is not None:
            return  # commands are repeated
        if self._echoes is not None:
            self._echoes.append((frame.arbitration_id, frame.data))
        try:
            with self._lock:
                self._bus.send(message, timeout=SEND_TIMEOUT_S)
        except IO_ERRORS as error:
            if _is_down(error):
                self.health.went_down = True
                return  # commands are repeated
            if self._settings.interface == "socketcand":
                return  # the reading side notices, and opens the bus again
            raise LinkLostError(
                f"{self.name} takes no frames ({plain(str(error), 100)})",
                "check that the object is on the bus, the bit rate, and that both ends are terminated",
            ) from error

    def _respond(self, frames: list[CanFrame]) -> None:
        """Do what frames need at once: find the object, answer long packets, notice errors."""
        for frame in frames:
            if frame.flags & FrameFlag.ERROR:
                self.health.error_frame(frame, self._settings.interface)
                continue
            identity = split_id(frame.arbitration_id)
            strange = frame.flags & (FrameFlag.EXTENDED | FrameFlag.REMOTE)
            if identity is None or strange or identity.node == ALL_NODES or identity.function in HOST_FUNCTIONS:
                continue
            if self._node is None:
                self._node, self._node_since = identity.node, time.monotonic()
            elif identity.node != self._node:
                self._note_other(identity.node)
                continue
            if identity.function is CanFunction.LONG_FROM_OBJECT and not self._settings.listen_only:
                answer = flow_control(frame.data, identity.node, identity.whole_packet)
                if answer is not None:
                    self._send(answer)

    def _note_other(self, node: int) -> None:
        if node in self.health.other_nodes:
            return
        self.health.other_nodes.add(node)
        may_ask = self._settings.node is None and not self._settings.listen_only
        if may_ask and time.monotonic() - self._node_since < SETTLING_S:
            found = ", ".join(str(each) for each in sorted({self._node or 0, *self.health.other_nodes}))
            joint = "&" if "?" in self.name else "?"
            raise UsageError(
                f"several objects are on the bus (node ids {found})", f"choose one: {self.name}{joint}node={self._node}"
            )


def received_frame(message: can.Message, host_time_ns: int) -> CanFrame:
    """Return a message of python-can as a frame received at a time."""
    flags = 0
    if message.is_extended_id:
        flags |= FrameFlag.EXTENDED
    if message.is_fd:
        flags |= FrameFlag.FD
    if message.bitrate_switch:
        flags |= FrameFlag.BITRATE_SWITCH
    if message.is_remote_frame:
        flags |= FrameFlag.REMOTE
    if message.is_error_frame:
        flags |= FrameFlag.ERROR
    data = b"" if message.is_remote_frame else bytes(message.data)
    if not message.is_fd:
        data = data[:8]
    return CanFrame(
        message.arbitration_id,
        data,
        FrameFlag(flags),
        host_time_ns,
        float(message.timestamp),
        message.dlc if message.is_remote_frame else 0,
    )


def _first_line(error: Exception) -> str:
    return plain(str(error).partition("Traceback")[0].strip(), 80)


def _is_down(error: Exception) -> bool:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return code == 100 or "Network is down" in str(error)  # ENETDOWN
