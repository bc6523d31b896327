"""The virtual object over every CAN link, through python-can: a conversation, samples, losses, trouble."""

import contextlib
import os
import socket
import threading
from typing import Any

import can
import numpy as np
import pytest

from emulator.links import open_link
from firmware_protocol.can.frames import CanFrame, unpack_frames
from firmware_protocol.packets import Info, Status, TimeReply
from host.errors import LinkError, LinkLostError, NoAnswerError, PortBusyError, PortNotFoundError, UsageError
from host.links import open_transport
from host.links.can.drivers import can_settings
from host.links.uri import parse_link_uri
from host.recording.load import assemble
from host.stream.session import Phase
from tests.can_link_run import CAN_LINKS, LINKS, Got, finish, object_on, over, receive
from tests.can_traffic import info_packet, is_sample, joined, sample_packets
from tests.sequence_oracle import counted
from tests.waiting import HANG_S, wait_for


def address_of(name: str, request: pytest.FixtureRequest) -> str:
    return LINKS[name].format(name=request.node.name)


@pytest.mark.parametrize("name", CAN_LINKS)
def test_the_whole_conversation_works(name: str, request: pytest.FixtureRequest) -> None:
    with object_on(address_of(name, request)) as (uri, _), open_transport(uri) as transport:
        got = receive(
            transport, lambda got: got.n_samples > 150 and bool(got.of(Status)) and bool(got.of(TimeReply)), 200
        )
        finish(transport, got)
    info = got.of(Info)[0]
    assert info.name
    assert info.device_id
    counters = got.link.counters
    assert (counters.malformed, counters.long_packet_errors) == (0, 0)
    assert np.array_equal(np.diff(joined(got.items).sequence), np.ones(got.n_samples - 1))
    times = np.diff(joined(got.items).device_time_us.astype(np.int64))
    assert set(times[-100:].tolist()) == {5000}
    frames = [frame for chunk in got.chunks for frame in chunk.frames]
    stamps = [frame.host_time_ns for frame in frames]
    assert stamps == sorted(stamps)
    assert min(stamps) > 0
    assert all(frame.interface_time_s > 0 for frame in frames)
    assert transport.interface_name


def test_udp_multicast_carries_classic_and_fd() -> None:
    pytest.importorskip("msgpack", reason="udp_multicast needs the extra rotdrift[multicast]")
    for node, fd in ((11, 0), (12, 1)):
        # A group of this process's own: another run of the tests must not be on the same bus.
        group = f"239.{64 + (os.getpid() >> 16) % 64}.{os.getpid() >> 8 & 255}.{os.getpid() & 255}"
        address = f"can:udp_multicast:{group}?node={node}&fd={fd}"
        with contextlib.ExitStack() as stack:
            uri, _ = stack.enter_context(object_on(address))
            try:
                transport = stack.enter_context(open_transport(uri))
            except LinkError as error:
                pytest.skip(f"no multicast here: {error}")
            got = receive(transport, lambda got: got.n_samples > 50 and got.of(Info))
            finish(transport, got)
            counters = got.link.counters
            assert (counters.malformed, counters.host_frames) == (0, 0)  # our own commands do not come back


def inject(link: Any, bad: bytes) -> threading.Event:
    """Put bytes between two frames, from the thread that sends."""
    done = threading.Event()

    def tamper(frame: CanFrame) -> list[CanFrame]:
        if not done.is_set():
            link.inject(bad)
            done.set()
        return [frame]

    link.object_end.tamper = tamper
    return done


class Remover:
    """Removes everything sent while given samples pass: ``(first sample, how many)`` each."""

    def __init__(self, gaps: list[tuple[int, int]]) -> None:
        self._gone = {sample for first, count in gaps for sample in range(first, first + count)}
        self._seen = 0
        self.removed = 0

    def __call__(self, frame: CanFrame) -> list[CanFrame]:
        gone = self._seen in self._gone
        if is_sample(frame):
            self._seen += 1
            self.removed += gone
        return [] if gone else [frame]


@pytest.mark.parametrize("name", CAN_LINKS)
def test_removed_frames_are_counted_exactly(name: str, request: pytest.FixtureRequest) -> None:
    gaps = [(500, 1), (700, 255), (1200, 256), (1700, 3000)]
    lost = sum(count for _, count in gaps)
    remover = Remover(gaps)
    packets = [info_packet(), *sample_packets(5000)]
    chunks = over(address_of(name, request), packets, remover, 5000 - lost)
    assert remover.removed == lost
    trial = assemble(chunks, name)
    counters = trial.counters
    assert (counters.malformed, counters.unnumbered) == (0, 0)
    assert (trial.losses.lost, trial.losses.duplicates) == (lost, 0)
    assert len(trial.series) == 5000 - lost
    assert trial.series.index[-1] == 4999


BAD_LINES = [b"t\xff123\r", b"tzzz\r", b"t12\r", b"\x07\x07", b"t1818zz\r", b"d1\r", b"x" * 600 + b"\r"]
BAD_WORDS = [b"< frame 181 zz 00 >", b"< frame \xff >", b"> <", b"< nonsense >", b"<" * 300]


def after_bad(transport: Any, link: Any, got: Got, bad: bytes, n: int) -> int:
    """Put bad bytes between two frames, receive n frames from behind them; return how many were lost meanwhile."""
    lost = counted(got.items)["samples_lost"]
    injected = inject(link, bad)
    receive(transport, lambda _: injected.is_set(), got=got)
    sent = link.object_end.n_sent  # of those before the bad bytes, some may still be under way
    receive(transport, lambda got: got.link.counters.frames > sent + n, got=got)
    return counted(got.items)["samples_lost"] - lost


@pytest.mark.parametrize("reads_lines", [True, False])
@pytest.mark.parametrize("name", ["slcan-pty", "slcan-socket"])
def test_bad_bytes_from_an_adapter_are_counted_and_survived(
    name: str, reads_lines: bool, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("host.links.can.slcan.ChunkedSlcanBus.reads_lines", reads_lines)
    with object_on(address_of(name, request)) as (uri, link), open_transport(uri) as transport:
        got = receive(transport, lambda got: got.n_samples > 20, 200)
        for bad in BAD_LINES:
            before = transport.health.parser_errors + got.link.counters.foreign_frames
            lost = after_bad(transport, link, got, bad, 20)
            # At most the frame that the bad bytes stood before; the library's own reading also loses what it flushes.
            assert lost <= 1 or not reads_lines, bad
            told = transport.health.parser_errors + got.link.counters.foreign_frames > before
            assert told or bad == b"\x07\x07", bad
        finish(transport, got)
    assert "could not all be read" in transport.problems[0]


def test_bad_words_from_socketcand_are_counted_and_survived(request: pytest.FixtureRequest) -> None:
    with object_on(address_of("socketcand", request)) as (uri, link), open_transport(uri) as transport:
        got = receive(transport, lambda got: got.n_samples > 20, 200)
        for bad in BAD_WORDS:
            reopens = transport.health.reopens
            after_bad(transport, link, got, bad, 40)
            assert transport.health.reopens > reopens or not (b"zz" in bad or b"\xff" in bad), bad
        finish(transport, got)
    assert got.session.phase is Phase.STOPPED


def test_the_newest_client_of_socketcand_takes_the_place_of_the_one_before() -> None:
    with open_link("can:socketcand:0") as link:
        address = ("127.0.0.1", link.port)
        with socket.create_connection(address, HANG_S) as first:
            link.receive()
            assert first.recv(100) == b"< hi >"
            with socket.create_connection(address, HANG_S) as second:
                link.receive()
                assert second.recv(100) == b"< hi >"
                assert first.recv(100) == b""


@pytest.mark.parametrize("address", ["can:socketcand:0", "can:slcan:pty"])
def test_a_server_or_an_adapter_that_goes_away_is_told(address: str) -> None:
    with contextlib.ExitStack() as stack:
        uri, _ = stack.enter_context(object_on(address))
        with open_transport(uri) as transport:
            got = receive(transport, lambda got: got.n_samples > 20)
            stack.close()  # the object goes, and its end of the link with it
            with pytest.raises(LinkLostError, match="gone"):
                receive(transport, lambda _: False, got=got)


def test_a_silent_adapter_is_told_though_it_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    import tty

    monkeypatch.setattr("host.links.can.drivers.SLCAN_ANSWER_S", 0.2)
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        with pytest.raises(NoAnswerError, match="no SLCAN adapter answers"):
            open_transport(f"can:slcan:{os.ttyname(slave)}")
    finally:
        os.close(master)
        os.close(slave)


def test_a_device_that_is_no_adapter_is_told_though_it_speaks() -> None:
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)

    def speak() -> None:
        os.read(master, 100)  # the port is open, and what came before is thrown away
        os.write(master, b"$GPGGA,123519,4807.038,N*47\r\n")

    threading.Thread(target=speak, daemon=True).start()
    try:
        with open_transport(f"can:slcan:{os.ttyname(slave)}?node=3") as transport:
            assert transport.read(2.0) is None
            assert "check that it is a CAN adapter" in transport.problems[0]
    finally:
        os.close(master)
        os.close(slave)


def test_an_adapter_in_use_is_left_alone() -> None:
    with object_on("can:slcan:pty") as (uri, _), open_transport(uri) as transport:
        got = receive(transport, lambda got: got.n_samples > 20)
        with pytest.raises(PortBusyError, match="in use"):
            open_transport(uri)
        seen = got.n_samples
        receive(transport, lambda got: got.n_samples > seen + 20, got=got)
        finish(transport, got)
        assert counted(got.items)["samples_lost"] == 0


def test_two_objects_on_a_bus_are_a_question_unless_the_link_names_one(request: pytest.FixtureRequest) -> None:
    bus = f"can:virtual:{request.node.name}"
    with object_on(f"{bus}?node=4") as (uri, _), object_on(f"{bus}?node=9") as (other_uri, _):
        with open_transport(bus) as transport, pytest.raises(UsageError, match=r"several objects .*4, 9"):
            receive(transport, lambda _: False)
        for link, node in ((uri, 4), (other_uri, 9)):
            with open_transport(link) as transport:
                got = receive(transport, lambda got: got.n_samples > 50)
                finish(transport, got)
                assert transport.node == node
                assert counted(got.items)["samples_lost"] == 0


def test_a_link_without_node_finds_the_object(request: pytest.FixtureRequest) -> None:
    bus = f"can:virtual:{request.node.name}"
    with object_on(f"{bus}?node=17"), open_transport(bus) as transport:
        got = receive(transport, lambda got: got.n_samples > 20)
        finish(transport, got)
        assert transport.node == 17


def test_the_raw_chunks_decode_to_the_same_again(request: pytest.FixtureRequest) -> None:
    with object_on(address_of("slcan-pty", request)) as (uri, _), open_transport(uri) as transport:
        got = receive(transport, lambda got: got.n_samples > 200, 1000)
        finish(transport, got)
    again = Got()
    for chunk in got.chunks:
        again.items += again.link.feed(chunk)
    first, second = joined(got.items), joined(again.items)
    assert np.array_equal(first.quats_wxyz, second.quats_wxyz)
    assert np.array_equal(first.device_time_us, second.device_time_us)
    assert len(unpack_frames(b"".join(chunk.data for chunk in got.chunks))) == got.link.counters.frames


@pytest.mark.parametrize(
    ("uri", "kind", "words"),
    [
        ("can:nothing:x", UsageError, "not a CAN interface"),
        ("can:slcan:", UsageError, "not a link|no channel"),
        ("can:virtual:x?node=0", UsageError, "node=0"),
        ("can:virtual:x?node=32", UsageError, "node=32"),
        ("can:virtual:x?speed=1", UsageError, "option speed"),
        ("can:slcan:/dev/nothing-here", PortNotFoundError, "no port /dev/nothing-here"),
        ("can:slcan:socket://127.0.0.1:1", PortNotFoundError, "nothing answers"),
        ("can:slcan:socket://127.0.0.1:", UsageError, "not a URL"),
        ("serial:socket://127.0.0.1:99999", UsageError, "not a URL"),
        ("can:slcan:/dev/null?fd=1&bitrate=83300", LinkError, "not a serial port"),
        ("can:socketcand:127.0.0.1", UsageError, "no socketcand bus"),
        ("can:socketcand:127.0.0.1:29536/can0?fd=1", UsageError, "no CAN FD"),
        ("can:slcan:/dev/null?bitrate=123456", (UsageError, LinkError), "/dev/null|bitrate"),
        ("can:pcan:PCAN_USBBUS1", LinkError, "not installed.*PCAN-Basic|does not open"),
        ("can:kvaser:0", LinkError, "not installed.*CANlib|does not open"),
        ("can:vector:0", LinkError, "not installed.*XL driver|does not open"),
        ("can:canalystii:0", LinkError, "not installed.*pip install|does not open"),
        ("can:socketcan:no-such-can", LinkError, "there is no CAN interface no-such-can|kernel has no CAN"),
        ("can:virtual:x?bitrate=500kbit", UsageError, "500kbit"),
        ("can:virtual:x?bitrate=2M", UsageError, "2000000"),
    ],
)
def test_wrong_links_are_one_sentence(uri: str, kind: type[Exception], words: str) -> None:
    with pytest.raises(kind, match=words) as failure:
        open_transport(uri)
    assert "\n" not in str(failure.value)


def test_bit_rates_may_be_written_short() -> None:
    settings = can_settings(parse_link_uri("can:slcan:COM5?bitrate=250k&data_bitrate=5M&fd=1&node=31"))
    assert (settings.bitrate, settings.data_bitrate, settings.fd, settings.node) == (250_000, 5_000_000, True, 31)


def test_a_pcan_adapter_is_told_the_timing_of_can_fd(monkeypatch: pytest.MonkeyPatch) -> None:
    """Through python-can's own bus, with a stand-in for the library of the maker."""
    told: list[bytes] = []

    class Library:
        def GetValue(self, *_: object) -> tuple[int, bytes]:  # noqa: N802 (the library's names)
            return 0, b"4.9.0"

        def SetValue(self, *_: object) -> int:  # noqa: N802
            return 0

        def InitializeFD(self, _handle: object, timing: bytes) -> int:  # noqa: N802
            told.append(timing)
            raise OSError("no adapter")

    monkeypatch.setattr("can.interfaces.pcan.pcan.PCANBasic", Library)
    with pytest.raises(LinkError, match="does not open"):
        open_transport("can:pcan:PCAN_USBBUS1?fd=1&bitrate=500k&data_bitrate=2M")
    timing = dict(part.split("=") for part in told[0].decode().split(", "))
    values = {name: int(value) for name, value in timing.items()}
    for phase, bitrate in (("nom", 500_000), ("data", 2_000_000)):
        quanta = 1 + values[f"{phase}_tseg1"] + values[f"{phase}_tseg2"]
        assert values["f_clock"] == bitrate * values[f"{phase}_brp"] * quanta


@pytest.mark.parametrize("name", ["slcan-pty", "slcan-socket"])
def test_python_cans_own_slcan_bus_understands_the_adapter(name: str, request: pytest.FixtureRequest) -> None:
    with object_on(address_of(name, request)) as (uri, _):
        channel = uri.removeprefix("can:slcan:").partition("?")[0]
        with can.Bus(interface="slcan", channel=channel, bitrate=500_000, sleep_after_open=0.0) as bus:
            assert bus.get_version(HANG_S) == (10, 13)
            assert bus.get_serial_number(HANG_S) == "RD01"
            node = 7 if name == "slcan-pty" else 1
            bus.send(can.Message(arbitration_id=0x020 | node, data=b"\x82\x01\x00", is_extended_id=False))
            heard = {}

            def hear() -> None:
                message = bus.recv(0.1)
                if message is not None:
                    heard[message.arbitration_id] = bytes(message.data)

            wanted = {0x040 | node, 0x180 | node, 0x200 | node}
            wait_for(lambda: wanted <= set(heard), lambda: f"{wanted}; {set(heard)} came", hear)
            assert heard[0x040 | node] == b"\x05\x82\x01\x00"
