"""Serial streams of any length, made fast: the same bytes that ``encode_frame`` gives, column by column in numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from firmware_protocol import codec
from firmware_protocol.packets import Ack, Event, EventKind, PacketType, RawImu, Status, TimeReply
from firmware_protocol.serial.framing import encode_frame

FRAME_BYTES = 21
"""One ORIENTATION frame with both delimiters."""
_PACKET = np.dtype([("kind", "u1"), ("sequence", "<u2"), ("time", "<u4"), ("q", "<i2", (4,)), ("flags", "u1")])


@dataclass(frozen=True, eq=False)
class Stream:
    """Bytes of a link, and what went in."""

    data: bytes
    n_samples: int
    """Samples that can be received: those of undamaged frames."""


def turning(n: int, rate_hz: float = 1000.0, period_s: float = 2.0, drift_deg: float = 0.3) -> npt.NDArray[np.float64]:
    """Orientations (n, 4) of an object that is turned to and fro by 60 degrees, and creeps."""
    time_s = np.arange(n) / rate_hz
    half = np.radians(30.0 * (1.0 - np.cos(2 * np.pi * time_s / period_s)) + drift_deg * time_s / period_s) / 2
    wobble = 0.02 * np.sin(2 * np.pi * time_s / period_s + 1.0)
    axis = np.stack([wobble, 0.1 + wobble, np.ones(n)], axis=1)
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    return np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None] * axis], axis=1)


def _crc_table() -> npt.NDArray[np.uint16]:
    table = np.arange(256, dtype=np.uint16) << 8
    for _ in range(8):
        table = np.where(table & 0x8000, (table << 1) ^ 0x1021, table << 1).astype(np.uint16)
    return table


def frame_rows(quats_wxyz: npt.NDArray[np.float64], first: int = 0, period_us: int = 1000) -> npt.NDArray[np.uint8]:
    """Frames (n, 21) of orientations (n, 4), numbered and timed from ``first`` on."""
    n = len(quats_wxyz)
    number = np.arange(first, first + n, dtype=np.int64)
    packets = np.zeros(n, _PACKET)
    packets["kind"] = PacketType.ORIENTATION
    packets["sequence"] = number & 0xFFFF
    packets["time"] = (number * period_us) & 0xFFFFFFFF
    packets["q"] = np.rint(quats_wxyz * 32767)
    packets["flags"] = 8
    content = np.zeros((n, 18), np.uint8)
    content[:, :16] = packets.view(np.uint8).reshape(n, 16)
    table = _crc_table()
    crc = np.full(n, 0xFFFF, np.uint16)
    for column in range(16):
        crc = (crc << 8) ^ table[(crc >> 8) ^ content[:, column]]
    content[:, 16], content[:, 17] = crc & 0xFF, crc >> 8
    rows = np.zeros((n, FRAME_BYTES), np.uint8)
    code = np.ones(n, np.uint8)
    for column in range(17, -1, -1):
        zero = content[:, column] == 0
        rows[:, column + 2] = np.where(zero, code, content[:, column])
        code = np.where(zero, 1, code + 1).astype(np.uint8)
    rows[:, 1] = code
    return rows


def clean_stream(n: int, rate_hz: float = 1000.0) -> Stream:
    """Return n samples and nothing else."""
    return Stream(frame_rows(turning(n, rate_hz), period_us=round(1e6 / rate_hz)).tobytes(), n)


def other_frames() -> list[bytes]:
    """Frames of other packets, one of each kind that a streaming object sends."""
    packets = (
        Status(5_000_000, temperature_c=21.5),
        RawImu(3, 4, (1.0, 2.0, 3.0), (0.0, 0.0, 1.0)),
        Ack(0x82, 9),
        TimeReply(1, 2, 3),
        Event(5, EventKind.BUTTON),
    )
    return [encode_frame(codec.encode_packet(packet)) for packet in packets]


def mixed_stream(n: int, damaged_share: float = 0.01, other_share: float = 0.02, seed: int = 1) -> Stream:
    """Return n samples, some frames damaged in one byte, other packets among them."""
    rng = np.random.default_rng(seed)
    rows = frame_rows(turning(n))
    hit = rng.choice(n, round(n * damaged_share), replace=False)
    rows[hit, rng.integers(1, 20, len(hit))] ^= rng.integers(1, 256, len(hit), dtype=np.uint8)
    places = np.sort(rng.choice(n, round(n * other_share), replace=False)).tolist()
    data = rows.tobytes()
    others = other_frames()
    parts: list[bytes] = []
    start = 0
    for count, place in enumerate(places):
        parts += (data[start : place * FRAME_BYTES], others[count % len(others)])
        start = place * FRAME_BYTES
    parts.append(data[start:])
    return Stream(b"".join(parts), n - len(hit))
