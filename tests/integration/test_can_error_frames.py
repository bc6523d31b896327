"""Error frames as the Linux kernel hands them out, through python-can's own reading: noticed, told, counted.

The bytes are ``struct can_frame`` with the classes of ``include/uapi/linux/can/error.h``, on a socket of another
family: datagrams with the kernel's time stamps, as CAN_RAW has them. tests/uml tries the same in a real CAN kernel.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
from collections.abc import Iterator

import can
import numpy as np
import pytest

from firmware_protocol.can.frames import CanFrame, FrameFlag
from host.links.can.bus import CanTransport
from host.links.can.drivers import CanSettings
from host.stream.decoding import Link
from tests.can_traffic import joined, object_at, sample_packets

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="SocketCAN is Linux")

ERR_FLAG = 0x20000000
SO_TIMESTAMPNS = 35


def can_frame(identifier: int, data: bytes) -> bytes:
    """``struct can_frame``: id and flags, length, three bytes of padding, eight of data."""
    return struct.pack("=IB3x8s", identifier, len(data), data)


def error(kind: int, **details: int) -> bytes:
    """An error frame; ``d1=0x01`` sets data[1]. It always has eight bytes (CAN_ERR_DLC)."""
    data = bytearray(8)
    for place, value in details.items():
        data[int(place[1:])] = value
    return can_frame(ERR_FLAG | kind, bytes(data))


@contextlib.contextmanager
def bus_of_datagrams(node: int | None = None) -> Iterator[tuple[CanTransport, socket.socket]]:
    """A SocketCAN link whose kernel is the other end of a pair of sockets."""
    from can.interfaces.socketcan import SocketcanBus

    class DatagramBus(SocketcanBus):
        def __init__(self, inner: socket.socket) -> None:
            self.socket, self.channel, self.channel_info = inner, "can9", "socketcan channel 'can9'"
            self._is_filtered, self._bcm_sockets, self._task_id = True, {}, 0
            self._can_protocol = can.CanProtocol.CAN_20
            can.BusABC.__init__(self, "can9")

        def _apply_filters(self, filters: object) -> None:
            pass

    ours, kernel = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    settings = CanSettings("socketcan", "can9", node=node)
    with kernel, CanTransport(settings, "can:socketcan:can9", DatagramBus(ours)) as transport:
        yield transport, kernel


def read_all(transport: CanTransport) -> list[CanFrame]:
    frames: list[CanFrame] = []
    while (chunk := transport.read(0.0)) is not None:
        frames += chunk.frames
    return frames


# Class, details -> attribute of the health, its value, and what is told.
CASES = {
    "bus-off": (error(0x040), "state", "bus-off", "bus-off"),
    "bus-off is counted": (error(0x040), "bus_offs", 1, "bus-off"),
    "receive overflow": (error(0x004, d1=0x01), "overruns", 1, "computer was too slow"),
    "send overflow": (error(0x004, d1=0x02), "unsent", 1, "no room for frames"),
    "receive warning": (error(0x004, d1=0x04, d6=96, d7=97), "state", "warning", None),
    "send warning": (error(0x004 | 0x200, d1=0x08, d6=97, d7=0), "state", "warning", None),
    "receive passive": (error(0x004, d1=0x10), "state", "passive", "error-passive"),
    "send passive": (error(0x004 | 0x200, d1=0x20, d6=128), "state", "passive", "error-passive"),
    "active again": (error(0x004, d1=0x40), "state", "active", None),
    "nobody acknowledges": (error(0x020), "unacknowledged", 1, "acknowledges"),
    "restarted": (error(0x100), "state", "active", None),
    "protocol violation": (error(0x008 | 0x080, d2=0x04, d3=0x08), "error_frames", 1, None),
    "lost arbitration": (error(0x002, d0=5), "error_frames", 1, None),
}


@pytest.mark.parametrize("case", CASES)
def test_what_the_kernel_says_of_the_bus_is_understood(case: str) -> None:
    raw, attribute, value, words = CASES[case]
    with bus_of_datagrams(node=3) as (transport, kernel):
        kernel.send(raw)
        frames = read_all(transport)
        assert [frame.flags for frame in frames] == [FrameFlag.ERROR]
        assert frames[0].interface_time_s > 1e9
        assert getattr(transport.health, attribute) == value
        assert transport.health.error_frames == 1
        if words is None:
            assert transport.problems == ()
        else:
            assert len(transport.problems) == 1
            assert words in transport.problems[0]


def test_a_bus_off_that_ends_at_once_is_told_all_the_same() -> None:
    with bus_of_datagrams() as (transport, kernel):
        kernel.send(error(0x004, d1=0x20))
        kernel.send(error(0x040))
        kernel.send(error(0x100))
        read_all(transport)
        assert (transport.health.state, transport.health.bus_offs, transport.health.passives) == ("active", 1, 1)
        assert [problem.partition(": check")[0] for problem in transport.problems] == [
            "can:socketcan:can9 went bus-off",
            "can:socketcan:can9 became error-passive",
        ]


def test_a_driver_that_knows_of_bus_off_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    with bus_of_datagrams() as (transport, _):
        assert transport.read(0.0) is None
        assert transport.problems == ()
        monkeypatch.setattr("host.links.can.bus.DRIVER_NS", 0)
        monkeypatch.setattr(can.BusABC, "state", can.BusState.ERROR)
        for _ in range(3):
            assert transport.read(0.0) is None
        assert (transport.health.state, transport.health.bus_offs) == ("bus-off", 1)
        assert "went bus-off" in transport.problems[0]


def test_error_frames_among_samples_cost_no_sample_and_are_counted() -> None:
    link, items = Link(node=3), []
    frames = object_at(3).encode(sample_packets(300))
    errors = [raw for raw, *_ in CASES.values()]
    with bus_of_datagrams(node=3) as (transport, kernel):
        for row, frame in enumerate(frames):
            if row % 20 == 0:
                kernel.send(errors[row // 20 % len(errors)])
            kernel.send(can_frame(frame.arbitration_id, frame.data))
            while (chunk := transport.read(0.0)) is not None:
                items += link.feed(chunk)
        n_errors = len(range(0, len(frames), 20))
        assert transport.health.error_frames == n_errors
    got = joined(items + link.flush())
    assert np.array_equal(got.sequence, np.arange(300))
    assert link.counters.error_frames == n_errors
    assert (link.counters.malformed, link.counters.foreign_frames) == (0, 0)


def test_errors_of_an_interface_that_does_not_explain_them_are_told(request: pytest.FixtureRequest) -> None:
    from host.links import open_transport

    name = request.node.name
    with can.Bus(interface="virtual", channel=name) as spy, open_transport(f"can:virtual:{name}?node=3") as transport:
        spy.send(can.Message(is_error_frame=True, is_extended_id=False))
        read_all(transport)
        assert "errors on the bus" in transport.problems[0]


@pytest.mark.parametrize("is_multicast", [False, True])
def test_the_queue_of_a_link_is_long_and_says_what_it_dropped(is_multicast: bool) -> None:
    import types

    from host.links.can.socketcan import dropped_frames, lengthen_queue

    kernel = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ours = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with kernel, ours:
        ours.bind(("127.0.0.1", 0))
        bus = types.SimpleNamespace(socket=ours)
        if is_multicast:
            bus = types.SimpleNamespace(_multicast=types.SimpleNamespace(_socket=ours))
        before = ours.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        lengthen_queue(bus)
        assert ours.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) >= before
        assert dropped_frames(bus) == 0
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2304)
        for _ in range(50):
            kernel.sendto(bytes(16), ours.getsockname())
        taken = 0
        ours.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while ours.recv(100):
                taken += 1
        assert dropped_frames(bus) == 50 - taken > 0
    assert dropped_frames(types.SimpleNamespace()) == 0
