"""Recordings of gigabytes, made fast: the records that ``RecordingWriter`` writes, many at a time in numpy."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from benchmarks.sample_streams import FRAME_BYTES, frame_rows, turning
from host.recording import format as fmt
from host.recording.cdr import CDR_LITTLE_ENDIAN
from host.recording.writer import RecordingWriter

PER_READ = 10
WALL_NS, MONOTONIC_NS = 1_700_000_000 * 10**9, 10**9
_BLOCK = 200_000
"""Samples at a time: whole cycles, so that the next block goes on where this one ends."""
_MESSAGE = [
    ("opcode", "u1"),
    ("size", "<u8"),
    ("channel", "<u2"),
    ("number", "<u4"),
    ("logged", "<u8"),
    ("published", "<u8"),
    ("cdr", "<u4"),
]
_RAW = np.dtype(
    [
        *_MESSAGE,
        ("host_time_ns", "<u8"),
        ("crc32", "<u4"),
        ("kind", "u1"),
        ("spare", "V3"),
        ("length", "<u4"),
        ("data", "u1", (PER_READ * FRAME_BYTES,)),
    ]
)
_QUATERNION = np.dtype(
    [
        *_MESSAGE,
        ("seconds", "<i4"),
        ("nanoseconds", "<u4"),
        ("name_length", "<u4"),
        ("name", f"S{len(fmt.WORLD_FRAME) + 1}"),
        ("spare", f"V{(-12 - len(fmt.WORLD_FRAME) - 1) % 8}"),
        ("xyzw", "<f8", (4,)),
    ]
)
_READ = np.dtype([("raw", _RAW), ("quaternions", _QUATERNION, (PER_READ,))])
_END = b"\x0f" + (4).to_bytes(8, "little") + bytes(4) + b"\x02" + (20).to_bytes(8, "little") + bytes(20)
BYTES_A_SAMPLE = _READ.itemsize / PER_READ


def write_large(path: Path, n: int, period_us: int = 1000) -> int:
    """Write n samples, ten a read, the channel for viewers with them; return the size.

    Parameters
    ----------
    path : Path
        Must not exist.
    n : int
        A multiple of ten.
    period_us : int
        From sample to sample.
    """
    scratch = path.with_name(path.name + ".head")
    writer = RecordingWriter(scratch, "pty:/dev/pts/9", WALL_NS, MONOTONIC_NS)
    head = scratch.read_bytes()
    writer.close()
    scratch.unlink()
    channels = {topic.name: number for number, topic in enumerate(fmt.TOPICS, 1)}
    rate_hz = 1e6 / period_us
    quats = turning(_BLOCK, rate_hz, 2000 / rate_hz, drift_deg=0.0)  # a whole number of periods: no seam
    with path.open("xb") as file:
        file.write(head)
        for first in range(0, n, _BLOCK):
            count = min(_BLOCK, n - first)
            file.write(_block(quats[:count], first, period_us, channels).tobytes())
        file.write(_END + head[:8])
    return path.stat().st_size


def _block(quats: np.ndarray, first: int, period_us: int, channels: dict[str, int]) -> np.ndarray:
    count = len(quats)
    reads = np.zeros(count // PER_READ, _READ)
    number = first // PER_READ + np.arange(len(reads))
    host_ns = MONOTONIC_NS + (number + 1) * PER_READ * period_us * 1000
    raw, quaternions = reads["raw"], reads["quaternions"]
    for record, topic, dtype in ((raw, fmt.RECEIVED, _RAW), (quaternions, fmt.ORIENTATION, _QUATERNION)):
        record["opcode"] = 5
        record["size"] = dtype.itemsize - 9
        record["channel"] = channels[topic]
        record["cdr"] = int.from_bytes(CDR_LITTLE_ENDIAN, "little")
        logged = host_ns - MONOTONIC_NS + WALL_NS
        record["logged"] = record["published"] = logged if record is raw else logged[:, None]
    raw["number"] = number
    raw["host_time_ns"] = host_ns
    raw["length"] = PER_READ * FRAME_BYTES
    raw["data"] = frame_rows(quats, first, period_us).reshape(len(reads), -1)
    checked = np.concatenate(
        (
            host_ns.astype("<u8").view(np.uint8).reshape(-1, 8),
            np.zeros((len(reads), 1), np.uint8),
            raw["data"],
        ),
        axis=1,
    )
    raw["crc32"] = [zlib.crc32(row) for row in checked]
    samples = first + np.arange(count).reshape(len(reads), PER_READ)
    stamps = WALL_NS + (samples + 1) * period_us * 1000
    quaternions["number"] = samples
    quaternions["seconds"], quaternions["nanoseconds"] = stamps // 10**9, stamps % 10**9
    quaternions["name_length"] = len(fmt.WORLD_FRAME) + 1
    quaternions["name"] = fmt.WORLD_FRAME.encode()
    quaternions["xyzw"] = quats[:, [1, 2, 3, 0]].reshape(len(reads), PER_READ, 4)
    return reads
