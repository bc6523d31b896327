"""The offline pass: centred windows, steps and segments of a recording."""

import math

import numpy as np
import pytest

from host.clock import remap as offline
from tests.clock_chunks import remapped as remap

MODULUS = 2**32
START_NS = 77 * 10**12


def recording(start_s=0.0, stop_s=60.0, skew_ppm=100.0, origin_us=0, delay_s=0.0):
    """One sample every 10 ms: raw ticks, arrivals and the true host times, ns."""
    seconds = np.arange(round(100 * start_s), round(100 * stop_s)) / 100
    ticks = origin_us + np.rint(1e6 * seconds * (1 + 1e-6 * skew_ppm)).astype(np.int64)
    true_ns = START_NS + np.rint(1e9 * seconds).astype(np.int64)
    return (
        (ticks % MODULUS).astype(np.uint32),
        true_ns + np.rint(1e9 * delay_s * np.ones(len(seconds))).astype(int),
        true_ns,
    )


def joined(*parts):
    return [np.concatenate(column) for column in zip(*parts, strict=True)]


def test_a_perfect_link_over_the_wrap():
    ticks, arrival, true_ns = recording(stop_s=200.0, origin_us=MODULUS - 50_000_000)
    result = remap(ticks, arrival)
    assert np.abs(result.host_time_ns - true_ns).max() < 3_000
    assert result.segment.max() == 0
    (segment,) = result.segments
    assert segment.skew_ppm == pytest.approx(100.0, abs=0.05)
    assert (segment.start, segment.stop, segment.n_chunks, segment.bursty) == (0, 20_000, 20_000, False)
    assert result.steps == ()


def test_stalls_at_both_ends_do_not_bend_the_line():
    delay = np.full(6000, 0.001)
    delay[:300] += 0.4
    delay[-300:] += 0.4
    ticks, arrival, true_ns = recording(delay_s=delay)
    arrival = np.maximum.accumulate(arrival)
    result = remap(ticks, arrival)
    assert result.host_time_ns - true_ns == pytest.approx(np.full(6000, 1e6), abs=10_000)


def test_wander_is_followed():
    seconds = np.arange(0, 600, 0.01)
    lead_s = 100e-6 * seconds + 20e-6 * 100 * np.sin(seconds / 100)  # skew 100 +- 20 ppm
    ticks = np.rint(1e6 * (seconds + lead_s)).astype(np.int64)
    true_ns = START_NS + np.rint(1e9 * seconds).astype(np.int64)
    error = remap(ticks, true_ns).host_time_ns - true_ns
    # chords of a sine: at most curvature * window^2 / 8 = 20e-6 / 100 * 60^2 / 8 s
    assert np.abs(error[4000:-4000]).max() < 90e3 + 3e3
    assert np.abs(error).max() < 4 * 90e3


def test_reset_and_known_start_and_small_step():
    first = recording(0.0, 30.0, origin_us=600_000_000)
    rebooted = recording(30.0, 60.0, origin_us=-29_000_000)
    reopened = recording(60.0, 90.0, origin_us=-29_000_000)
    jumped = recording(90.0, 130.0, origin_us=-28_700_000)
    ticks, arrival, true_ns = joined(first, rebooted, reopened, jumped)
    result = remap(ticks, arrival, segment_starts=[6000])
    assert [segment.start for segment in result.segments] == [0, 3000, 6000, 9000]
    assert np.abs(result.host_time_ns - true_ns).max() < 5_000
    assert [(step.index, result.segment[step.index]) for step in result.steps] == [(3000, 1), (9000, 3)]
    assert result.steps[1].disagreement_us == pytest.approx(300_000, abs=100)


def test_backward_step_is_found_where_it_was():
    ticks, arrival, true_ns = joined(
        recording(0.0, 60.0, origin_us=10**7), recording(60.0, 120.0, origin_us=10**7 - 200_000)
    )
    result = remap(ticks, arrival)
    (step,) = result.steps
    assert abs(step.index - 6000) <= 100
    clear = np.ones(len(ticks), bool)
    clear[5900:6100] = False
    assert np.abs(result.host_time_ns - true_ns)[clear].max() < 5_000


def test_a_short_segment_borrows_the_skew():
    ticks, arrival, true_ns = joined(recording(0.0, 60.0), recording(60.0, 63.0, origin_us=900_000_000))
    result = remap(ticks, arrival)
    assert len(result.segments) == 2
    assert result.segments[1].skew_ppm == pytest.approx(100.0, abs=1.0)
    assert np.abs(result.host_time_ns - true_ns).max() < 3_000


def test_a_short_segment_tells_no_skew_of_its_own():
    rng = np.random.default_rng(2)
    long = recording(0.0, 60.0, delay_s=rng.uniform(0, 2e-3, 6000))
    short = recording(60.0, 63.0, origin_us=900_000_000, delay_s=rng.uniform(0, 2e-3, 300))
    result = remap(*joined(long, short)[:2])
    assert result.segments[1].skew_ppm == pytest.approx(result.segments[0].skew_ppm, abs=1.0)


def test_samples_before_the_first_good_arrival_lie_on_the_line_too():
    delay = np.zeros(6000)
    delay[:90] = np.linspace(0.8, 0.0, 90)  # a backlog that drains
    ticks, arrival, true_ns = recording(skew_ppm=400.0, delay_s=delay)
    assert np.abs(remap(ticks, arrival).host_time_ns - true_ns).max() < 10_000


def test_a_gap_of_an_hour_is_bridged():
    ticks, arrival, true_ns = joined(recording(0.0, 60.0), recording(3660.0, 3720.0))
    result = remap(ticks, arrival)
    assert len(result.segments) == 1
    assert np.abs(result.host_time_ns - true_ns).max() < 5_000


def test_within_a_segment_order_by_device_time_is_order_by_host_time():
    rng = np.random.default_rng(0)
    ticks, arrival, _ = recording(delay_s=np.sort(rng.exponential(5e-3, 6000)))
    ticks[[100, 101]] = ticks[[101, 100]]
    result = remap(ticks, arrival)
    assert (np.diff(result.host_time_ns[np.argsort(ticks)]) > 0).all()


def test_empty_and_single():
    assert remap([], []).segments == ()
    assert remap([5], [START_NS]).host_time_ns.tolist() == [START_NS]


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="do not fit"):
        remap([1, 2], [1])
    with pytest.raises(ValueError, match="backwards at sample 2"):
        remap([1, 2, 3], [1, 5, 4])


def test_where_host_time_stands_still_no_skew_is_known():
    """Thirty years of device time in a nanosecond: only a damaged recording claims that."""
    (segment,) = offline.remap([0, 10**15], [999_999_999, 10**9]).segments
    assert math.isnan(segment.skew_ppm)
    (segment,) = offline.remap([0, 10**7, 2 * 10**7], [0, 10**10, 2 * 10**10]).segments
    assert segment.skew_ppm == pytest.approx(0.0, abs=1e-9)
