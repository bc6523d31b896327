"""Recovery: time per byte of the worst files, found by thinking and by search, from 1 to 100 MB."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random

from benchmarks.growth import FLAT
from benchmarks.measurement import COST, Curve, Topic, cpu_s, figure
from benchmarks.sample_streams import FRAME_BYTES, frame_rows, turning
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Event, EventKind
from firmware_protocol.serial.framing import encode_frame
from host.errors import FileError
from host.links.transport import Chunk
from host.recording import format as fmt
from host.recording.cdr import CDR_LITTLE_ENDIAN
from host.recording.recovery import LONGEST_RAW_BYTES, MAX_CHECKED_BYTES, recover

SEARCHED_BYTES = 200_000
"""Each file that the search tries; short ones, so that it tries many."""
SEARCHED = 200
PERIOD_US = 5000
_BLOCK = 1 << 16
LARGEST = 2
"""Of so many, the dearest, there is a file of 100 MB."""


def raw_heads(period: int, claim: int) -> bytes:
    """Return heads of raw messages so close that each stands in the middle of the one before, all of some length."""
    pattern = bytearray(max(period, 8))
    pattern[:8] = CDR_LITTLE_ENDIAN + struct.pack("<I", claim)
    return bytes(pattern)


def record_heads(period: int, claim: int) -> bytes:
    """Return the head of a record of a note, wrapped around in ``period`` bytes, and of the message behind it."""
    pattern = bytearray(period)
    pattern[:4] = CDR_LITTLE_ENDIAN
    channel = next(number for number, topic in enumerate(fmt.TOPICS, start=1) if topic.name == fmt.NOTE)
    for place, byte in enumerate(struct.pack("<BQH", 5, claim + 22, channel), start=-31):
        pattern[place % period] = byte
    return bytes(pattern)


def metadata(length: int) -> bytes:
    """Return a description that is an entry of the one before."""
    name = struct.pack("<I", len(fmt.METADATA_NAME)) + fmt.METADATA_NAME.encode()
    return struct.pack("<I", len(name) + 4) + name + struct.pack("<I", length) + bytes(4)


def worst_patterns() -> dict[str, bytes]:
    """Return what is repeated in each file that is worst by thinking, by what the search has to do for it."""
    longest = LONGEST_RAW_BYTES - fmt.RAW_HEAD_BYTES
    event = encode_frame(encode_packet(Event(0, EventKind.BUTTON, 1)))
    return {
        "a head every 4 bytes": CDR_LITTLE_ENDIAN,
        "a head every 8 bytes, the longest claims": raw_heads(8, longest),
        "a head every 24 bytes, claims of 1 MB": raw_heads(24, 10**6),
        "records of notes every 18 bytes, the longest claims": record_heads(18, MAX_CHECKED_BYTES),
        "records of notes every 36 bytes, the longest claims": record_heads(36, MAX_CHECKED_BYTES),
        "descriptions in descriptions": metadata(65_000),
        "whole messages without data": fmt.encode_raw(Chunk(b"", 10**9)),
        "whole messages of one byte": fmt.encode_raw(Chunk(b"\0", 10**9)),
        "whole commands of one byte": fmt.encode_raw(Chunk(b"\0", 10**9), sent=True),
        "whole messages of one event": fmt.encode_raw(Chunk(event, 10**9)),
        "whole messages of a thousand events": fmt.encode_raw(Chunk(event * 1000, 10**9)),
        "whole notes": _record(fmt.TYPES[fmt.NOTE].encode({"kind": "", "text": ""})),
    }


def random_pattern(random: Random) -> bytes:
    """Return a few pieces of a recording in any order: what the search for a worst file tries."""
    pieces = [
        CDR_LITTLE_ENDIAN,
        raw_heads(random.randrange(8, 32), random.choice([0, 1, 256, 65_000, LONGEST_RAW_BYTES])),
        record_heads(random.choice([18, 31, 35, 36, 40, 60]), random.choice([8, 256, 4096, MAX_CHECKED_BYTES])),
        metadata(random.randrange(100_000)),
        fmt.encode_raw(Chunk(random.randbytes(random.randrange(4)), 10**9), sent=random.random() < 0.5),
        _record(fmt.TYPES[fmt.NOTE].encode({"kind": "", "text": "x" * random.randrange(9)})),
        bytes(random.randrange(1, 9)),
        random.randbytes(random.randrange(1, 9)),
    ]
    return b"".join(random.choice(pieces) for _ in range(random.randrange(1, 6)))


def repeated(pattern: bytes, n_bytes: int) -> bytes:
    """Return a file of so many bytes."""
    return (pattern * (n_bytes // len(pattern) + 1))[:n_bytes]


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic("Recovery of the worst files")
    random = Random(11)
    tried = [random_pattern(random) for _ in range(SEARCHED)]
    found = [(_cost(repeated(pattern, SEARCHED_BYTES)), pattern) for pattern in tried]
    patterns = worst_patterns()
    for rank, (_, pattern) in enumerate(sorted(found, reverse=True)[:2], start=1):
        patterns[f"worst of {SEARCHED} by search, {rank}"] = pattern
    files: dict[str, Callable[[int], bytes]] = {name: partial(repeated, pattern) for name, pattern in patterns.items()}
    files["whole messages of one sample, in order"] = faultless
    costs = {name: [_cost(content(10**6))] for name, content in files.items()}
    if not quick:
        for name, content in files.items():
            costs[name].append(_cost(content(10**7)))
        for name in sorted(costs, key=lambda name: -costs[name][1])[:LARGEST]:
            costs[name].append(_cost(files[name](10**8)))
    for name, cost in costs.items():
        each = ", ".join(f"{10**power} MB: {value:.2g}" for power, value in enumerate(cost))
        topic.rows.append(figure(name, cost, "µs/byte", each))
        sizes = tuple(10.0**power for power in range(6, 6 + len(cost)))
        topic.curves.append(Curve(name, "bytes", "µs/byte", sizes, tuple(cost)))
    worst = max(max(cost) for cost in costs.values())
    topic.rows.append(figure("the worst of all", [worst], "µs/byte"))
    # What costs next to nothing varies with what else the machine does.
    dear = (cost for cost in costs.values() if max(cost) > worst / 100)
    rise = max(later / min(cost[: k + 1]) for cost in dear for k, later in enumerate(cost))
    topic.rows.append(figure("largest µs/byte over the least of a shorter file", [rise], "×", "", FLAT, COST))
    return topic


def _cost(content: bytes) -> float:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "worst.mcap"
        path.write_bytes(content)
        return 1e6 * cpu_s(lambda: _recovered(path)) / len(content)


def _recovered(path: Path) -> None:
    try:
        recover(path, path.with_name("clean.mcap"))
    except FileError as error:
        assert "no whole record" in str(error), error  # noqa: PT017 - the only error that such a file may give


def faultless(n_bytes: int) -> bytes:
    """Return whole messages of one sample each, all in order: what costs most to copy, as all of it is decoded."""
    size = len(fmt.encode_raw(Chunk(bytes(FRAME_BYTES), 0)))
    quats, content = turning(_BLOCK), bytearray()
    for first in range(0, n_bytes // size, _BLOCK):
        rows = frame_rows(quats, first, PERIOD_US)
        times_ns = range(10**9 + first * PERIOD_US * 1000, 2**63, PERIOD_US * 1000)
        content += b"".join(fmt.encode_raw(Chunk(row.tobytes(), at)) for row, at in zip(rows, times_ns, strict=False))
    return bytes(content[:n_bytes])


def _record(message: bytes) -> bytes:
    channel = next(number for number, topic in enumerate(fmt.TOPICS, start=1) if topic.name == fmt.NOTE)
    return struct.pack("<BQHIQQ", 5, len(message) + 22, channel, 0, 0, 0) + message
