"""CAN live, interface by interface: our path against python-can + cantools, on the same virtual object at 1000 Hz.

    python -m benchmarks.can_throughput [--quick]

The object runs in a process of its own; both readers take turns on its link. Ours delivers numbered, timed samples with
losses counted; the peer what a user would write: ``recv``, ``decode_message``, the quaternion completed.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import can

from benchmarks import peers
from benchmarks.can_streams import NODE, can_database
from benchmarks.measurement import Topic, figure, ratio
from benchmarks.report import markdown
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol.can.encoder import command_frame
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import OrientationBatch, SetRate, Start
from host.links import open_transport
from host.stream.decoding import Link

RATE_HZ = 1000
SETTLE_S = 0.5
START = (SetRate(1, RATE_HZ), Start(2))
INTERFACES = {
    "slcan, pseudo-terminal": f"can:slcan:pty?node={NODE}",
    "slcan, CAN FD": f"can:slcan:pty?fd=1&node={NODE}",
    "slcan, socket": f"can:slcan:tcp:0?node={NODE}",
    "socketcand": f"can:socketcand:0?node={NODE}",
    "udp_multicast": f"can:udp_multicast:239.74.163.7?node={NODE}",
}
QUICK = ("slcan, pseudo-terminal", "socketcand")


@dataclass(frozen=True)
class Reading:
    """What one reader came to."""

    frames: int
    elapsed_s: float
    cpu_s: float
    lost: int

    @property
    def frames_per_s(self) -> float:
        return self.frames / self.elapsed_s

    @property
    def cpu_us(self) -> float:
        """Processor time of a frame, all threads of the reading process."""
        return 1e6 * self.cpu_s / max(self.frames, 1)


def _emulate(address: str, pipe: Connection) -> None:
    stop = threading.Event()
    threading.Thread(target=lambda: (pipe.recv(), stop.set()), daemon=True).start()
    run(load_scenario("high-rate"), open_link(address), None, None, stop, pipe.send)


@contextlib.contextmanager
def object_in_a_process(address: str) -> Iterator[str]:
    """Run the virtual object; gives the link for the host."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=_emulate, args=(address, theirs), daemon=True)
    process.start()
    try:
        yield ours.recv()
    finally:
        ours.send("stop")
        process.join(5)
        process.kill()


def _timed(turn: Callable[[], None], count: Callable[[], tuple[int, int]], seconds: float) -> Reading:
    """Let a reader settle, then measure it; ``count`` gives frames and losses so far."""
    until = time.monotonic() + SETTLE_S
    while time.monotonic() < until:
        turn()
    before = count()
    cpu, started = time.process_time(), time.monotonic()
    while time.monotonic() - started < seconds:
        turn()
    cpu, elapsed = time.process_time() - cpu, time.monotonic() - started
    after = count()
    return Reading(after[0] - before[0], elapsed, cpu, after[1] - before[1])


def read_ours(uri: str, seconds: float) -> Reading:
    """Through our transport and decoder."""
    link = Link(node=NODE)
    lost = 0
    last: int | None = None
    with open_transport(uri) as transport:
        for command in START:
            transport.write(transport.encode_command(command))

        def turn() -> None:
            nonlocal lost, last
            chunk = transport.read(0.05)
            for item in () if chunk is None else link.feed(chunk):
                if isinstance(item, OrientationBatch):
                    sequence = int(item.sequence[-1])
                    lost += 0 if last is None else (sequence - last - len(item)) & 0xFFFF
                    last = sequence

        return _timed(turn, lambda: (link.counters.frames, lost), seconds)


def _peer_bus(uri: str) -> can.BusABC:
    _, interface, rest = uri.split(":", 2)
    channel, _, query = rest.partition("?")
    if interface == "socketcand":
        host, port = channel.partition("/")[0].split(":")
        return can.Bus(interface=interface, channel=channel.partition("/")[2], host=host, port=int(port))
    if interface == "slcan" and "fd=1" in query:
        timing = can.BitTimingFd.from_sample_point(80_000_000, 500_000, 80.0, 2_000_000, 80.0)
        return can.Bus(interface=interface, channel=channel, timing=timing, sleep_after_open=0.0)
    options: dict[str, Any] = {"bitrate": 500_000, "sleep_after_open": 0.0} if interface == "slcan" else {}
    return can.Bus(interface=interface, channel=channel, **options)


def read_peer(uri: str, seconds: float, database: Any) -> Reading:
    """python-can and cantools, as a user would write it."""
    fd = "fd=1" in uri
    classic, whole = (arbitration_id(CanFunction.ORIENTATION, NODE, is_whole) for is_whole in (False, True))
    names = [[f"Quat{c}_{k}" for c in "WXYZ" if c != "WXYZ"[k]] for k in range(4)]
    frames = lost = 0
    last: int | None = None

    def turn() -> None:
        nonlocal frames, lost, last
        message = bus.recv(0.05)
        if message is None:
            return
        frames += 1
        try:
            values = database.decode_message(message.arbitration_id, message.data, allow_truncated=True)
        except KeyError:
            return  # ISO-TP, commands
        if message.arbitration_id == classic:
            index = int(values["LargestIndex"])
            q_wxyz = [values[name] for name in names[index]]
            q_wxyz.insert(index, max(1.0 - sum(part * part for part in q_wxyz), 0.0) ** 0.5)
            counter = int(values["SampleCounter8"])
        elif message.arbitration_id == whole:
            counter = int(values["Sequence"]) & 0xFF
        else:
            return
        lost += 0 if last is None else (counter - last - 1) & 0xFF
        last = counter

    with _peer_bus(uri) as bus:
        for command in START:
            frame = command_frame(encode_packet(command), NODE, fd)
            bus.send(
                can.Message(
                    arbitration_id=frame.arbitration_id,
                    data=frame.data,
                    is_extended_id=False,
                    is_fd=frame.is_fd,
                    bitrate_switch=frame.is_fd,
                )
            )
        return _timed(turn, lambda: (frames, lost), seconds)


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic(f"CAN, live: one object at {RATE_HZ} Hz through each interface")
    missing = peers.missing("cantools")
    if missing:
        topic.left_out.append(f"python-can + cantools: {missing}")
    database = None if missing else can_database()
    for name, address in INTERFACES.items():
        if quick and name not in QUICK:
            continue
        ours: list[Reading] = []
        theirs: list[Reading] = []
        try:
            with object_in_a_process(address) as uri:
                for _ in range(1 if quick else 3):
                    ours.append(read_ours(uri, 1.0 if quick else 2.0))
                    if database is not None:
                        theirs.append(read_peer(uri, 1.0 if quick else 2.0, database))
        except (OSError, EOFError, can.CanError) as error:
            topic.left_out.append(f"{name}: {error}")
            continue
        for who, readings in (("ours", ours), ("python-can + cantools", theirs)):
            if not readings:
                continue
            lost = sum(reading.lost for reading in readings)
            note = f"{lost} samples lost of {sum(reading.frames for reading in readings)} frames"
            topic.rows.append(figure(f"{name}: {who}", [each.frames_per_s for each in readings], "frames/s", note))
            topic.rows.append(figure(f"{name}: {who}", [each.cpu_us for each in readings], "µs CPU/frame"))
        if theirs:
            costs = ([each.cpu_us for each in theirs], [each.cpu_us for each in ours])
            note = "above 1: ours costs less"
            topic.rows.append(ratio(f"{name}: python-can + cantools / ours", *costs, note=note))
    return topic


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    print(markdown([measure(parser.parse_args().quick)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
