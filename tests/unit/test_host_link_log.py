"""``--debug-link``: what crosses a link, in hexadecimal with times; a log that fails stops nobody."""

import pytest

from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from host.errors import FileError, LinkError, LinkLostError
from host.links import link_log
from host.links.link_log import LinkLog
from host.links.reconnecting import ReconnectingTransport
from host.links.transport import Chunk, FrameChunk, LinkEnd
from tests.memory_transport import MemoryTransport

MS = 1_000_000


def logged(tmp_path, inner, now_ns=lambda: 5 * MS):
    return LinkLog(inner, tmp_path / "link.txt", now_ns)


def lines(tmp_path):
    text = (tmp_path / "link.txt").read_text().splitlines()
    assert text[0].startswith("# memory:, times in seconds")
    return text[1:]


def test_reads_writes_frames_and_the_end_are_written_down_with_their_times(tmp_path):
    frames = pack_frames([CanFrame(0x123, b"\1\2", FrameFlag(0), host_time_ns=9 * MS)])
    inner = MemoryTransport([Chunk(b"\0\xffa", 7 * MS), Chunk(b"", 8 * MS), FrameChunk(frames, 9 * MS)], ends=True)
    with logged(tmp_path, inner) as log:
        log.write(b"\1")
        assert log.read(0.1) == Chunk(b"\0\xffa", 7 * MS)
        log.read(0.1)
        log.read(0.1)
        with pytest.raises(LinkEnd):
            log.read(0.1)
    assert lines(tmp_path) == [
        "     0.000000 >    1  01",
        "     0.002000 <    3  00 ff 61",
        "     0.003000 ! the link is open again",
        "     0.004000 <    2  123#01 02 flags=0x0",
        "     0.000000 ! the end",
    ]


def test_a_lost_link_is_written_down_once_though_it_is_opened_again(tmp_path):
    links = [MemoryTransport()]
    links[0].fail(LinkLostError("memory: is gone"))

    def reopen():
        if links:
            return links.pop()
        raise LinkError("no such port")

    transport = ReconnectingTransport(reopen, 10.0, now_ns=lambda: 0, sleep=lambda _s: None)
    with logged(tmp_path, transport) as log:
        for _ in range(5):
            assert log.read(0.0) is None
        assert not log.connected
    assert [line.split("! ")[1] for line in lines(tmp_path)] == ["the link is lost"]


def test_a_log_that_is_there_already_or_cannot_be_made_closes_the_link(tmp_path):
    (tmp_path / "link.txt").write_text("mine")
    inner = MemoryTransport()
    with pytest.raises(FileError, match="exists already"):
        logged(tmp_path, inner)
    assert inner.closed
    with pytest.raises(FileError, match="cannot be created"):
        LinkLog(MemoryTransport(), tmp_path / "none" / "link.txt")


def test_a_log_that_is_full_ends_with_a_word_and_the_link_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(link_log, "MAX_LOG_BYTES", 200)
    inner = MemoryTransport([Chunk(bytes(40), k * MS) for k in range(9)], ends=True)
    with logged(tmp_path, inner) as log:
        for _ in range(9):
            assert len(log.read(0.1).data) == 40
        (problem,) = log.problems
    assert "the log of the link has ended (it is full)" in problem
    assert (tmp_path / "link.txt").stat().st_size < 500
