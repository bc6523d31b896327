"""What people would use instead, each on its own format: messages in, samples in Python out."""

from __future__ import annotations

import os
import struct
import tempfile
import threading
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.sample_streams import turning
from firmware_protocol import schema
from firmware_protocol.packets import PacketType

Sample = tuple[int, float, float, float, float]


def missing(name: str) -> str | None:
    """Say why a peer cannot run; None where it can."""
    return None if find_spec(name) else f"{name} is not installed (extra `bench`)"


def construct_parse(n: int) -> Callable[[], object]:
    """construct's compiled parser on unframed ORIENTATION packets: no COBS, no CRC."""
    q15 = np.rint(turning(n) * 32767).astype(int).tolist()
    packets = [schema.build(PacketType.ORIENTATION, (k & 0xFFFF, k * 1000, *q, 0)) for k, q in enumerate(q15)]
    parse = schema.SCHEMA[PacketType.ORIENTATION].compile().parse

    def run() -> int:
        return sum(parse(packet).sequence >= 0 for packet in packets)

    return run


def pymavlink_parse(n: int) -> Callable[[], object]:
    """MAVLink 2 ATTITUDE_QUATERNION through ``parse_buffer``, 4 KiB at a time."""
    os.environ.setdefault("MAVLINK20", "1")
    from pymavlink.dialects.v20 import common

    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    parts = []
    for k, q in enumerate(turning(n).tolist()):
        message = common.MAVLink_attitude_quaternion_message(k, *q, 0.0, 0.0, 0.0)
        parts.append(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
    data = b"".join(parts)

    def run() -> int:
        receiver = common.MAVLink(None)
        samples: list[Sample] = []
        for start in range(0, len(data), 4096):
            for message in receiver.parse_buffer(data[start : start + 4096]) or ():
                samples.append((message.time_boot_ms, message.q1, message.q2, message.q3, message.q4))
        assert len(samples) == n
        return len(samples)

    return run


def ximu3_bytes(quats_wxyz: npt.NDArray[np.float64]) -> bytes:
    """x-IMU3's binary quaternion messages: id, u64 time in us, 4 float32; stuffed, ended by a line feed."""
    parts = []
    for k, q in enumerate(quats_wxyz.tolist()):
        body = struct.pack("<BQ4f", ord("Q") | 0x80, k * 1000, *q)
        parts.append(body.replace(b"\xdb", b"\xdb\xdd").replace(b"\x0a", b"\xdb\xdc") + b"\x0a")
    return b"".join(parts)


def ximu3_parse(n: int) -> Callable[[], object]:
    """x-IMU3's Python binding: a file connection that calls back with each sample."""
    import ximu3

    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name) / "stream.ximu3"
    path.write_bytes(ximu3_bytes(turning(n)))

    def run(_keep: Any = folder) -> int:
        samples: list[Sample] = []
        done = threading.Event()

        def take(message: Any) -> None:
            samples.append((message.timestamp, message.w, message.x, message.y, message.z))
            if len(samples) == n:
                done.set()

        connection = ximu3.Connection(ximu3.FileConnectionConfig(str(path)))
        connection.add_quaternion_callback(take)
        connection.open()
        assert done.wait(120)
        connection.close()
        return len(samples)

    return run


def cantools_parse(n: int) -> Callable[[], object]:
    """cantools on our own DBC: one ORIENTATION frame after the other."""
    from benchmarks.can_streams import can_database, classic_samples

    database, codes = can_database(), classic_samples(n)
    decode = database.decode_message

    def run() -> int:
        samples = [decode(identifier, data) for identifier, data in codes]
        assert len(samples) == n
        return len(samples)

    return run
