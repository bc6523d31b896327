"""CAN: frames a second and processor time a frame through each interface, and bulk decoding beside cantools.

    python -m benchmarks.can_throughput [--seconds 3]

Each interface carries the same object at 1000 Hz in a process of its own; the host's thread reads and decodes. Bulk
decoding is ours against python-can messages through cantools with the shipped DBC, on the same frames, samples to
quaternions.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

import cantools
import numpy as np

import firmware_protocol
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol.can_decoder import CanStreamDecoder
from firmware_protocol.can_encoder import CanObject
from firmware_protocol.can_frames import frame_array, pack_frames
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info, Orientation, OrientationBatch, SetRate, Start
from host.link import Link
from host.transports import open_transport

INTERFACES = {
    "slcan, pseudo-terminal": "can:slcan:pty",
    "slcan, CAN FD": "can:slcan:pty?fd=1",
    "slcan, socket": "can:slcan:tcp:0",
    "socketcand": "can:socketcand:0",
    "udp_multicast": "can:udp_multicast:239.74.163.7?node=9",
}


def emulate(address: str, pipe: Connection) -> None:
    stop = threading.Event()
    threading.Thread(target=lambda: (pipe.recv(), stop.set()), daemon=True).start()
    run(load_scenario("high-rate"), open_link(address), None, None, stop, pipe.send)


def live(address: str, seconds: float) -> tuple[float, float, int]:
    """Frames a second, µs of the reading thread's processor time a frame, samples lost."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=emulate, args=(address, theirs), daemon=True)
    process.start()
    try:
        with open_transport(ours.recv()) as transport:
            link = Link()
            for command in (SetRate(1, 1000), Start(2)):
                transport.write(transport.encode_command(command))
            settled = time.monotonic() + 1.0
            while time.monotonic() < settled:
                chunk = transport.read(0.05)
                if chunk is not None:
                    link.feed(chunk)
            lost, frames = link.counters.samples_lost, link.counters.frames
            cpu, started = time.thread_time(), time.monotonic()
            while time.monotonic() - started < seconds:
                chunk = transport.read(0.05)
                if chunk is not None:
                    link.feed(chunk)
            cpu, elapsed = time.thread_time() - cpu, time.monotonic() - started
            counters = link.counters
    finally:
        ours.send("stop")
        process.join(5)
        process.kill()
    n = counters.frames - frames
    return n / elapsed, cpu / max(n, 1) * 1e6, counters.samples_lost - lost


def frame_batches(n: int) -> bytes:
    rng = np.random.default_rng(5)
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1)[:, None]
    end = CanObject(1)
    end.encode([encode_packet(Info(1, 1, rate_hz=1000))])
    rows = enumerate(quats.tolist())
    return pack_frames(end.encode([encode_packet(Orientation(k & 0xFFFF, k * 1000, tuple(q))) for k, q in rows]))


def bulk_ours(data: bytes) -> int:
    items = CanStreamDecoder(1).feed(data)
    return sum(len(item) for item in items if isinstance(item, OrientationBatch))


def bulk_cantools(frames: list[tuple[int, bytes]], database: cantools.database.can.Database) -> int:
    """What a user would write: decode each message, and put the quaternion together."""
    orientation = database.get_message_by_name("ORIENTATION").frame_id
    quats = []
    for identifier, payload in frames:
        values = database.decode_message(identifier, payload)
        if identifier == orientation:
            index = values["LargestIndex"]
            parts = [values[f"Quat{name}_{index}"] for k, name in enumerate("WXYZ") if k != index]
            parts.insert(index, (1 - sum(part * part for part in parts)) ** 0.5)
            quats.append(parts)
    return len(np.array(quats))


def bulk(n: int, rounds: int) -> tuple[float, float]:
    """Median seconds for n samples, ours and cantools (measured on a tenth, interleaved)."""
    data = frame_batches(n)
    records = frame_array(data)[: len(frame_array(data)) // 10]
    frames = [(int(record["arbitration_id"]), record["data"].tobytes()) for record in records]
    database = cantools.database.load_file(Path(firmware_protocol.__file__).parent / "sensorized_object.dbc")
    ours, theirs = [], []
    for _ in range(rounds):
        started = time.process_time()
        assert bulk_ours(data) == n
        ours.append(time.process_time() - started)
        started = time.process_time()
        decoded = bulk_cantools(frames, database)
        theirs.append((time.process_time() - started) * n / decoded)
    return statistics.median(ours), statistics.median(theirs)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--samples", type=int, default=50_000)
    seconds, n = vars(parser.parse_args()).values()
    print(f"{'interface':<24}{'frames/s':>10}{'CPU a frame':>14}{'lost':>6}")
    for name, address in INTERFACES.items():
        rate, cpu_us, lost = live(address, seconds)
        print(f"{name:<24}{rate:>10.0f}{cpu_us:>11.0f} µs{lost:>6}")
    ours, theirs = bulk(n, 3)
    print(f"bulk: ours {n / ours / 1e6:.2f} M samples/s, cantools {n / theirs / 1e6:.3f} M: {theirs / ours:.0f} times")
    return 0


if __name__ == "__main__":
    sys.exit(main())
