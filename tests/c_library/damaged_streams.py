"""``python -m tests.c_library.damaged_streams --streams 100000``: Python's decoder and the C receiver on damage.

Both must return the same packets, in the same order, and the same counters for every stream.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterable

from firmware_protocol import codec
from firmware_protocol.items import ForeignInfo
from firmware_protocol.packets import Info, Orientation
from firmware_protocol.serial.framing import encode_frame
from tests.c_library.build import Driver, MissingToolError, host_driver
from tests.wire_streams import Decoded, decode_fast, frame, odd_frames, orientation, other_packets

BATCH = 2000
"""Streams that the C program receives at once."""
DAMAGE = ("flip", "byte", "zero", "lose", "insert", "cut", "repeat", "swap", "text", "long", "odd", "jump", "reboot")


class Streams:
    """Damaged streams, the same for the same seed: a few frames each, hit in every way a line can hit them."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self._others = [frame(packet) for packet in other_packets()]
        self._odd = odd_frames()
        self._pool = [codec.encode_packet(orientation(0, self._rng)) for _ in range(500)]
        self.kinds: Counter[str] = Counter()

    def next(self) -> bytes:
        """Return the next stream."""
        rng = self._rng
        sequence = rng.choice((rng.randrange(65536), 65530, 0))
        frames = []
        for _ in range(rng.randrange(1, 14)):
            sample = rng.choice(self._pool)
            frames.append(encode_frame(sample[:1] + (sequence & 0xFFFF).to_bytes(2, "little") + sample[3:]))
            sequence += 1
            if rng.random() < 0.15:
                frames.append(rng.choice(self._others))
        for _ in range(rng.randrange(5)):
            kind = rng.choice(DAMAGE)
            self.kinds[kind] += 1
            self._hit(frames, kind)
        data = b"".join(frames)
        return data[rng.randrange(30) :] if rng.random() < 0.3 else data

    def _hit(self, frames: list[bytes], kind: str) -> None:
        rng = self._rng
        number = rng.randrange(len(frames))
        piece = bytearray(frames[number])
        at = rng.randrange(len(piece)) if piece else 0
        if kind == "flip" and piece:
            piece[at] ^= 1 << rng.randrange(8)
        elif kind == "byte" and piece:
            piece[at] = rng.randrange(256)
        elif kind == "zero":
            piece[at : at + 1] = b"\0"
        elif kind == "lose":
            del piece[at : at + rng.randrange(1, 8)]
        elif kind == "insert":
            piece[at:at] = rng.randbytes(rng.randrange(1, 12))
        elif kind == "cut":
            del piece[at:]
        elif kind == "repeat":
            frames.insert(number, bytes(piece))
            return
        elif kind == "swap":
            frames[number], frames[-1] = frames[-1], frames[number]
            return
        elif kind == "text":
            piece += b"boot ok\r\n"
        elif kind == "long":
            piece[at:at] = bytes(rng.randrange(1, 256) for _ in range(rng.choice((250, 254, 255, 256, 257, 600))))
        elif kind == "odd":
            piece += rng.choice(self._odd)
        elif kind == "jump":
            new = orientation(rng.randrange(65536), rng)
            piece += frame(new)
        elif kind == "reboot":
            piece += frame(Info(1, rng.choice((7, 8)), name="cube"))
        frames[number] = bytes(piece)


def decoded_by_c(answer: str) -> Decoded:
    """Return what the C program made of one stream, in the form of :func:`decode_fast`."""
    result = Decoded()
    packets, _, counters = answer.partition("|")
    for word in packets.split():
        if word.startswith("v"):
            major, minor = word[1:].split(".")
            result.items.append(repr(ForeignInfo(int(major), int(minor))))
            continue
        packet = codec.decode_packet(bytes.fromhex(word))
        result.count(f"packets {packet.packet_type.name}")
        if isinstance(packet, Orientation):
            result.items.append(("sample", packet.sequence, packet.device_time_us, packet.q_wxyz, int(packet.flags)))
        else:
            result.items.append(repr(packet))
    for name, value in (word.split("=") for word in counters.split()):
        result.count(name, int(value))
    delivered = sum(n for name, n in result.counted.items() if name.startswith("packets "))
    assert result.counted.pop("packets") == delivered
    return result


def compare(driver: Driver, streams: Iterable[bytes], seed: int = 1) -> Counter[str]:
    """Decode streams by both, Python's cut in chunks anywhere; return the counters, summed.

    Raises
    ------
    AssertionError
        They differ; the message holds the stream.
    """
    rng = random.Random(seed)
    data = list(streams)
    met: Counter[str] = Counter()
    for stream, answer in zip(data, driver.ask(f"stream {stream.hex()}" for stream in data), strict=True):
        ours = decode_fast(stream, sorted(rng.randrange(len(stream) + 1) for _ in range(rng.randrange(4))))
        theirs = decoded_by_c(answer)
        assert ours.items == theirs.items, stream.hex()
        assert ours.plain() == theirs.plain(), stream.hex()
        met.update(ours.counted)
    return met


def main() -> int:
    """Run; 1 where both differ."""
    parser = argparse.ArgumentParser(prog="python -m tests.c_library.damaged_streams", description=__doc__)
    parser.add_argument("--streams", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    try:
        driver = host_driver()
    except MissingToolError as error:
        print(error, file=sys.stderr)
        return 2
    started, source = time.monotonic(), Streams(args.seed)
    met: Counter[str] = Counter()
    for first in range(0, args.streams, BATCH):
        count = min(BATCH, args.streams - first)
        met += compare(driver, (source.next() for _ in range(count)), args.seed + first)
    print(f"{args.streams} streams, seed {args.seed}: same packets, same counters ({time.monotonic() - started:.0f} s)")
    print("damage: " + ", ".join(f"{kind} {source.kinds[kind]}" for kind in DAMAGE))
    print("counted: " + ", ".join(f"{name} {n}" for name, n in sorted(met.items()) if n))
    return 0


if __name__ == "__main__":
    sys.exit(main())
