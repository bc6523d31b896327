"""A virtual object on a link, in a thread, and the host's end of the same link."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from emulator.links import Link as ObjectLink
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import CanFrame
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import Info, OrientationBatch, PacketType, Status
from firmware_protocol.serial.decoder import encode_command
from host.links import open_transport
from host.links.transport import AnyChunk
from host.stream.decoding import Link
from host.stream.session import Phase, Session, SessionSettings
from tests.waiting import wait_for, wait_for_event, wait_for_thread

LINKS = {
    "pty": "pty:",
    "tcp": "tcp:0",
    "slcan-pty": "can:slcan:pty?node=7",
    "slcan-socket": "can:slcan:tcp:0",
    "socketcand": "can:socketcand:0?node=31",
    "virtual": "can:virtual:{name}?node=2",
    "slcan-pty-fd": "can:slcan:pty?node=7&fd=1",
    "slcan-socket-fd": "can:slcan:tcp:0?fd=1",
    "virtual-fd": "can:virtual:{name}?node=2&fd=1",
}
CAN_LINKS = [name for name in LINKS if name not in ("pty", "tcp")]


@dataclass
class Got:
    """What the host's end received."""

    items: list[StreamItem] = field(default_factory=list)
    chunks: list[Any] = field(default_factory=list)
    session: Session | None = None
    link: Link = field(default_factory=Link)

    @property
    def batches(self) -> list[OrientationBatch]:
        return [item for item in self.items if isinstance(item, OrientationBatch)]

    @property
    def n_samples(self) -> int:
        return sum(map(len, self.batches))

    def of(self, kind: type) -> list[Any]:
        return [item for item in self.items if isinstance(item, kind)]


class TamperedEnd:
    """An object's end of the bus that counts the frames it sends, with faults on them between it and its link."""

    def __init__(self, end: CanObject, tamper: Callable[[CanFrame], list[CanFrame]] | None = None) -> None:
        self._end = end
        self.tamper = tamper
        self.n_sent = 0

    def _sent(self, frames: list[CanFrame]) -> list[CanFrame]:
        if self.tamper is not None:
            frames = [out for frame in frames for out in self.tamper(frame)]
        self.n_sent += len(frames)
        return frames

    def encode(self, packets: Sequence[bytes]) -> list[CanFrame]:
        return self._sent(self._end.encode(packets))

    def receive(self, frame: CanFrame) -> tuple[list[bytes], list[CanFrame]]:
        packets, replies = self._end.receive(frame)
        return packets, self._sent(replies)

    def poll(self) -> list[CanFrame]:
        return self._sent(self._end.poll())

    def reset(self) -> None:
        self._end.reset()


@contextlib.contextmanager
def object_on(address: str, scenario: str = "default", seed: int = 1) -> Iterator[tuple[str, ObjectLink]]:
    """Run a virtual object on a link; yields the URI for the host and the object's end."""
    link = open_link(address)
    if address.startswith("can:"):
        link.object_end = TamperedEnd(link.object_end)
    stop, ready = threading.Event(), threading.Event()
    uri: list[str] = []

    def on_ready(text: str) -> None:
        uri.append(text)
        ready.set()

    settings = replace(load_scenario(scenario), seed=seed)
    thread = threading.Thread(target=run, args=(settings, link, None, None, stop, on_ready), daemon=True)
    thread.start()
    wait_for_event(ready, "an object that is ready")
    try:
        yield uri[0], link
    finally:
        stop.set()
        wait_for_thread(thread)


def receive(
    transport: Any,
    enough: Callable[[Got], bool],
    rate_hz: int | None = None,
    got: Got | None = None,
) -> Got:
    """Talk with the object until there is enough."""
    got = got or Got()
    if got.session is None:
        encode = getattr(transport, "encode_command", encode_command)
        got.session = Session(SessionSettings(rate_hz=rate_hz), transport.name, time.monotonic_ns(), encode)
    session = got.session

    def turn() -> None:
        _turn(transport, got)
        assert session.error is None, session.error

    wait_for(lambda: enough(got), lambda: f"enough packets; {got.n_samples} samples came", turn)
    return got


def finish(transport: Any, got: Got) -> None:
    """Stop the object and take what is still under way."""
    session = got.session
    assert session is not None
    session.stop()
    wait_for(lambda: session.phase is Phase.STOPPED, "an object that has stopped", lambda: _turn(transport, got))
    wait_for(lambda: not _turn(transport, got), "a silent link")


def _turn(transport: Any, got: Got) -> bool:
    chunk = transport.read(0.05)
    if chunk is not None:
        got.chunks.append(chunk)
        items = got.link.feed(chunk)
        got.items += items
        got.session.feed(items, len(chunk.data), chunk.host_time_ns)
    for data in got.session.due(time.monotonic_ns()):
        transport.write(data)
    return chunk is not None


def over(
    address: str,
    packets: list[bytes],
    tamper: Callable[[CanFrame], list[CanFrame]] | None = None,
    wanted: int | None = None,
) -> list[AnyChunk]:
    """Send packets over a link, as fast as it takes them, and return what the host receives.

    It ends when ``wanted`` samples have come; by default as many as there are among the packets.
    """
    if wanted is None:
        wanted = sum(packet[0] == PacketType.ORIENTATION for packet in packets)
    chunks: list[AnyChunk] = []
    go, done = threading.Event(), threading.Event()
    with open_link(address) as link:
        if tamper is not None:
            link.object_end = TamperedEnd(link.object_end, tamper)
        thread = threading.Thread(target=_send, args=(link, packets, go, done), daemon=True)
        thread.start()
        try:
            with open_transport(link.host_uri) as transport:
                go.set()
                decoder = Link()
                received = 0

                def turn() -> None:
                    nonlocal received
                    chunk = transport.read(0.05)
                    if chunk is not None:
                        chunks.append(chunk)
                        items = decoder.feed(chunk)
                        received += sum(len(item) for item in items if isinstance(item, OrientationBatch))

                wait_for(lambda: received >= wanted, lambda: f"{wanted} samples; {received} came", turn)
        finally:
            done.set()
            wait_for_thread(thread)
    return chunks


def _send(link: ObjectLink, packets: list[bytes], go: threading.Event, done: threading.Event) -> None:
    """Be the object's end: answer the adapter's host, then send as fast as the link takes."""
    rest = packets
    while not done.is_set():
        link.receive()
        if go.is_set():
            taken = link.send(rest[:200])
            rest = rest[taken or 0 :]
        link.wait(0.002)


__all__ = ["CAN_LINKS", "LINKS", "Got", "Info", "Status", "finish", "object_on", "open_transport", "over", "receive"]
