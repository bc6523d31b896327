"""Serial streams for tests, and a slow decoder of them that shares nothing with the fast ones.

The oracle splits with ``bytes.split``, undoes COBS by its definition, computes the CRC bit by bit, and parses with
construct. :mod:`tests.sequence_oracle` follows the sequence, for both.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

from firmware_protocol import codec, schema
from firmware_protocol.errors import MalformedPacketError
from firmware_protocol.items import ForeignInfo
from firmware_protocol.packets import (
    Ack,
    Event,
    EventKind,
    Info,
    InternalWeight,
    ObjectCard,
    Orientation,
    OrientationBatch,
    OrientationFlag,
    PacketType,
    RawImu,
    Status,
    TimeReply,
)
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import encode_frame
from tests.sequence_oracle import counted, followed

LONGEST_PIECE = 255


def random_unit(rng: random.Random) -> tuple[float, float, float, float]:
    q = [rng.gauss(0.0, 1.0) for _ in range(4)]
    norm = math.hypot(*q)
    return tuple(component / norm for component in q)


def orientation(sequence: int, rng: random.Random) -> Orientation:
    return Orientation(sequence % 65536, sequence * 1000 % 2**32, random_unit(rng), OrientationFlag(rng.randrange(16)))


def frame(packet) -> bytes:
    return encode_frame(codec.encode_packet(packet))


def other_packets(boot_id: int = 7) -> list:
    card = ObjectCard(weights=(InternalWeight(1, 2.5),), surface="PLA")
    return [
        Info(1, boot_id, name="cube", card=card),
        Status(5_000_000, temperature_c=21.5),
        RawImu(3, 4, (1.0, 2.0, 3.0), (0.0, 0.0, 1.0)),
        Ack(0x82, 9),
        TimeReply(1, 2, 3),
        Event(5, EventKind.BUTTON),
    ]


def odd_frames() -> list[bytes]:
    """Frames with the right checksum that are no packet of this version, or a longer one."""
    sample = codec.encode_packet(Orientation(1, 2, (1.0, 0.0, 0.0, 0.0)))
    packets = [
        b"\x08\x02" + sample[2:],  # unknown, a good sample but for its type
        b"\x7f",
        b"\x01\x02\x00",  # INFO of another major version
        b"\x02" + bytes(15),  # norm 0
        b"\x02" + bytes(6) + b"\xff\x7f\xff\x7f" + bytes(5),  # norm 1.41
        b"\x02\x01\x02",  # cut short before it was framed
        b"\x03" + bytes(8) + b"\x09" + bytes(24),  # a state that is none
        sample + b"new",
        codec.encode_packet(Status(1)) + b"\0\0",
    ]
    return [encode_frame(packet) for packet in packets]


@dataclass
class Decoded:
    """Everything a stream held: samples and packets in order, and what was counted."""

    items: list = field(default_factory=list)
    counted: Counter = field(default_factory=Counter)

    def count(self, name: str, n: int = 1) -> None:
        self.counted[name] += n

    def plain(self) -> dict:
        return {name: n for name, n in self.counted.items() if n}


def decode_fast(data: bytes, chunks: list[int] | None = None, decoder: StreamDecoder | None = None) -> Decoded:
    """Through :class:`StreamDecoder`, cut at the given places."""
    decoder = decoder or StreamDecoder()
    result = Decoded()
    edges = [0, *sorted(chunks or []), len(data)]
    items = [item for start, end in pairwise(edges) for item in decoder.feed(data[start:end])]
    result.counted.update(counted(items))
    for item in items:
        if isinstance(item, OrientationBatch):
            assert len(item) > 0
            columns = (item.sequence, item.device_time_us, item.quats_wxyz, item.flags)
            assert [str(column.dtype) for column in columns] == ["uint16", "uint32", "float64", "uint8"]
            result.items += [
                ("sample", sequence, time, tuple(q), flags)
                for sequence, time, q, flags in zip(*(column.tolist() for column in columns), strict=True)
            ]
        else:
            result.items.append(repr(item))
    for name, value in vars(decoder.counters).items():
        if name == "packets":
            result.counted.update({f"packets {packet_type.name}": n for packet_type, n in value.items()})
        else:
            result.count(name, value)
    return result


def slow_crc(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def slow_uncobs(piece: bytes) -> bytes | None:
    data = bytearray()
    at = 0
    while at < len(piece):
        code = piece[at]
        if at + code > len(piece):
            return None
        data += piece[at + 1 : at + code]
        at += code
        if code < 255 and at < len(piece):
            data.append(0)
    return bytes(data)


def decode_slowly(data: bytes) -> Decoded:
    """The oracle."""
    result = Decoded()
    *pieces, pending = data.split(b"\0")
    result.count("bytes", len(data))
    result.count("delimiters", len(pieces))
    if len(pending) > LONGEST_PIECE:
        result.count("oversize" if pieces else "partial_starts")
        result.count("skipped_bytes", len(pending))
    else:
        result.count("pending_bytes", len(pending))
    boot_id = None
    sequences: list[int | None] = []
    for number, piece in enumerate(pieces):
        if not piece:
            continue
        content = slow_uncobs(piece)
        cause = None
        if len(piece) > LONGEST_PIECE:
            cause = "oversize"
        elif content is None:
            cause = "cobs_errors"
        elif len(content) < 2 or slow_crc(content[:-2]) != content[-2] + 256 * content[-1]:
            cause = "crc_errors"
        if cause:
            result.count(cause if number else "partial_starts")
            result.count("skipped_bytes", len(piece))
            continue
        result.count("frames")
        result.count("frame_bytes", len(piece))
        packet = content[:-2]
        item = _interpret(packet, result)
        if item is None:
            continue
        result.items.append(item)
        if isinstance(item, tuple):
            sequences.append(item[1])
        elif packet[0] == PacketType.INFO and item.startswith("Info"):
            if boot_id not in (None, packet[11:15]):
                sequences.append(None)
            boot_id = packet[11:15]
    result.counted.update(followed(sequences))
    return result


def _interpret(packet: bytes, result: Decoded):
    if not packet:
        result.count("malformed")
        return None
    if packet[0] not in set(PacketType):
        result.count("unknown_types")
        return None
    packet_type = PacketType(packet[0])
    if packet_type is PacketType.INFO and len(packet) > 2 and packet[1] != 1:
        result.count("unsupported_versions")
        return repr(ForeignInfo(packet[1], packet[2]))
    if packet_type is PacketType.ORIENTATION:
        if len(packet) < 16:
            result.count("malformed")
            return None
        container = schema.SCHEMA[packet_type].parse(packet)
        norm = math.hypot(*container.q_wxyz)
        if abs(norm / 32767 - 1.0) > 1e-2:
            result.count("malformed")
            return None
        quat = tuple(component * (1.0 / norm) for component in container.q_wxyz)
        item = ("sample", container.sequence, container.device_time_us, quat, container.flags)
    else:
        try:
            item = repr(codec.decode_packet(packet))
        except MalformedPacketError:
            result.count("malformed")
            return None
    result.count(f"packets {packet_type.name}")
    result.count("extended", len(packet) > schema.PACKET_BYTES[packet_type])
    return item


def assert_same(fast: Decoded, slow: Decoded) -> None:
    """Same samples and packets in the same order, same counters; quaternions to a rounding."""
    assert fast.plain() == slow.plain()
    assert len(fast.items) == len(slow.items)
    for got, expected in zip(fast.items, slow.items, strict=True):
        if isinstance(expected, tuple):
            assert got[:3] == expected[:3]
            assert got[4] == expected[4]
            assert max(abs(a - b) for a, b in zip(got[3], expected[3], strict=True)) < 4e-16
        else:
            assert got == expected


def assert_accounted(counted: Counter) -> None:
    """The two identities of framing, and the one of the stream."""
    parts = ("delimiters", "frame_bytes", "skipped_bytes", "pending_bytes")
    assert counted["bytes"] == sum(counted[name] for name in parts)
    packets = sum(n for name, n in counted.items() if name.startswith("packets "))
    assert counted["frames"] == packets + sum(
        counted[name] for name in ("malformed", "unknown_types", "unsupported_versions")
    )
