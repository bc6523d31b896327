"""Packets in and out of a byte stream: COBS, CRC-16/CCITT-FALSE, 0x00 on both sides of every frame.

    0x00 | COBS(packet, CRC low byte, CRC high byte) | 0x00

The bytes between two delimiters are a *piece*. A piece with the right checksum is a frame; any other is skipped and
counted once, by its cause. Every byte is accounted for::

    bytes  = delimiters + frame_bytes + skipped_bytes + pending_bytes
    pieces = frames + cobs_errors + crc_errors + oversize + partial_starts

A frame whose own bytes and own two delimiters arrive whole is always received, whatever happens around it.
"""
# mypy: allow-untyped-calls

from __future__ import annotations

from binascii import crc_hqx

from cobs import cobs

from firmware_protocol.errors import PacketValueError
from firmware_protocol.items import FrameCounters, Tally

CRC_BYTES = 2
CRC_INITIAL = 0xFFFF
MAX_PACKET_BYTES = 252
"""Largest packet. With its CRC it has 254 bytes, so that COBS always adds exactly one."""
LONE_FRAME_OVERHEAD = CRC_BYTES + 3
"""Bytes by which a frame with both its delimiters is longer than its packet."""
MAX_PIECE_BYTES = MAX_PACKET_BYTES + CRC_BYTES + 1
"""Longest run of bytes without a delimiter that can be a frame; also the most that is ever buffered."""


def checksum(packet: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE: polynomial 0x1021, initial 0xFFFF, not reflected; 0x29B1 for ``123456789``."""
    return crc_hqx(packet, CRC_INITIAL)


def encode_frame(packet: bytes) -> bytes:
    """Return the frame of a packet, with both delimiters.

    Raises
    ------
    PacketValueError
        The packet is empty or has more than ``MAX_PACKET_BYTES``.
    """
    if not 1 <= len(packet) <= MAX_PACKET_BYTES:
        raise PacketValueError(f"a packet must have 1 to {MAX_PACKET_BYTES} bytes, not {len(packet)}")
    encoded: bytes = cobs.encode(packet + checksum(packet).to_bytes(CRC_BYTES, "little"))
    return b"\0" + encoded + b"\0"


def _packet_in(piece: bytes) -> bytes | str:
    """Return the packet in a piece; where the piece is not a frame, the name of the counter for it."""
    if len(piece) > MAX_PIECE_BYTES:
        return "oversize"
    try:
        data = cobs.decode(piece)
    except cobs.DecodeError:
        return "cobs_errors"
    packet: bytes = data[:-CRC_BYTES]
    if len(data) < CRC_BYTES or crc_hqx(packet, CRC_INITIAL) != data[-2] | data[-1] << 8:
        return "crc_errors"
    return packet


class FrameDecoder:
    """Find the frames in a byte stream, however it is cut into chunks.

    ``feed`` never blocks, never raises on bytes from the wire, and buffers at most ``MAX_PIECE_BYTES``. The packets and
    counters after n bytes depend on these bytes alone, not on how they were chunked.
    """

    def __init__(self) -> None:
        self._pending = b""
        self._skipping = False  # inside a piece already counted as oversize
        self.at_start = True
        """Whether no delimiter has been met yet: the next piece may be the rest of a frame."""
        # Plain numbers where every frame is counted, a tally for what is rare.
        self._bytes = self._delimiters = self._frames = self._frame_bytes = 0
        self._tally: Tally = Tally()

    @property
    def counters(self) -> FrameCounters:
        """Snapshot of the counters."""
        return FrameCounters(
            bytes=self._bytes,
            pending_bytes=len(self._pending),
            delimiters=self._delimiters,
            frames=self._frames,
            frame_bytes=self._frame_bytes,
            **self._tally,
        )

    def feed(self, data: bytes) -> list[bytes]:
        """Process what one read returned; return the packets of the frames that it completed."""
        return [packet for packet in self.unframe(self.complete(data)) if isinstance(packet, bytes)]

    def restart(self) -> None:
        """Forget the piece that has started: the link was cut and opened again. The counters go on."""
        self._tally["skipped_bytes"] += len(self._pending)
        self._pending = b""
        self._skipping = False
        self.at_start = True

    def complete(self, data: bytes) -> bytes:
        """Process what one read returned; return all pieces now complete, each with the delimiter that ends it.

        The first half of :meth:`feed`. What it returns goes to :meth:`unframe` before the next call.
        """
        self._bytes += len(data)
        data = bytes(data)
        if not self._pending and not self._skipping and data[-1:] == b"\0":
            return data  # by far the commonest: reads end where frames do
        if self._skipping:  # the rest of an oversize piece, up to its delimiter
            end = data.find(b"\0")
            if end < 0:
                self._tally["skipped_bytes"] += len(data)
                return b""
            self._tally["skipped_bytes"] += end
            self._skipping = False
            data = data[end:]
        if self._pending:
            data = self._pending + data
        end = data.rfind(b"\0") + 1
        self._pending = data[end:]
        if len(self._pending) > MAX_PIECE_BYTES:  # cannot become a frame: dropped now, so that memory stays bounded
            self._reject("oversize", len(self._pending), at_start=self.at_start and end == 0)
            self._pending = b""
            self._skipping = True
        return data[:end]

    def offset_of_next(self, data: bytes) -> int:
        """Return where in ``data`` what :meth:`complete` will return starts; negative if it came before."""
        return max(data.find(b"\0"), 0) if self._skipping else -len(self._pending)

    def unframe(self, pieces: bytes) -> list[bytes | int]:
        """Return the packets in pieces that each end in a delimiter, as :meth:`complete` returned them.

        Of a damaged piece the length is returned instead; of the rest of a frame that started before the link was
        opened, and of what is longer than any frame, nothing.
        """
        runs = pieces.split(b"\0")
        self._delimiters += len(runs) - 1
        packets: list[bytes | int] = []
        for run in runs:
            if run:
                packet = self.open_piece(run)
                if packet is not None:
                    packets.append(packet)
                elif not self.at_start and len(run) <= MAX_PIECE_BYTES:
                    packets.append(len(run))
            self.at_start = False
        return packets

    def open_piece(self, piece: bytes) -> bytes | None:
        """Return the packet in one piece (without delimiter), or None; count it either way."""
        packet = _packet_in(piece)
        if isinstance(packet, str):
            self._reject(packet, len(piece), at_start=self.at_start)
            return None
        self.count(0, 1, len(piece))
        return packet

    def count(self, delimiters: int, frames: int, frame_bytes: int) -> None:
        """Count frames that were decoded elsewhere, many at once."""
        self._delimiters += delimiters
        self._frames += frames
        self._frame_bytes += frame_bytes

    def open_lone(self, pieces: bytes) -> bytes | None:
        """Return the packet where :meth:`complete` returned one good frame and delimiters around it, as live reads do.

        None, and nothing counted, for anything else, which is for :meth:`unframe`.
        """
        piece = pieces.strip(b"\0")
        packet = _packet_in(piece)  # a delimiter inside is not COBS
        if isinstance(packet, str):
            return None
        self.count(len(pieces) - len(piece), 1, len(piece))
        self.at_start = False
        return packet

    def _reject(self, cause: str, size: int, *, at_start: bool) -> None:
        self._tally["partial_starts" if at_start else cause] += 1
        self._tally["skipped_bytes"] += size
