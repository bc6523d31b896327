"""The SLCAN adapter and the socketcand session of the virtual object, without I/O."""

import itertools

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulator import LinkError
from emulator.links import open_link
from emulator.links.can.link import parse_address
from emulator.links.can.slcan_adapter import SlcanAdapter, slcan_line
from emulator.links.can.socketcand import QUIET_MS, SocketcandSession
from firmware_protocol.can.frames import FD_LENGTHS, CanFrame, FrameFlag


def test_the_channel_opens_as_the_manual_says() -> None:
    adapter = SlcanAdapter()
    assert adapter.from_host(b"C\rS6\rO\rO\rS5\r") == (b"\a\r\r\a\a", [])
    assert (adapter.bitrate, adapter.is_open) == (500_000, True)
    assert adapter.from_host(b"V\rN\rF\r")[0] == b"V1013\rNRD01\rF00\r"
    assert adapter.from_host(b"C\rZ1\rY2\rL\r")[0] == b"\r\r\r\r"
    assert (adapter.timestamps, adapter.data_bitrate, adapter.listens_only) == (True, 2_000_000, True)
    assert adapter.from_host(b"t1230\r") == (b"\a", [])  # listens only


def test_time_stamps_are_milliseconds_of_the_minute() -> None:
    adapter = SlcanAdapter()
    adapter.from_host(b"Z1\rO\r")
    assert adapter.from_bus(CanFrame(0x123, b"\x01"), 60_000 * 7 + 0x1234) == b"t1231011234\r"


def test_a_closed_channel_hears_nothing() -> None:
    assert SlcanAdapter().from_bus(CanFrame(0x123, b"\x01"), 0) == b""


@pytest.mark.parametrize(
    "line", [b"t123", b"t12311", b"t1239" + b"00" * 9, b"t800000", b"tXYZ0", b"d1239", b"Q1", b"r1239", b"t" * 400]
)
def test_wrong_lines_are_refused_and_harmless(line: bytes) -> None:
    adapter = SlcanAdapter()
    adapter.from_host(b"O\r")
    assert adapter.from_host(line + b"\r") == (b"\a", [])
    assert repr(adapter.from_host(b"t1230\r")) == repr((b"z\r", [CanFrame(0x123, b"")]))  # repr: times are NaN


@st.composite
def data_frames(draw: st.DrawFn) -> CanFrame:
    extended, fd = draw(st.booleans()), draw(st.booleans())
    flags = FrameFlag.EXTENDED if extended else FrameFlag(0)
    if fd:
        flags |= FrameFlag.FD | (FrameFlag.BITRATE_SWITCH if draw(st.booleans()) else FrameFlag(0))
    length = draw(st.sampled_from(FD_LENGTHS if fd else FD_LENGTHS[:9]))
    data = draw(st.binary(min_size=length, max_size=length))
    return CanFrame(draw(st.integers(0, 2**29 - 1 if extended else 2**11 - 1)), data, flags)


@given(st.lists(data_frames(), max_size=8), st.lists(st.integers(1, 30), min_size=1))
def test_what_goes_in_as_lines_comes_out_as_frames_however_it_is_cut(frames: list[CanFrame], cuts: list[int]) -> None:
    adapter = SlcanAdapter()
    adapter.from_host(b"O\r")
    wire = b"".join(slcan_line(frame) + b"\r" for frame in frames)
    found: list[CanFrame] = []
    step = itertools.cycle(cuts)
    while wire:
        size = next(step)
        found += adapter.from_host(wire[:size])[1]
        wire = wire[size:]
    assert repr(found) == repr(frames)


@given(st.binary(max_size=300))
def test_no_bytes_from_a_host_ever_raise(data: bytes) -> None:
    SlcanAdapter().from_host(data)
    adapter = SlcanAdapter()
    adapter.from_host(b"O\r" + data)
    session = SocketcandSession()
    session.from_host(b"< open vcan0 >< rawmode >" + data)


def test_socketcand_speaks_as_its_protocol_says() -> None:
    session = SocketcandSession()
    assert session.from_host(b"< rawmode >")[0] == b"< error unknown command >"
    assert session.from_host(b"< open can7 >")[0] == b"< error could not open bus >"
    assert session.from_host(b"< open vc")[0] == b""
    assert session.from_host(b"an0 >< rawmode >< echo >")[0] == b"< ok >< ok >< echo >"
    assert not session.hears(1000)
    assert session.hears(1000 + QUIET_MS)
    assert session.from_bus(CanFrame(0x123, b"\x01\xab"), 2500) == b"< frame 123 2.500000 01AB >"
    assert session.from_bus(CanFrame(0x123, b"", FrameFlag.FD), 2500) == b""
    assert repr(session.from_host(b"< send 123 2 1 ab >")) == repr((b"", [CanFrame(0x123, b"\x01\xab")]))
    assert session.from_host(b"< send 123 3 1 ab >")[1] == []
    assert repr(session.from_host(b"< send 00000123 0 >")[1]) == repr([CanFrame(0x123, b"", FrameFlag.EXTENDED)])


def test_python_can_reads_socketcand_lines_the_same() -> None:
    from can.interfaces.socketcand.socketcand import convert_ascii_message_to_can_message as parsed

    session = SocketcandSession()
    session.from_host(b"< open vcan0 >< rawmode >")
    session.hears(0)
    message = parsed(session.from_bus(CanFrame(0x1ABCDEF0, b"\x00\xff", FrameFlag.EXTENDED), 1234).decode())
    assert isinstance(message, can.Message)
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x1ABCDEF0, b"\x00\xff", True)


@pytest.mark.parametrize(
    "address",
    [
        "can:",
        "can:slcan",
        "can:slcan:usb",
        "can:slcan:tcp:x",
        "can:socketcand:x",
        "can:socketcand:0?fd=1",
        "can:no:x",
        "can:virtual:x?node=32",
        "can:virtual:x?node=0",
        "can:virtual:x?node=a",
        "can:virtual:x?speed=1",
    ],
)
def test_wrong_addresses_say_why(address: str) -> None:
    with pytest.raises(LinkError):
        open_link(address)


def test_addresses_come_apart() -> None:
    address = parse_address("udp_multicast:239.0.0.1?node=9&fd=1&data_bitrate=5000000")
    assert (address.interface, address.channel, address.node, address.fd) == ("udp_multicast", "239.0.0.1", 9, True)
    assert address.host_uri("x") == "can:udp_multicast:x?bitrate=500000&node=9&fd=1&data_bitrate=5000000"
