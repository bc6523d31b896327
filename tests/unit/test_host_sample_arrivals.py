"""Which chunk brought which sample, and what the offline pass makes of it."""

from dataclasses import replace

import numpy as np
import pytest

from emulator.faults.definitions import FaultSettings
from firmware_protocol.can.frames import pack_frames
from firmware_protocol.packets import Info, OrientationBatch
from host.links.transport import Chunk, FrameChunk
from host.recording.arrivals import RecordedRoundTrips, SampleArrivals, offline_clock
from host.recording.assembly import TrialAssembly
from host.recording.load import assemble
from host.results.result import ScoreOptions, score_trial
from host.stream.decoding import Link
from host.stream.samples import SampleAssembler
from tests.can_traffic import object_at, sample_packets, timed
from tests.faulty_trials import faulty_chunks
from tests.recorded_trials import scenario, virtual_chunks


def gathered(chunks):
    assembly = TrialAssembly(None, RecordedRoundTrips(), lambda: 0.0)
    assembly.feed(chunks)
    return assembly.arrivals


def one_by_one(chunks):
    """Device time and arrival of every sample, each chunk decoded by itself."""
    link = Link()
    pairs = []
    for chunk in chunks:
        for item in link.feed(chunk):
            if isinstance(item, OrientationBatch):
                pairs += [(tick, chunk.host_time_ns) for tick in item.device_time_us.tolist()]
    return np.array(pairs, dtype=np.int64)


def recut(chunks, size):
    """The same bytes in chunks that end anywhere."""
    data = b"".join(chunk.data for chunk in chunks)
    start_ns = chunks[0].host_time_ns
    return [Chunk(data[at : at + size], start_ns + at * 40_000) for at in range(0, len(data), size)]


@pytest.mark.parametrize("size", [None, 7, 50, 1000])
def test_every_sample_gets_the_arrival_of_the_chunk_that_completed_it(size):
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=6.0)
    chunks = chunks if size is None else recut(chunks, size)
    arrivals = gathered(chunks)
    expected = one_by_one(chunks)
    assert arrivals.n_unplaced == 0
    _, times_us, arrival_ns = arrivals.samples()
    np.testing.assert_array_equal(times_us % 2**32, expected[:, 0])
    np.testing.assert_array_equal(arrival_ns, expected[:, 1])


@pytest.mark.parametrize("at_once", [1, 7])
def test_on_can_every_sample_has_the_time_of_its_own_frame(at_once):
    frames = timed(object_at(), sample_packets(1500), period_ns=1_000_000)
    batches = [frames[start : start + at_once] for start in range(0, len(frames), at_once)]
    chunks = [FrameChunk(pack_frames(batch), batch[-1].host_time_ns) for batch in batches]
    arrivals = gathered(chunks)
    _, ticks, times = arrivals.samples()
    assert len(ticks) + arrivals.n_unplaced == 1500
    assert len(ticks) >= 1000
    # A sample each millisecond on both clocks: the difference is the same for all, whatever the chunks are.
    assert np.unique(times - 1000 * ticks).tolist() == [1_000_000_000 - 100_000]


def test_damage_misplaces_nothing():
    bad = replace(scenario("bad-cable"), faults=FaultSettings(bit_error_rate=3e-4, garbage_probability=0.05))
    chunks, _ = faulty_chunks(bad)
    arrivals = gathered(chunks)
    expected = one_by_one(chunks)
    assert arrivals.n_unplaced == 0
    _, times_us, arrival_ns = arrivals.samples()
    np.testing.assert_array_equal(times_us % 2**32, expected[:, 0])
    np.testing.assert_array_equal(arrival_ns, expected[:, 1])


def test_the_result_tells_the_skew_and_the_jitter():
    skewed = scenario("ideal", clock={"skew_ppm": 60.0, "wander_ppm": 0.0})
    chunks, _ = virtual_chunks(skewed, chunk_s=0.001)
    clock = score_trial(assemble(chunks, "x"), ScoreOptions(clock=True)).to_json()["clock"]
    assert clock["skew_ppm"] == pytest.approx(60.0, abs=20.0)  # 50 s at 1 ms steps tell no more
    assert 0 <= clock["jitter_p50_ms"] <= clock["jitter_p99_ms"] < 1.5
    assert clock["steps"] == []
    assert clock["samples_unplaced"] == 0
    assert len(clock["segments"]) == 1


def test_resets_reopened_links_and_steps_are_segments():
    for name, segments, steps in (("reset", 2, 0), ("unplugged", 3, 0), ("troubled", 2, 1)):
        chunks, _ = faulty_chunks(scenario(name))
        clock = assemble(chunks, name).clock
        assert len(clock.segments) == segments, name
        assert len(clock.steps) == steps, name
    assert clock.steps[0].by_s == pytest.approx(30.0, abs=0.3)


def test_a_long_recording_is_thinned_and_says_the_same(monkeypatch):
    chunks, _ = virtual_chunks(scenario("ideal", clock={"skew_ppm": 60.0, "wander_ppm": 0.0}), chunk_s=0.002)
    whole = assemble(chunks, "x").clock
    monkeypatch.setattr("host.recording.arrivals.MAX_CHUNKS", 1500)
    thinned = assemble(chunks, "x").clock
    assert thinned.arrivals < 0.5 * whole.arrivals
    assert thinned.skew_ppm == pytest.approx(whole.skew_ppm, abs=15.0)


def test_nothing_is_nothing():
    assembler = SampleAssembler()
    arrivals = SampleArrivals(assembler)
    assert arrivals.remapped() is None
    assert offline_clock(None, 0) is None
    assembler.feed([Info(device_id=1, boot_id=2)], 5)
    assert arrivals.remapped() is None
