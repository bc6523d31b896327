"""Where each field of a packet and of a CAN frame stands, from the published descriptions: the schema and the DBC."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from random import Random
from typing import TypeAlias

import cantools
from construct import Array, Bytes, Const, Construct, FormatField, Renamed, Struct

from firmware_protocol.can.dbc import SHIPPED_NODE, dbc_text
from firmware_protocol.can.mapping import NODE_BITS
from firmware_protocol.packets import PacketType
from firmware_protocol.schema import SCHEMA

HOSTILE_TEXTS = (b"\x1b[2J\x1b]0;x\x07", b"[bold]x[/]", b"\xff\xfe\xfd", "\u202eabc".encode(), b"a\0b", b"\r\n\t,;\"'")
FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-45, 1e-30, 3.4e38, -3.4e38, float("inf"), float("-inf"), float("nan"))
Number: TypeAlias = int | float


def edge_integer(rng: Random, low: int, high: int, now: int) -> int:
    """Return a value at an edge of a range, or beside the value ``now``; always within the range."""
    span = high - low + 1
    near = now + rng.choice((-1, 1)) * (
        rng.choice((1, 2, 3, 10, 100)) if rng.random() < 0.5 else 1 << rng.randrange(40)
    )
    far = rng.choice((low, low + 1, high, high - 1, low + span // 2, low + span // 2 - 1, rng.randint(low, high)))
    return low + (rng.choice((near, far)) - low) % span


@dataclass(frozen=True)
class PacketField:
    """One number or text of a packet."""

    name: str
    offset: int
    size: int
    code: str
    """Of :mod:`struct`; empty for bytes."""

    def read(self, packet: bytes | bytearray) -> Number:
        value: Number = struct.unpack_from(self.code, packet, self.offset)[0]
        return value

    def write(self, packet: bytearray, value: Number) -> None:
        struct.pack_into(self.code, packet, self.offset, value)

    def edge(self, packet: bytearray, rng: Random) -> None:
        """Give the field a value at an edge of its range, beside its own, or hostile."""
        if not self.code:
            text = rng.choice((b"", b"\xff" * self.size, rng.randbytes(self.size), *HOSTILE_TEXTS))
            packet[self.offset : self.offset + self.size] = text[: self.size].ljust(self.size, b"\0")
        elif self.code[-1] in "fd":
            self.write(packet, rng.choice(FLOATS))
        else:
            self.write(packet, edge_integer(rng, *self.limits, int(self.read(packet))))

    def shift(self, packet: bytearray, step: int) -> None:
        """Add to the field; what leaves its range wraps, as a counter does."""
        if self.code and self.code[-1] not in "fd":
            low, high = self.limits
            self.write(packet, low + (int(self.read(packet)) + step - low) % (high - low + 1))

    @property
    def limits(self) -> tuple[int, int]:
        bits = 8 * self.size
        signed = self.code[-1].islower()
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)


@cache
def packet_fields(kind: int) -> tuple[PacketField, ...]:
    """Return the fields behind the type byte of a packet; none for a type that the schema has not."""
    if kind not in set(PacketType):
        return ()
    found, offset = [], 0
    for name, leaf in _leaves(SCHEMA[PacketType(kind)], ""):
        size: int = leaf.sizeof()
        if not isinstance(leaf, Const):
            code = leaf.fmtstr if isinstance(leaf, FormatField) else ""
            assert code or isinstance(leaf, Bytes), f"a kind of field that this fuzzer does not know: {leaf}"
            found.append(PacketField(name, offset, size, code))
        offset += size
    return tuple(found)


def _leaves(part: Construct, name: str) -> Iterator[tuple[str, Construct]]:
    if isinstance(part, Renamed):
        yield from _leaves(part.subcon, f"{name}.{part.name}" if name else part.name)
    elif isinstance(part, Struct):
        for each in part.subcons:
            yield from _leaves(each, name)
    elif isinstance(part, Array):
        for number in range(part.count):
            yield from _leaves(part.subcon, f"{name}[{number}]")
    else:
        yield name, part


@dataclass(frozen=True)
class FrameField:
    """One signal of a classic CAN frame, little endian."""

    name: str
    start: int
    length: int
    selector: tuple[FrameField, int] | None = None
    """Where the signal is only in some of the frames: another signal, and the value that it has there."""

    def is_in(self, data: bytes) -> bool:
        """Return whether a frame with this data has the signal."""
        return self.selector is None or self.selector[0].read(data) == self.selector[1]

    def read(self, data: bytes) -> int:
        return int.from_bytes(data, "little") >> self.start & (1 << self.length) - 1

    def write(self, data: bytes, value: int) -> bytes:
        mask = (1 << self.length) - 1 << self.start
        whole = int.from_bytes(data, "little") & ~mask | (value << self.start) & mask
        return (whole & (1 << 8 * len(data)) - 1).to_bytes(len(data), "little")

    def edge(self, data: bytes, rng: Random) -> bytes:
        """Return the data with this signal at an edge of its range, or beside its own value."""
        return self.write(data, edge_integer(rng, 0, (1 << self.length) - 1, self.read(data)))

    def shift(self, data: bytes, step: int) -> bytes:
        """Return the data with this added to the signal, which wraps."""
        return self.write(data, (self.read(data) + step) & (1 << self.length) - 1)


@cache
def frame_fields() -> dict[int, tuple[FrameField, ...]]:
    """Return the signals of each frame by the upper bits of its id: whole-packet bit and function."""
    found = {}
    for message in cantools.database.load_string(dbc_text(), "dbc").messages:
        assert all(signal.byte_order == "little_endian" for signal in message.signals), message.name
        plain = {item.name: FrameField(item.name, item.start, item.length) for item in message.signals}
        found[(message.frame_id - SHIPPED_NODE) >> NODE_BITS] = tuple(
            replace(plain[item.name], selector=(plain[item.multiplexer_signal], item.multiplexer_ids[0]))
            if item.multiplexer_ids
            else plain[item.name]
            for item in message.signals
        )
    return found
