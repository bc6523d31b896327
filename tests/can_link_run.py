"""A virtual object on a link, in a thread, and the host's end of the same link."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from emulator.links import Link as ObjectLink
from emulator.links import open_link
from emulator.runner import run
from emulator.scenario import load_scenario
from firmware_protocol.packets import Info, OrientationBatch, Status
from firmware_protocol.stream import StreamItem, encode_command
from host.link import Link
from host.session import Phase, Session, SessionSettings
from host.transports import open_transport

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


@contextlib.contextmanager
def object_on(address: str, scenario: str = "default") -> Iterator[tuple[str, ObjectLink]]:
    """Run a virtual object on a link; gives the URI for the host and the object's end."""
    link = open_link(address)
    stop, ready = threading.Event(), threading.Event()
    uri: list[str] = []

    def on_ready(text: str) -> None:
        uri.append(text)
        ready.set()

    thread = threading.Thread(target=run, args=(load_scenario(scenario), link, None, None, stop, on_ready), daemon=True)
    thread.start()
    assert ready.wait(10)
    try:
        yield uri[0], link
    finally:
        stop.set()
        thread.join(10)
        assert not thread.is_alive()


def receive(
    transport: Any,
    enough: Callable[[Got], bool],
    rate_hz: int | None = None,
    limit_s: float = 30.0,
    got: Got | None = None,
) -> Got:
    """Talk with the object until there is enough."""
    got = got or Got()
    if got.session is None:
        encode = getattr(transport, "encode_command", encode_command)
        got.session = Session(SessionSettings(rate_hz=rate_hz), transport.name, time.monotonic_ns(), encode)
    deadline = time.monotonic() + limit_s
    while not enough(got):
        assert time.monotonic() < deadline, "not enough came in time"
        _turn(transport, got)
        assert got.session.error is None, got.session.error
    return got


def finish(transport: Any, got: Got) -> None:
    """Stop the object and take what is still under way."""
    assert got.session is not None
    got.session.stop()
    deadline = time.monotonic() + 10
    while got.session.phase is not Phase.STOPPED:
        assert time.monotonic() < deadline
        _turn(transport, got)
    while _turn(transport, got):
        pass


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


__all__ = ["CAN_LINKS", "LINKS", "Got", "Info", "Status", "finish", "object_on", "open_transport", "receive"]
