"""The reading thread: hands over, never waits on a live link, tells how it ended."""

import pytest

from host.errors import LinkLostError
from host.links.reader_thread import ReaderThread
from host.links.transport import Chunk, FrameChunk
from tests.memory_transport import MemoryTransport
from tests.waiting import HANG_S, wait_for


def collect(reader, until):
    chunks = []
    wait_for(lambda: until(chunks), lambda: f"chunks; {len(chunks)} came", lambda: chunks.extend(reader.take(0.05)))
    return chunks


def test_chunks_arrive_in_order_with_their_times():
    sent = [Chunk(bytes([i]), 1000 + i) for i in range(50)]
    reader = ReaderThread(MemoryTransport(sent, ends=True))
    reader.start()
    assert collect(reader, lambda _: reader.ended) == sent
    assert reader.error is None
    assert reader.stop(HANG_S)


def test_a_lost_link_is_handed_over_after_the_data():
    link = MemoryTransport([Chunk(b"a", 1)])
    link.fail(LinkLostError("the cable is out"))
    reader = ReaderThread(link)
    reader.start()
    assert b"".join(c.data for c in collect(reader, lambda _: reader.ended)) == b"a"
    assert isinstance(reader.error, LinkLostError)
    assert reader.stop(HANG_S)
    assert link.closed


def test_an_unforeseen_failure_of_a_driver_does_not_kill_the_thread_silently():
    link = MemoryTransport()
    link.fail(ZeroDivisionError("driver bug"))
    reader = ReaderThread(link)
    reader.start()
    collect(reader, lambda _: reader.ended)
    assert "ZeroDivisionError" in str(reader.error)
    assert isinstance(reader.error.__cause__, ZeroDivisionError)
    assert reader.stop(HANG_S)


@pytest.fixture
def short_queue(monkeypatch):
    monkeypatch.setattr("host.links.reader_thread.MAX_QUEUED_CHUNKS", 10)


@pytest.mark.usefixtures("short_queue")
def test_on_a_live_link_a_full_queue_drops_and_counts():
    link = MemoryTransport()
    reader = ReaderThread(link)
    for i in range(25):
        link.deliver(Chunk(bytes([i]), i))
    reader.start()
    wait_for(lambda: reader.overflow_chunks >= 15, "dropped chunks")
    assert reader.overflow_chunks == 15
    assert [c.host_time_ns for c in reader.take(0)] == list(range(10))
    assert reader.stop(HANG_S)


@pytest.mark.usefixtures("short_queue")
def test_a_replay_waits_instead_of_dropping():
    sent = [Chunk(b"x", i) for i in range(200)]
    reader = ReaderThread(MemoryTransport(sent, ends=True))
    reader.start()
    assert collect(reader, lambda _: reader.ended) == sent
    assert reader.overflow_chunks == 0
    assert reader.stop(HANG_S)


@pytest.mark.usefixtures("short_queue")
@pytest.mark.parametrize("waiting", [True, False])
def test_it_stops_soon_even_while_nobody_takes(waiting):
    sent = [Chunk(b"x", i) for i in range(200)] if waiting else []
    reader = ReaderThread(MemoryTransport(sent, ends=waiting))
    reader.start()
    assert reader.stop(HANG_S)  # it waits 0.05 s; the rest is for a busy machine


def test_with_a_pause_what_follows_is_joined_and_has_the_time_of_the_last():
    link = MemoryTransport([Chunk(bytes([i]), 1000 + i) for i in range(51)])
    reader = ReaderThread(link, pause_s=0.001)
    reader.start()
    chunks = collect(reader, lambda got: sum(map(len, got)) == 51)
    assert b"".join(chunk.data for chunk in chunks) == bytes(range(51))
    assert [chunk.host_time_ns for chunk in chunks] == [*range(1001, 1050, 2), 1050]
    assert reader.stop(HANG_S)


def test_with_a_pause_a_lone_chunk_and_one_before_a_cut_keep_their_own_times():
    reopened = Chunk(b"", 3)
    link = MemoryTransport([Chunk(b"a", 1), Chunk(b"b", 2), Chunk(b"c", 3), reopened, Chunk(b"d", 4)])
    link.fail(LinkLostError("the cable is out"))
    reader = ReaderThread(link, pause_s=0.001)
    reader.start()
    chunks = collect(reader, lambda _: reader.ended)
    assert chunks == [Chunk(b"ab", 2), Chunk(b"c", 3), reopened, Chunk(b"d", 4)]
    assert isinstance(reader.error, LinkLostError)
    assert reader.stop(HANG_S)


def test_frames_are_not_held_back_by_a_pause():
    sent = [FrameChunk(b"x", i) for i in range(5)]
    reader = ReaderThread(MemoryTransport(sent), pause_s=0.001)
    reader.start()
    assert collect(reader, lambda got: len(got) == 5) == sent
    assert reader.stop(HANG_S)
