"""Counters and readings that no object can have, with every checksum right: refused, counted, taken back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.sample_streams import turning
from firmware_protocol.can.frames import CanFrame, pack_frames
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info, OrientationBatch, Status, TimeReply
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk, FrameChunk
from host.losses.ledger import LossLedger
from host.losses.object_counts import room_for
from host.recording.load import assemble, load_trial
from host.recording.reader import RecordingReader
from host.recording.writer import RecordingWriter
from host.results.parts import losses_per_cycle
from host.results.result import ScoreOptions, score_trial
from host.stream.numbers import AGREEING, REFUSED, SequenceUnwrapper
from host.stream.round_trips import ClockRequests, round_trip
from host.stream.samples import SampleAssembler

PERIOD_US = 10_000
STEPS = [1] * 30 + [2, 5, 0, -1, -3, 100, 700, 20_000, -20_000, 33_000]
EDGES = st.one_of(
    st.integers(0, 2**64 - 1), st.sampled_from([0, 2**16, 2**31, 2**32, 2**48, 2**53, 2**63, 2**64 - 100, 2**64 - 1])
)


def batch(numbers, wire=None, times_us=None):
    numbers = np.asarray(numbers, dtype=np.int64)
    times_us = numbers * PERIOD_US if times_us is None else np.asarray(times_us)
    quats = turning(len(numbers), 100.0)
    wire = numbers if wire is None else np.asarray(wire)
    flags = np.zeros(len(numbers), np.uint8)
    return OrientationBatch((wire % 2**16).astype(np.uint16), (times_us % 2**32).astype(np.uint32), quats, flags)


def status(number, produced=None, dropped=0):
    produced = number if produced is None else produced
    return Status(number * PERIOD_US, samples_produced=produced, samples_dropped=dropped)


def host_ns(number):
    return 10**12 + number * PERIOD_US * 1000


def assembled(*items):
    """Feed samples (ranges) and STATUS packets in order."""
    assembler, blocks, now = SampleAssembler(), [], 0
    for item in items:
        if isinstance(item, Status):
            now = max(now, item.uptime_us % 10**9 // PERIOD_US)
        elif not isinstance(item, Info):
            now = int(np.max(item if isinstance(item, range) else item.device_time_us // PERIOD_US))
            item = batch(item) if isinstance(item, range) else item
        blocks += assembler.feed([item], host_ns(now))
    return assembler, blocks


def parts(losses):
    return losses.produced, losses.received, losses.lost, losses.rejected, losses.dropped


@pytest.mark.parametrize("absurd", [2**64 - 100, 10**6 + 100, 2**32 + 100, 40_000, 0])
def test_one_absurd_count_of_samples_changes_nothing(absurd):
    plain, _ = assembled(range(100), status(100), range(100, 200), status(200), range(200, 250))
    odd, _ = assembled(range(100), status(100), range(100, 200), status(200, absurd), range(200, 250))
    assert odd.losses() == plain.losses()
    assert parts(odd.losses()) == (250, 250, 0, 0, 0)
    assert odd.refused == ("1 STATUS had counters that cannot be: these are left out",)
    assert plain.refused == ()


@pytest.mark.parametrize("absurd", [2**64 - 100, 10**6, 1, 40_000])
def test_an_absurd_count_before_the_first_sample_opens_no_gap(absurd):
    assembler, blocks = assembled(status(0, absurd), range(5, 100), status(100), range(100, 120))
    losses = assembler.losses()
    assert losses.received == 115
    assert losses.lost <= 4, "those before the first sample, if a STATUS knew of them"
    assert sum(map(len, blocks)) == 115
    assert abs(int(blocks[-1].index[-1])) < 2**53


@pytest.mark.parametrize("dropped", [2**32 - 1, 101, 5000])
def test_more_dropped_than_produced_is_refused(dropped):
    assembler, _ = assembled(
        range(90), status(100, 100, dropped), range(100, 150), status(150, 150, 10), range(150, 160)
    )
    assert parts(assembler.losses()) == (160, 150, 0, 0, 10)


def test_what_a_status_had_too_many_is_taken_back_by_the_next():
    ledger = LossLedger()
    ledger.feed(np.arange(100))
    ledger.status(Status(10**6, samples_produced=100), room_for(0))
    ledger.status(Status(2 * 10**6, samples_produced=5100), room_for(10**6))  # by the time it could be
    assert ledger.report().produced == 5100
    ledger.feed(np.arange(100, 200))
    assert ledger.report().produced == 5100
    ledger.status(Status(3 * 10**6, samples_produced=200), room_for(0))
    assert parts(ledger.report()) == (200, 200, 0, 0, 0)
    assert ledger.report().exact
    assert ledger.refused == 0


def test_the_index_leaves_room_for_what_was_missing_behind_a_segments_last_sample():
    assembler, blocks = assembled(Info(1, 1), range(50), status(60), Info(1, 2), range(100, 120))
    assert blocks[-1].index.tolist() == list(range(60, 80))
    (run,) = assembler.missing_runs()
    assert (run.first, run.end) == (50, 60)


def test_two_that_agree_are_believed_against_the_one_before():
    ledger = LossLedger()
    ledger.feed(np.arange(100))
    ledger.status(Status(10**6, samples_produced=100 + 7 * 2**16), room_for(0))  # nothing contradicts it yet
    ledger.feed(np.arange(100, 200))
    for produced, refused in ((200, 1), (210, 1), (220, 1)):
        ledger.status(Status(2 * 10**6 + produced, samples_produced=produced), room_for(0))
        assert ledger.refused == refused
    assert parts(ledger.report()) == (220, 200, 20, 0, 0)


@pytest.mark.parametrize("away", [40_000, 300, -300, 20_000, -30_000])
def test_one_absurd_number_is_one_damaged_sample(away):
    numbers = np.arange(100)
    wire = numbers.copy()
    wire[50] += away
    assembler, blocks = assembled(batch(numbers, wire), range(100, 150))
    assert parts(assembler.losses()) == (150, 149, 0, 1, 0)
    index = np.concatenate([block.index for block in blocks])
    assert index.tolist() == [*range(50), *range(51, 150)]
    assert assembler.refused == ("1 samples had numbers that cannot be: they count as damaged",)


def test_numbers_that_did_start_again_are_believed_and_time_goes_on():
    numbers = np.arange(200)
    wire = np.concatenate([numbers[:100], np.arange(30_000, 30_100)])
    assembler, blocks = assembled(batch(numbers, wire))
    losses = assembler.losses()
    assert losses.received == 200 - (AGREEING - 1)
    assert losses.produced == losses.received
    assert losses.segments == 2
    times_s = np.concatenate([block.time_s for block in blocks])
    expected_s = [0.01] * 99 + [0.01 * AGREEING] + [0.01] * (100 - AGREEING)
    np.testing.assert_allclose(np.diff(times_s), expected_s, atol=1e-9)
    assert (np.diff(np.concatenate([block.index for block in blocks])) > 0).all()


@given(
    steps=st.lists(
        st.sampled_from([1] * 30 + [2, 5, 0, -1, -3, 100, 700, 20_000, -20_000, 33_000]), min_size=1, max_size=300
    ),
    pauses=st.lists(st.sampled_from([1] * 30 + [0, 2, 100, 40_000]), min_size=300, max_size=300),
    cuts=st.lists(st.integers(1, 80), min_size=1, max_size=40),
)
@settings(derandomize=True, deadline=None, max_examples=60)
def test_numbers_do_not_depend_on_how_many_are_fed_at_once(steps, pauses, cuts):
    sequence = (5 + np.cumsum(steps)).astype(np.int64).astype(np.uint16)
    times_us = 10_000 + np.cumsum(np.array(pauses[: len(steps)]) * PERIOD_US)

    def unwrapped(sizes):
        unwrapper, found, start = SequenceUnwrapper(), [], 0
        while start < len(sequence):
            stop = min(len(sequence), start + next(sizes))
            while start < stop:
                numbers = unwrapper.feed(sequence[start:stop], times_us[start:stop])
                found += numbers.tolist()
                start += len(numbers)
                if start < stop:
                    found.append("again")
                    unwrapper.restart()
        return found, unwrapper.period_us

    expected = unwrapped(iter(lambda: 1, None))
    assert unwrapped(iter(lambda: len(sequence), None)) == expected
    assert unwrapped(iter([*cuts, *[7] * len(sequence)])) == expected
    assert all(number == "again" or number == REFUSED or abs(number) < 2**50 for number in expected[0])


@pytest.mark.parametrize(
    ("receive_us", "transmit_us"),
    [(2**64 - 1, 2**64 - 2), (0, 2**64 - 1), (10**6, 10**6 + 2_000_000), (5, 4), (0, 60_000_000)],
)
def test_clock_readings_that_cannot_be_are_refused(receive_us, transmit_us):
    requests = ClockRequests(1.0, 0)
    requests.sent(3, 10**9)
    requests.receive(TimeReply(3, receive_us, transmit_us), 2 * 10**9)
    assert requests.take() == []
    assert requests.refused == 1


def test_of_a_clock_reading_the_high_bits_do_not_count():
    trip = round_trip(0, TimeReply(1, 2**64 - 50, 2**64 - 20), 10**6)
    assert trip is not None
    assert (trip.transmit_us - trip.receive_us, trip.receive_us) == (30, 2**56 - 50)


@given(produced=EDGES, dropped=st.integers(0, 2**32 - 1), uptime=EDGES, at=st.integers(0, 8), reply=EDGES)
@settings(derandomize=True, deadline=None, max_examples=30)
def test_no_value_on_the_wire_makes_a_score_impossible(produced, dropped, uptime, at, reply):
    """Everything between the wire and the result, with one STATUS and one TIME_REPLY of any values."""
    chunks = []
    for k in range(9):
        packets = [Info(1, 1)] if k == 0 else []
        packets.append(
            Status(uptime, samples_produced=produced, samples_dropped=dropped) if k == at else status(50 * k)
        )
        packets.append(TimeReply(1, reply, min(reply + 5, 2**64 - 1)))
        data = b"".join(encode_frame(encode_packet(packet)) for packet in packets)
        samples = b"".join(frame(number) for number in range(50 * k, 50 * k + 50))
        chunks.append(Chunk(data + samples, host_ns(50 * k + 50)))
    trial = assemble(chunks, "x")
    losses = trial.losses
    assert losses.produced == losses.received + losses.lost + losses.rejected + losses.dropped
    assert losses.received == 450
    assert losses.produced < 450 + 32_768 / 4
    assert all(cycle.produced >= 0 for cycle in losses_per_cycle(trial, [0.0, 1.0, 2.0, 4.0]))
    assert score_trial(trial, ScoreOptions(clock=True)).losses is not None


def frame(number):
    from firmware_protocol.packets import Orientation

    angle = 0.02 * number
    q_wxyz = (float(np.cos(angle)), float(np.sin(angle)), 0.0, 0.0)
    return encode_frame(encode_packet(Orientation(number % 2**16, number * PERIOD_US % 2**32, q_wxyz)))


@pytest.mark.parametrize("kind", [Chunk, FrameChunk])
def test_a_time_of_reception_that_no_clock_reads_is_damage(kind, tmp_path):
    frames = [CanFrame(0x183, bytes(8), host_time_ns=each) for each in (2**63 - 1, -(2**63), 5)]
    data = pack_frames(frames) if kind is FrameChunk else b"bytes"
    writer = RecordingWriter(tmp_path / "x.mcap", "memory:", 10**18, 10**12)
    for at_ns in (10**12, 2**62, 2**63 - 1, 2**64 - 1, 2 * 10**12):
        writer.add_received(kind(data, at_ns))
    writer.close()
    reader = RecordingReader(tmp_path / "x.mcap")
    assert [chunk.host_time_ns for chunk in reader.chunks()] == [10**12, 2 * 10**12]
    assert reader.damage
    trial = load_trial(tmp_path / "x.mcap")
    assert trial.damage
    assert trial.losses.produced == 0
    assert trial.clock is None
