"""A lost link is opened again: with back-off, bounded, and nothing behind it mixes up who is there."""

import threading

import numpy as np
import pytest

from firmware_protocol.packets import Ack, AckCode, Info, OrientationBatch, PacketType, Status
from firmware_protocol.serial.decoder import StreamDecoder
from host.errors import LinkError, LinkLostError, WrongObjectError
from host.links.reconnecting import LONGEST_PAUSE_S, ReconnectingTransport
from host.links.transport import Chunk, joined
from host.recording.load import assemble
from host.stream.blocks import RESET
from host.stream.decoding import Link, grouped
from host.stream.held_samples import HELD_NS
from host.stream.samples import SampleAssembler
from host.stream.session import Phase, Session, SessionSettings
from tests.memory_transport import MemoryTransport
from tests.recorded_trials import scenario, virtual_chunks
from tests.waiting import wait_for, wait_for_event

MS = 1_000_000


class Bench:
    """A port that is there or not, and a clock that only waiting moves."""

    def __init__(self, give_up_s=10.0):
        self.now_ns = 0
        self.there = True
        self.closes_at_once = False
        self.blocks = None  # an event: opening waits for it
        self.tries_ns = []
        self.links = []
        self.transport = ReconnectingTransport(self._open, give_up_s, lambda: self.now_ns, self._sleep)

    def _open(self):
        self.tries_ns.append(self.now_ns)
        if not self.there:
            raise LinkError("no such port")
        if self.blocks is not None:
            wait_for_event(self.blocks, "the opening may go on")
        self.links.append(MemoryTransport())
        if self.closes_at_once:
            self.links[-1].fail(LinkLostError("memory: is gone", "plug it in"))
        return self.links[-1]

    def _sleep(self, seconds):
        self.now_ns += round(seconds * 1e9)

    def pull(self):
        self.there = False
        self.links[-1].fail(LinkLostError("memory: is gone", "plug it in"))

    def read(self, times=1):
        return [self.transport.read(0.0 if self.transport.connected else 0.05) for _ in range(times)]


def test_what_was_never_there_is_not_waited_for():
    with pytest.raises(LinkError, match="no such port"):
        ReconnectingTransport(lambda: (_ for _ in ()).throw(LinkError("no such port")), 10.0)


def test_a_pulled_cable_is_a_gap_and_an_empty_chunk():
    bench = Bench()
    bench.links[0].deliver(b"before", 0)
    assert bench.read() == [Chunk(b"before", 0)]
    bench.pull()
    assert bench.read() == [None]
    assert bench.links[0].closed
    assert not bench.transport.connected
    assert "opened again when it is back" in bench.transport.problems[0]
    bench.transport.write(b"lost")  # no error: whoever asks asks again
    assert set(bench.read(100)) == {None}
    bench.there = True
    back_ns = bench.now_ns
    got = []
    wait_for(lambda: got, "a chunk", lambda: got.extend(chunk for chunk in bench.read() if chunk is not None))
    assert got[0].data == b""
    assert got[0].host_time_ns - back_ns <= LONGEST_PAUSE_S * 1e9
    assert bench.transport.connected
    assert bench.transport.reconnects == 1
    assert bench.transport.problems == ()
    bench.links[1].deliver(b"after", 5)
    assert bench.read() == [Chunk(b"after", 5)]


def test_the_back_off_grows_and_is_bounded_and_so_is_the_waiting():
    bench = Bench(give_up_s=10.0)
    bench.pull()
    with pytest.raises(LinkLostError, match="memory: is gone, and did not come back within 10 s"):
        bench.read(10_000)
    assert 10.0 <= bench.now_ns / 1e9 < 10.5
    pauses_s = np.diff(bench.tries_ns) / 1e9
    assert pauses_s[0] < 0.05
    assert (np.diff(pauses_s[1:]) > -1e-9).all()
    assert pauses_s.max() == pytest.approx(LONGEST_PAUSE_S)
    assert len(bench.tries_ns) < 60


def test_a_server_that_accepts_and_closes_has_one_budget_for_all_attempts():
    bench = Bench(give_up_s=10.0)
    bench.closes_at_once = True
    bench.links[0].fail(LinkLostError("memory: is gone", "plug it in"))
    with pytest.raises(LinkLostError, match="memory: is gone, and did not come back within 10 s"):
        bench.read(10_000)
    assert 10.0 <= bench.now_ns / 1e9 < 10.5
    assert len(bench.tries_ns) < 60, "it is not asked again and again at once"
    assert all(link.closed for link in bench.links)


def test_a_link_over_which_the_object_was_heard_has_all_its_time_again():
    bench = Bench(give_up_s=10.0)
    for _ in range(3):
        bench.pull()
        bench.read(100)
        bench.there = True
        wait_for(lambda: bench.transport.connected, "the link", bench.read)
        bench.transport.proven()
        bench.now_ns += 9 * 10**9
    assert bench.transport.reconnects == 3


def test_an_opening_that_blocks_holds_nobody_up():
    bench = Bench(give_up_s=10.0)
    bench.pull()
    bench.there, bench.blocks = True, threading.Event()
    bench.read(5)
    wait_for(lambda: len(bench.tries_ns) > 1, "an attempt", bench.read)
    assert not bench.transport.connected
    assert bench.read(3) == [None, None, None]
    bench.now_ns += 11 * 10**9
    with pytest.raises(LinkLostError, match="did not come back"):
        bench.read(2)
    bench.transport.close()
    bench.blocks.set()  # what opens too late is closed again
    wait_for(lambda: len(bench.links) > 1 and bench.links[1].closed, "the late link is closed")


def test_without_patience_a_lost_link_is_lost():
    bench = Bench(give_up_s=0.0)
    bench.pull()
    with pytest.raises(LinkLostError, match="memory: is gone"):
        bench.read()


def test_closing_ends_the_waiting():
    bench = Bench()
    bench.pull()
    bench.read()
    bench.transport.close()
    with pytest.raises(LinkLostError):
        bench.read(10)


# ---- the session ----------------------------------------------------------------------------------------------------

ME = Info(device_id=7, boot_id=1, name="cube", rate_hz=100)


def samples(sequence, device_time_us):
    n = len(sequence)
    return OrientationBatch(
        np.array(sequence, np.uint16),
        np.array(device_time_us, np.uint32),
        np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        np.zeros(n, np.uint8),
    )


def streaming_session():
    session = Session(SessionSettings(), "memory:", 0)
    session.due(0)
    session.feed([ME], 40, 1 * MS)
    answer(session, 2 * MS)
    assert session.phase is Phase.STREAMING
    session.feed([samples([0], [0])], 20, 3 * MS)
    return session


def answer(session, now_ns):
    """Acknowledge the START that is due."""
    sent = [item for data in session.due(now_ns) for item in StreamDecoder().feed(data)]
    start = next(item for item in sent if item.packet_type is PacketType.START)
    session.feed([Ack(PacketType.START, start.command_id, AckCode.OK)], 10, now_ns + MS)


def test_the_same_object_is_asked_and_started_again():
    session = streaming_session()
    session.reopened(5000 * MS)
    assert session.phase is Phase.HANDSHAKE
    asked = [item for data in session.due(5001 * MS) for item in StreamDecoder().feed(data)]
    assert [item.packet_type for item in asked] == [PacketType.GET_INFO]
    session.feed([ME], 40, 5010 * MS)
    answer(session, 5011 * MS)
    assert session.phase is Phase.STREAMING
    assert session.error is None
    assert session.warnings == []


def test_another_object_is_refused():
    session = streaming_session()
    session.reopened(5000 * MS)
    session.due(5001 * MS)
    session.feed([Info(device_id=8, boot_id=1, name="other")], 40, 5010 * MS)
    assert isinstance(session.error, WrongObjectError)
    assert "other (0000000000000008) in place of cube (0000000000000007)" in str(session.error)


def test_an_object_that_was_there_may_take_its_time():
    session = streaming_session()
    session.reopened(5000 * MS)
    for now_ms in range(5000, 25000, 100):
        session.due(now_ms * MS)
    assert session.error is None
    assert session.phase is Phase.HANDSHAKE


def test_an_object_that_never_came_may_not():
    session = Session(SessionSettings(), "memory:", 0)
    session.reopened(100 * MS)
    for now_ms in range(100, 7000, 100):
        session.due(now_ms * MS)
    assert session.error is not None


def test_a_reset_while_the_link_was_away_is_told():
    session = streaming_session()
    session.reopened(5000 * MS)
    session.new_segment(RESET)
    session.feed([Info(device_id=7, boot_id=2, name="cube")], 40, 5010 * MS)
    assert session.warnings == ["the object was reset during the capture"]
    assert session.phase is Phase.STARTING


# ---- the samples ----------------------------------------------------------------------------------------------------


def fed(assembler, *steps):
    return [block for items, host_ms in steps for block in assembler.feed(items, host_ms * MS)]


def assembler_with_samples():
    assembler = SampleAssembler()
    fed(assembler, ([ME, samples(range(10), range(0, 100_000, 10_000))], 100))
    return assembler


def test_samples_wait_until_the_object_has_said_that_it_is_the_same():
    assembler = assembler_with_samples()
    assembler.reopened()
    assert fed(assembler, ([samples([50], [500_000]), Status(uptime_us=510_000, samples_produced=51)], 510)) == []
    (block,) = fed(assembler, ([ME], 520))
    assert block.index.tolist() == [50]
    assert block.time_s.tolist() == [0.5]
    (report,) = [assembler.losses()]
    assert (report.produced, report.received, report.missing) == (51, 11, 40)


def test_samples_of_another_object_never_get_into_the_trial():
    assembler = assembler_with_samples()
    assembler.reopened()
    other = Info(device_id=8, boot_id=9)
    assert fed(assembler, ([samples([50], [500_000])], 510), ([other], 520), ([samples([51], [510_000])], 530)) == []
    assert assembler.losses().received == 10
    fed(assembler, ([ME], 540))
    (block,) = fed(assembler, ([samples([52], [520_000])], 541))
    assert block.index.tolist() == [52]


def test_an_object_that_does_not_answer_again_is_believed_after_a_while():
    assembler = assembler_with_samples()
    assembler.reopened()
    assert fed(assembler, ([samples([50], [500_000])], 510)) == []
    late_ms = 511 + HELD_NS // MS
    assert len(fed(assembler, ([samples([400], [4_000_000])], late_ms))) == 2


def test_samples_held_at_the_end_are_not_lost():
    assembler = assembler_with_samples()
    assembler.reopened()
    fed(assembler, ([samples([50], [500_000])], 510))
    assert [block.index.tolist() for block in assembler.release()] == [[50]]


def test_a_nameless_object_is_captured_on():
    assembler = SampleAssembler()
    fed(assembler, ([samples(range(10), range(0, 100_000, 10_000))], 100))
    assembler.reopened()
    assert len(fed(assembler, ([samples([50], [500_000])], 510))) == 1


def test_a_cut_frame_does_not_swallow_the_first_one_after_it():
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=1.0)
    data = b"".join(chunk.data for chunk in chunks)
    at = data.rindex(b"\0", 0, len(data) // 2) - 5  # within a frame
    tail = data[data.index(b"\0", at) :].lstrip(b"\0")  # without the delimiter in front
    link = Link()
    before = [item for item in link.feed(Chunk(data[:at], 0)) if isinstance(item, OrientationBatch)]
    assert link.feed(Chunk(b"", 1)) == []
    after = [item for item in link.feed(Chunk(tail, 2)) if isinstance(item, OrientationBatch)]
    assert sum(map(len, before + after)) >= 97
    assert link.counters.crc_errors + link.counters.cobs_errors == 0


def test_joining_chunks_keeps_the_mark_of_a_reopened_link():
    chunks = [Chunk(b"a", 1), Chunk(b"b", 2), Chunk(b"", 3), Chunk(b"c", 4), Chunk(b"d", 5)]
    assert list(map(joined, grouped(chunks))) == [Chunk(b"ab", 2), Chunk(b"", 3), Chunk(b"cd", 5)]
    assert assemble(chunks, "x").reconnects == 1
