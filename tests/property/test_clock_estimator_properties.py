"""ClockEstimator and remap under any arrivals: never an exception, never a sample mapped to after its arrival."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from host.clock.estimator import ClockEstimator
from tests.clock_chunks import UnwrappedChunks
from tests.clock_chunks import remapped as remap

GAPS_US = st.one_of(st.integers(-600_000, 600_000), st.integers(0, 100_000_000))
STREAM = st.lists(st.tuples(GAPS_US, st.integers(0, 3_000_000_000), st.integers(0, 40_000)), min_size=1, max_size=120)


@settings(max_examples=150, deadline=None)
@given(stream=STREAM, repeats=st.integers(1, 6))
def test_any_stream_is_taken_and_nothing_is_mapped_after_its_arrival(stream, repeats):
    estimator = ClockEstimator()
    device_us, host_ns = 1_000_000_000, 10**15
    for gap_us, gap_ns, span_us in stream * repeats:
        device_us += gap_us
        host_ns += gap_ns
        estimator.feed(device_us, host_ns, span_us)
        line = estimator.line
        assert line is not None
        assert int(line.to_host_ns(device_us)) <= host_ns + 1
        assert abs(line.slope) <= 0.5  # 500 ppm
    estimate = estimator.estimate()
    assert estimate.jitter_p50_ns >= 0
    assert estimate.n_bins <= 300


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), device_shift=st.integers(0, 10**12), host_shift_s=st.integers(0, 10**9))
def test_only_differences_of_time_matter(seed, device_shift, host_shift_s):
    rng = np.random.default_rng(seed)
    device = np.cumsum(rng.integers(5_000, 15_000, 4000))
    host = 10**9 + 1000 * device + rng.exponential(1e6, 4000).astype(np.int64)
    plain, shifted = ClockEstimator(), ClockEstimator()
    for x, h in zip(device.tolist(), host.tolist(), strict=True):
        plain.feed(x, h)
        shifted.feed(x + device_shift, h + host_shift_s * 10**9)
    here = plain.line.to_host_ns(device[-100:])
    there = shifted.line.to_host_ns(device[-100:] + device_shift) - host_shift_s * 10**9
    assert np.abs(here - there).max() <= 256  # a float of 10**18 ns is good to 128 ns


@settings(max_examples=100, deadline=None)
@given(
    ticks=st.lists(st.integers(0, 2**32 - 1), max_size=80),
    gaps=st.lists(st.integers(0, 10**12), min_size=80, max_size=80),
    starts=st.lists(st.integers(-2, 90), max_size=4),
)
@example(ticks=[1, 0], gaps=[0] * 80, starts=[])
def test_arbitrary_recordings_are_remapped(ticks, gaps, starts):
    arrival = np.cumsum(gaps[: len(ticks)], dtype=np.int64)
    result = remap(ticks, arrival, starts)
    assert result.host_time_ns.shape == (len(ticks),)
    assert [piece.stop - piece.start for piece in result.segments] == [
        int((result.segment == k).sum()) for k in range(len(result.segments))
    ]


@settings(max_examples=60, deadline=None)
@given(chunks=st.lists(st.tuples(st.lists(st.integers(0, 2**32 - 1), max_size=6), st.integers(0, 10**12)), max_size=40))
def test_arbitrary_chunks_are_mapped(chunks):
    unwrapper, clock, host_ns = UnwrappedChunks(), ClockEstimator(), 0
    for ticks, gap_ns in chunks:
        host_ns += gap_ns
        mapped = 0
        for number, piece in enumerate(unwrapper.pieces(ticks, host_ns)):
            if number:
                clock.new_segment()
            segment = clock.segment
            mapped += len(clock.map(piece, host_ns)) if len(piece) else 0
            assert clock.segment >= segment
        assert mapped == len(ticks)
        located_us = unwrapper.locate(ticks[0] if ticks else 0, host_ns)
        if located_us is not None:
            clock.feed_round_trip(host_ns - 1000, located_us, located_us, host_ns)
    assert clock.estimate() is None or clock.estimate().segment == clock.segment
