"""Packets longer than one CAN frame: ISO-TP (ISO 15765-2) through can-isotp, without I/O.

Frames in, whole packets and frames to be sent out; no thread and no bus. Time-outs (250 ms for flow control, 1 s for
the next frame) run on the machine's clock inside the library and only matter where frames are lost.
"""

from __future__ import annotations

import logging
from collections import deque
from typing import TYPE_CHECKING

from firmware_protocol.can.frames import CLASSIC_BYTES, FD_BYTES, CanFrame, FrameFlag
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from firmware_protocol.items import Tally

if TYPE_CHECKING:
    import isotp

MAX_PACKET_BYTES = 4095
"""Longer ones are refused: no packet of any version comes near."""
NEVER_MS = 10**9
"""A decoder waits for the rest of a packet for as long as it takes."""
FLOW_CONTROL_MS = 250
"""How long the sender waits for flow control: with nobody there, the next packet waits no longer than that."""
MAX_WAITING = 8
"""Packets that may wait to be sent; more are dropped, as nobody answers."""

_PADDING = 0xCC  # ISO 15765-2: every classic frame of the channel has its full length
_FIRST_FRAME = 1
_CONTINUE, _OVERFLOW = 0x30, 0x32


def flow_control(data: bytes, node: int, fd: bool = False) -> CanFrame | None:
    """Return what a host must answer at once to a frame of a long packet from an object.

    The answer to a first frame is flow control: send all the rest, without pauses (or, of a packet that is too long,
    nothing). No other frame is answered, so whoever answers need not put the packet together: the decoder does.

    Parameters
    ----------
    data : bytes
        Of a frame with the function LONG_FROM_OBJECT.
    node : int
        Node id of the object, 1-31.
    fd : bool
        Whether it is a CAN FD frame.
    """
    if len(data) < 2 or data[0] >> 4 != _FIRST_FRAME:
        return None
    length = (data[0] & 0xF) << 8 | data[1]
    if length == 0:  # beyond 4095 it stands in the next four bytes
        if len(data) < 6:
            return None
        length = int.from_bytes(data[2:6], "big")
    status = _CONTINUE if length <= MAX_PACKET_BYTES else _OVERFLOW
    answer = bytes([status, 0, 0]).ljust(0 if fd else CLASSIC_BYTES, bytes([_PADDING]))
    return CanFrame(arbitration_id(CanFunction.LONG_TO_OBJECT, node, fd), answer, _flags(fd))


def _flags(fd: bool) -> FrameFlag:
    return FrameFlag.FD | FrameFlag.BITRATE_SWITCH if fd else FrameFlag(0)


class LongPacketChannel:
    """One end of the ISO-TP channel of one object.

    Parameters
    ----------
    node : int
        Node id of the object, 1-31.
    is_object : bool
        Which end: the object's or the host's.
    fd : bool
        Whether it sends CAN FD frames of up to 64 bytes; both kinds are received on their own ids.
    listens_only : bool
        Receive packets without ever sending flow control, as decoders do.
    tally : Tally, optional
        Where receptions and transmissions that failed are counted, as ``long_packet_errors``: a frame missing, no flow
        control, an impossible length.
    """

    def __init__(
        self, node: int, is_object: bool, fd: bool = False, listens_only: bool = False, tally: Tally | None = None
    ) -> None:
        # The library imports python-can, which costs 0.1 s: only where a long packet is met.
        import isotp

        to_object = arbitration_id(CanFunction.LONG_TO_OBJECT, node, fd)
        from_object = arbitration_id(CanFunction.LONG_FROM_OBJECT, node, fd)
        rxid, txid = (to_object, from_object) if is_object else (from_object, to_object)
        self._frame_class = isotp.CanMessage
        self._rxid = rxid
        self._incoming: deque[isotp.CanMessage] = deque()
        self._outgoing: list[CanFrame] = []
        self._fd = fd
        self._tally: Tally = Tally() if tally is None else tally
        # The library's own logger would write its warnings to the terminal.
        logger = logging.getLogger("rotdrift.isotp")
        logger.propagate = False
        if not logger.handlers:
            logger.addHandler(logging.NullHandler())
        params = {
            "stmin": 0,
            "rx_flowcontrol_timeout": FLOW_CONTROL_MS,
            # What a decoder makes of frames depends on these alone: the library's timers go by this machine's clock,
            # which means nothing for a recording. A packet whose rest never comes ends with the next first frame.
            **({"rx_consecutive_frame_timeout": NEVER_MS} if listens_only else {}),
            "blocksize": 0,
            "max_frame_size": MAX_PACKET_BYTES,
            "can_fd": fd,
            "bitrate_switch": fd,
            "tx_data_length": FD_BYTES if fd else CLASSIC_BYTES,
            "tx_padding": _PADDING,
            "listen_mode": listens_only,
            "logger_name": logger.name,
        }
        self._layer = isotp.TransportLayerLogic(
            rxfn=lambda _timeout: self._incoming.popleft() if self._incoming else None,
            txfn=self._send,
            address=isotp.Address(isotp.AddressingMode.Normal_11bits, rxid=rxid, txid=txid),
            error_handler=self._count_error,
            params=params,
        )

    def send(self, packet: bytes) -> None:
        """Start to send a packet; it is dropped where too many wait already."""
        if self._layer.tx_queue.qsize() < MAX_WAITING:
            self._layer.send(packet)
            self._layer.process()

    def feed(self, data: bytes) -> list[bytes]:
        """Process the data of one frame of the channel's receiving id; return the packets it completes."""
        self._incoming.append(
            self._frame_class(self._rxid, dlc=len(data), data=data, is_fd=self._fd, bitrate_switch=self._fd)
        )
        self._layer.process()
        return [bytes(packet) for packet in iter(self._layer.recv, None)]

    def poll(self) -> None:
        """Let time-outs and separation times pass; to be called now and then while something is under way."""
        self._layer.process()

    def take_outgoing(self) -> list[CanFrame]:
        """Return the frames to be sent since the last call."""
        outgoing, self._outgoing = self._outgoing, []
        return outgoing

    def _send(self, message: isotp.CanMessage) -> None:
        self._outgoing.append(CanFrame(message.arbitration_id, bytes(message.data), _flags(self._fd)))

    def _count_error(self, _error: Exception) -> None:
        self._tally["long_packet_errors"] += 1
