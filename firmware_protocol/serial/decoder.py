"""Bytes of a serial link in, packets out: the way every host reads.

``StreamDecoder`` joins framing and packet codec. Every frame counts once::

    frames = sum of packets + malformed + unknown_types + unsupported_versions
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterable, Sequence
from math import sqrt
from types import MappingProxyType

import numpy as np

from firmware_protocol import codec
from firmware_protocol.items import ForeignInfo, LocatedPackets, StreamCounters, StreamItem, Tally, decode_counted
from firmware_protocol.packets import Command, Orientation, OrientationBatch, Packet, PacketType
from firmware_protocol.quantization import Q15_MAX_SQUARE, Q15_MIN_SQUARE
from firmware_protocol.serial.batch import (
    ORIENTATION_BYTES,
    SHORTEST_PIECE,
    SampleArrays,
    block_end,
    decode_block,
    new_batch,
)
from firmware_protocol.serial.framing import LONE_FRAME_OVERHEAD, MAX_PIECE_BYTES, FrameDecoder, encode_frame

BATCH_BYTES = 2730
"""A feed that completes at least so many bytes of pieces decodes them together, else one by one.

Measured: at 130 ORIENTATION frames both are as fast.
"""


# Bound once: the live path handles a few frames per read, and looking names up is a good part of its cost.
_ORIENTATION = int(PacketType.ORIENTATION)
_SAMPLE_FIELDS = codec.FIELDS[_ORIENTATION]
_UINT8, _UINT16, _UINT32 = np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.uint32)
_LONE_BYTES = ORIENTATION_BYTES + LONE_FRAME_OVERHEAD
# One allocation for the four arrays of a sample that comes alone, without padding, widest first.
_LONE_LAYOUT = struct.Struct("<4dIHB").pack
_LONE_DTYPE = np.dtype(
    {"names": ["q", "time", "sequence", "flags"], "formats": [("<f8", (4,)), "<u4", "<u2", "u1"], "itemsize": 39}
)


def encode_command(command: Command) -> bytes:
    """Return the frame of a command.

    Raises
    ------
    PacketValueError
        A value does not fit its field.
    """
    return encode_frame(codec.encode_packet(command))


class StreamDecoder:
    """Turn the bytes of one link into packets, in wire order, however they are cut into chunks.

    ``feed`` never blocks and never raises on bytes from the wire. The packets and counters after n bytes depend on
    these bytes alone; only where one :class:`OrientationBatch` ends and the next starts depends on the chunks.
    Duplicates and late samples are delivered as they came.
    """

    def __init__(self) -> None:
        self._frames = FrameDecoder()
        self._tally: Tally = Tally()
        self._samples = 0  # ORIENTATION packets
        self._others: Counter[PacketType] = Counter()  # all other packets
        self._damage: list[int] = []

    @property
    def counters(self) -> StreamCounters:
        """Snapshot of the counters."""
        packets = dict(self._others) | ({PacketType.ORIENTATION: self._samples} if self._samples else {})
        return StreamCounters(**vars(self._frames.counters), **self._tally, packets=MappingProxyType(packets))

    def restart(self) -> None:
        """Start again after the link was cut: bytes pending are skipped. The counters go on."""
        self._frames.restart()

    def take_damage(self) -> list[int]:
        """Return where damaged frames came since the last call: how many samples were delivered before each, ascending.

        Counted from the decoder's first sample. Malformed packets are among them; oversize pieces and partial starts
        are not, because no frame is like that. A piece as long as several samples is listed as often.
        """
        damage, self._damage = self._damage, []
        return damage

    def flush(self) -> list[StreamItem]:
        """Return what is still held: nothing, for a packet is delivered as soon as its frame is whole."""
        return []

    def feed(self, data: bytes) -> list[StreamItem]:
        """Process what one read returned; return what it completed, in wire order.

        ORIENTATION packets with nothing else between them come as one :class:`OrientationBatch`.
        """
        pieces = self._frames.complete(data)
        if not pieces:
            return []
        if _LONE_BYTES - 1 <= len(pieces) <= _LONE_BYTES + 1:  # one or two delimiters before it or behind
            packet = self._frames.open_lone(pieces)
            if packet is not None:
                return self._feed_lone(packet)
        if len(pieces) < BATCH_BYTES:
            return self._feed_few(self._frames.unframe(pieces))
        return self._feed_many(pieces).items()

    def feed_located(self, data: bytes) -> LocatedPackets:
        """Process many reads put end to end; return what they completed, and where each packet of it ends.

        Packets and counters are those of :meth:`feed`. Where a packet's delimiter stands in ``data`` shows which of
        the reads completed it.

        Parameters
        ----------
        data : bytes
            Of any length; below some thousand bytes :meth:`feed` is faster.
        """
        offset = self._frames.offset_of_next(data)
        return self._feed_many(self._frames.complete(data), offset, located=True)

    def _feed_lone(self, packet: bytes) -> list[StreamItem]:
        """Decode a packet that came alone, mostly ORIENTATION: what a live read brings."""
        if len(packet) == ORIENTATION_BYTES and packet[0] == _ORIENTATION:
            sequence, device_time_us, w, x, y, z, flag = _SAMPLE_FIELDS(packet, 1)
            square = w * w + x * x + y * y + z * z
            if Q15_MIN_SQUARE <= square <= Q15_MAX_SQUARE:
                self._samples += 1
                scale = 1.0 / sqrt(square)
                values = _LONE_LAYOUT(w * scale, x * scale, y * scale, z * scale, device_time_us, sequence, flag)
                sample = np.ndarray(1, _LONE_DTYPE, bytearray(values))
                return [new_batch(sample["sequence"], sample["time"], sample["q"], sample["flags"])]
        return self._feed_few([packet])

    def _feed_few(self, packets: Sequence[bytes | int]) -> list[StreamItem]:
        items: list[StreamItem] = []
        sequences: list[int] = []
        times_us: list[int] = []
        components: list[float] = []
        flags: list[int] = []
        for data in packets:
            if isinstance(data, int):
                self._note_damaged(self._samples + len(sequences), data)
                continue
            if len(data) >= ORIENTATION_BYTES and data[0] == _ORIENTATION:
                sequence, device_time_us, w, x, y, z, flag = _SAMPLE_FIELDS(data, 1)
                square = w * w + x * x + y * y + z * z
                if Q15_MIN_SQUARE <= square <= Q15_MAX_SQUARE:
                    scale = 1.0 / sqrt(square)
                    sequences.append(sequence)
                    times_us.append(device_time_us)
                    components += (w * scale, x * scale, y * scale, z * scale)
                    flags.append(flag)
                    if len(data) > ORIENTATION_BYTES:
                        self._tally["extended"] += 1
                else:
                    self._tally["malformed"] += 1
                    self._damage.append(self._samples + len(sequences))
                continue
            item = self._decode(data, self._samples + len(sequences))
            if item is not None:
                if sequences:
                    items.append(self._batch(sequences, times_us, components, flags))
                    sequences, times_us, components, flags = [], [], [], []
                items.append(item)
        if sequences:
            items.append(self._batch(sequences, times_us, components, flags))
        return items

    def _batch(
        self, sequences: list[int], times_us: list[int], components: list[float], flags: list[int]
    ) -> OrientationBatch:
        self._samples += len(sequences)
        return new_batch(
            np.array(sequences, _UINT16),
            np.array(times_us, _UINT32),
            np.array(components).reshape(-1, 4),
            np.array(flags, _UINT8),
        )

    def _feed_many(self, pieces: bytes, offset: int = 0, *, located: bool = False) -> LocatedPackets:
        """Decode pieces, which start at ``offset`` of what the places of their packets are counted from."""
        samples = SampleArrays(len(pieces), located=located)
        placed: list[tuple[int, Packet | ForeignInfo, int]] = []
        start = 0
        if self._frames.at_start and pieces:  # what may be the rest of a frame counts differently
            start = pieces.index(b"\0") + 1
            packets = [(0, packet, offset + start - 1) for packet in self._frames.unframe(pieces[:start])]
            self._place(samples, placed, packets)
        view = memoryview(pieces)
        while start < len(pieces):
            end = block_end(pieces, start)
            report = decode_block(view[start:end], samples, offset + start)
            start = end
            self._frames.count(report.delimiters, report.frames, report.frame_bytes)
            self._tally["extended"] += report.extended
            others = []
            for position, piece, at in report.others:
                packet = self._frames.open_piece(piece)
                if packet is not None or len(piece) <= MAX_PIECE_BYTES:
                    others.append((position, len(piece) if packet is None else packet, at))
            self._place(samples, placed, others)
        self._samples += samples.n
        ends = None if samples.ends is None else samples.ends[: samples.n]
        return LocatedPackets(samples.batch(), ends, placed)

    def _place(
        self,
        samples: SampleArrays,
        placed: list[tuple[int, Packet | ForeignInfo, int]],
        packets: Iterable[tuple[int, bytes | int, int]],
    ) -> None:
        """Decode packets that stand among the samples: samples go in between, the others to ``placed``."""
        positions: list[int] = []
        late: list[Orientation] = []
        ends: list[int] = []
        for position, data, at in packets:
            before = self._samples + position + len(late)
            if isinstance(data, int):
                self._note_damaged(before, data)
                continue
            item = self._decode(data, before)
            if isinstance(item, Orientation):
                positions.append(position)
                late.append(item)
                ends.append(at)
            elif item is not None:
                placed.append((position + len(late), item, at))
        if late:
            samples.insert(positions, late, ends)

    def _note_damaged(self, n_before: int, size: int) -> None:
        """Note a damaged piece: where delimiters are hit, it may be several samples."""
        self._damage += [n_before] * max(1, size // SHORTEST_PIECE)

    def _decode(self, data: bytes, n_before: int) -> Packet | ForeignInfo | None:
        """Decode and count one packet, with ``n_before`` samples before it; ORIENTATION is counted elsewhere."""
        malformed = self._tally["malformed"]
        item = decode_counted(data, self._tally)
        if item is None:
            if self._tally["malformed"] > malformed:
                self._damage.append(n_before)
        elif not isinstance(item, (Orientation, ForeignInfo)):
            self._others[item.packet_type] += 1
        return item
