"""Serial links against what pyserial really does: ptys, sockets, loops, and ports that vanish."""

import contextlib
import errno
import os
import re
import socket
import sys
import threading
import time
from pathlib import Path

import pytest
import serial

from host.errors import (
    LinkError,
    LinkLostError,
    PortBusyError,
    PortNotFoundError,
    PortPermissionError,
    UsageError,
)
from host.links import open_transport
from host.links.serial.errors import translate_io_error, translate_open_error
from host.links.serial.listing import port_owners
from host.links.transport import MAX_CHUNK_BYTES
from tests.waiting import HANG_S, wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no ptys on Windows")


@pytest.fixture
def pty():
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    yield master, os.ttyname(slave)
    for descriptor in (master, slave):
        with contextlib.suppress(OSError):
            os.close(descriptor)


def read_exactly(transport, n):
    chunks = []
    wait_for(
        lambda: sum(map(len, chunks)) >= n, f"{n} bytes", lambda: chunks.extend(filter(None, [transport.read(0.1)]))
    )
    return b"".join(chunk.data for chunk in chunks)


def test_a_pty_delivers_what_was_written_with_the_time_of_reception(pty):
    master, name = pty
    with open_transport(f"serial:{name}") as link:
        assert link.read(0.01) is None
        before = time.monotonic_ns()
        os.write(master, bytes(range(256)))
        chunk = link.read(HANG_S)
        assert before <= chunk.host_time_ns <= time.monotonic_ns()
        assert chunk.data + read_exactly(link, 256 - len(chunk.data)) == bytes(range(256))
        link.write(b"\x00\x11\x13\x0a\x0d\xff")  # flow control and line ends must pass as they are
        assert os.read(master, 100) == b"\x00\x11\x13\x0a\x0d\xff"


def test_a_link_through_a_symlink_is_locked_like_the_port_itself(pty, tmp_path):
    _, name = pty
    link_path = tmp_path / "object"
    link_path.symlink_to(name)
    with open_transport(str(link_path)), pytest.raises(PortBusyError, match="in use"):
        open_transport(f"serial:{name}")
    open_transport(f"serial:{name}").close()  # and free again


def test_a_port_whose_other_side_went_away_is_lost(pty):
    master, name = pty
    with open_transport(name) as link:
        os.close(master)
        with pytest.raises(LinkLostError, match="is gone"):
            read_exactly(link, 1)


def test_closing_twice_is_harmless_and_reading_afterwards_is_our_error(pty):
    _, name = pty
    link = open_transport(name)
    link.close()
    link.close()
    with pytest.raises(LinkLostError):
        link.read(0.01)
    with pytest.raises(LinkLostError):
        link.write(b"x")


@pytest.fixture
def server():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(HANG_S)
        yield listening


def test_a_socket_is_read_in_large_pieces_although_in_waiting_says_one(server):
    with open_transport(f"serial:socket://127.0.0.1:{server.getsockname()[1]}") as link:
        peer, _ = server.accept()
        with peer:
            peer.settimeout(HANG_S)
            assert link.read(0.01) is None
            peer.sendall(b"x" * 20000)
            chunks = []
            while sum(map(len, chunks)) < 20000:
                chunk = link.read(HANG_S)
                assert chunk is not None
                assert len(chunk) <= MAX_CHUNK_BYTES
                chunks.append(chunk)
            assert len(chunks) < 100
            link.write(b"hello")
            assert peer.recv(10) == b"hello"
        with pytest.raises(LinkLostError, match="is gone"):
            link.read(HANG_S)


def test_a_loop_delivers_through_the_polled_path():
    with open_transport("serial:loop://") as link:
        assert link.read(0.01) is None
        link.write(b"hello")
        assert read_exactly(link, 5) == b"hello"


def test_no_such_port_lists_what_there_is():
    with pytest.raises(PortNotFoundError, match=r"there is no port /dev/ttyNOPE.*port"):
        open_transport("/dev/ttyNOPE")


def test_a_socket_nobody_listens_at_is_one_sentence():
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # and kept, so that nobody else listens there meanwhile
        port = closed.getsockname()[1]
        with pytest.raises(PortNotFoundError, match=f"nothing answers at socket://127.0.0.1:{port}"):
            open_transport(f"socket://127.0.0.1:{port}")


@pytest.mark.parametrize("target", ["socket://127.0.0.1", "socket://127.0.0.1:99999", "socket://:", "foo://x"])
def test_an_impossible_url_is_wrong_use(target):
    with pytest.raises(UsageError, match=r"is not a URL that can be opened: write it like"):
        open_transport(f"serial:{target}")


def test_a_file_is_not_a_serial_port(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("hello")
    with pytest.raises(LinkError, match="is not a serial port"):
        open_transport(str(path))


def test_permission_denied_names_the_group_and_the_command():
    error = serial.SerialException(errno.EACCES, "could not open port /dev/ttyACM0: [Errno 13] Permission denied")
    told = translate_open_error(error, "/dev/ttyACM0", [], platform="linux")
    assert isinstance(told, PortPermissionError)
    assert "sudo usermod -aG" in told.remedy
    assert "dialout" in str(told) or "uucp" in str(told)
    assert "cu." in translate_open_error(error, "/dev/tty.usb", [], platform="darwin").remedy


def test_windows_says_busy_and_missing_only_in_the_text():
    denied = serial.SerialException("could not open port 'COM3': PermissionError(13, 'Access is denied.', None, 5)")
    assert isinstance(translate_open_error(denied, "COM3", [], platform="win32"), PortBusyError)
    missing = serial.SerialException("could not open port 'COM9': FileNotFoundError(2, 'not found', None, 2)")
    told = translate_open_error(missing, "COM9", ["COM3", "COM4"], platform="win32")
    assert isinstance(told, PortNotFoundError)
    assert "COM3, COM4" in told.remedy


@pytest.mark.parametrize(
    "error",
    [
        serial.SerialException("read failed: [Errno 5] Input/output error"),
        serial.SerialException("device reports readiness to read but returned no data"),
        OSError(errno.EIO, "Input/output error"),
        TypeError("integer argument expected, got 'NoneType'"),
        ValueError("file descriptor cannot be a negative integer (-1)"),
        serial.PortNotOpenError(),
    ],
)
def test_every_family_of_failures_is_one_lost_link(error):
    told = translate_io_error(error, "serial:/dev/ttyACM0")
    assert isinstance(told, LinkLostError)
    assert told.exit_code == 3
    assert "\n" not in str(told)
    assert not re.search(r"NoneType|descriptor|returned no data", str(told))


def test_who_holds_a_port_is_read_from_proc(tmp_path):
    device = tmp_path / "ttyACM0"
    device.touch()
    held = tmp_path / "proc" / "4711" / "fd"
    held.mkdir(parents=True)
    (held / "3").symlink_to(device.resolve())
    (held.parent / "cmdline").write_bytes(b"/usr/bin/python3\0-P\0/usr/bin/rotdrift\0capture\0")
    other = tmp_path / "proc" / "4712" / "fd"
    other.mkdir(parents=True)
    (other / "3").symlink_to(tmp_path)
    (tmp_path / "proc" / "self").mkdir()
    assert port_owners(str(device), proc=tmp_path / "proc") == ["rotdrift (process 4711)"]
    assert port_owners(str(device), proc=tmp_path / "nothing") == []


def test_a_reading_thread_leaves_no_thread_and_no_descriptor_behind(pty):
    from host.links.reader_thread import ReaderThread

    master, name = pty
    descriptors = Path("/proc/self/fd")
    before = len(list(descriptors.iterdir())) if descriptors.is_dir() else None
    reader = ReaderThread(open_transport(name))
    reader.start()
    os.write(master, b"abc")
    chunks = []
    wait_for(lambda: sum(map(len, chunks)) >= 3, "three bytes", lambda: chunks.extend(reader.take(1.0)))
    assert reader.stop(HANG_S)  # it waits 0.05 s; the rest is for a busy machine
    assert b"".join(chunk.data for chunk in chunks) == b"abc"
    assert reader.error is None
    assert not [thread for thread in threading.enumerate() if thread.name == "rotdrift-reader"]
    if before is not None:
        assert len(list(descriptors.iterdir())) == before
