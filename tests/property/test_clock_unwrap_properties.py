"""ClockUnwrapper under any split into chunks, any gaps, skew, jitter and small reordering: never a sample wrong."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.clock_chunks import UnwrappedChunks as ClockUnwrapper

MODULUS = 2**32


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    first=st.integers(0, MODULUS - 1),
    skew_ppm=st.floats(-200, 200),
    gap_scale_s=st.sampled_from([0.001, 0.1, 30.0, 3000.0, 20_000.0]),
    latency_s=st.sampled_from([0.001, 0.3, 20.0]),
)
def test_any_stream_is_unwrapped_without_an_error(seed, first, skew_ppm, gap_scale_s, latency_s):
    rng = np.random.default_rng(seed)
    unwrapper = ClockUnwrapper()
    arrival = np.cumsum(rng.exponential(gap_scale_s, 40))  # s
    sent_until = 0.0
    received, expected = [], []
    for host_s in arrival:
        # One chunk in five is late, up to a stall; it holds what was sampled before, but nothing that already came.
        late_s = rng.uniform(0, latency_s) if rng.random() < 0.2 else 0.001
        newest = max(sent_until, host_s - late_s)
        device_s = np.linspace(max(sent_until, newest - latency_s), newest, rng.integers(1, 30))
        sent_until = newest
        truth = first + np.rint(1e6 * device_s * (1 + 1e-6 * skew_ppm)).astype(np.int64)
        swap = rng.integers(0, len(truth))
        if swap and truth[swap] - truth[swap - 1] < 400_000:
            truth[[swap - 1, swap]] = truth[[swap, swap - 1]]
        received.append(unwrapper.feed((truth % MODULUS).astype(np.uint32), int(1e9 * host_s)))
        expected.append(truth)
    offset = expected[0][0] // MODULUS * MODULUS  # a segment starts within the first wrap
    assert np.array_equal(np.concatenate(received), np.concatenate(expected) - offset)
    assert unwrapper.take_steps() == []


@settings(max_examples=100, deadline=None)
@given(ticks=st.lists(st.integers(0, MODULUS - 1), max_size=60), cut=st.integers(0, 60), gap_ns=st.integers(0, 10**14))
def test_arbitrary_ticks_never_fail_and_stay_true_to_the_raw_value(ticks, cut, gap_ns):
    unwrapper = ClockUnwrapper()
    unwrapped = np.concatenate([unwrapper.feed(ticks[:cut], 0), unwrapper.feed(ticks[cut:], gap_ns)])
    assert np.array_equal(unwrapped % MODULUS, ticks)
    steps = unwrapper.take_steps()
    assert [step.segment for step in steps] == list(range(1, len(steps) + 1))
