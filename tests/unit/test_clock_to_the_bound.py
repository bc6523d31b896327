"""The clock at its bounds, and many chunks at once against one by one: what usual recordings never meet."""

import math
from random import Random

import numpy as np
import pytest

from host.clock.envelope import line_with_slope
from host.clock.estimate import ClockEstimate
from host.clock.interval import OffsetInterval
from host.clock.unwrap import MAX_AHEAD_S, MAX_LATENCY_S, MAX_REORDER_S, ClockUnwrapper, changes

WRAP = 2**32
START_NS = 5_000_000_000_000


def unwrapper(device_us=0, host_ns=START_NS):
    """One that has had its first sample."""
    clock = ClockUnwrapper()
    clock.unwrap([device_us], host_ns)
    return clock


def state(clock):
    return {name: value for name, value in vars(clock).items() if name != "_start_ns"}


@pytest.mark.parametrize("dtype", [np.int64, np.uint16, np.uint32])
def test_changes_are_those_of_numpy(dtype):
    values = np.array([7, 3, 3, 9], dtype)
    found = changes(values, 5)
    assert found.dtype == dtype
    assert found.tolist() == np.diff(values, prepend=dtype(5)).tolist()
    assert changes(values[:1], 5).tolist() == [2]
    assert changes(values[:0], 5).tolist() == []
    assert values.tolist() == [7, 3, 3, 9]


@pytest.mark.parametrize("seed", range(40))
def test_many_chunks_at_once_are_unwrapped_as_one_by_one(seed):
    """With late, repeated and jittered samples, over a wrap; and the clock is left in the same state."""
    rng = Random(seed)
    first = rng.choice((0, WRAP - 50_000, WRAP // 2, rng.randrange(WRAP)))
    clock, other = unwrapper(first), unwrapper(first)
    ticks, hosts = [], []
    for number in range(1, rng.choice((2, 30, 200))):
        step_us = number * 10_000
        late_us = rng.choice((0, 0, 0, rng.randrange(100_000)))
        host_ns = START_NS + 1000 * step_us + rng.choice((0, 0, 5_000_000))
        hosts.append(max(host_ns, hosts[-1]) if hosts else host_ns)
        ticks.append((first + max(step_us - late_us, 0)) % WRAP)
        if rng.random() < 0.2:
            hosts.append(hosts[-1])
            ticks.append(ticks[-1])
    ticks, hosts = np.array(ticks, np.uint32), np.array(hosts, np.int64)
    many = clock.unwrap_many(ticks, hosts)
    assert many is not None
    single = [other.unwrap(ticks[hosts == time_ns], int(time_ns)) for time_ns in np.unique(hosts)]
    assert many.tolist() == np.concatenate(single).tolist()
    assert clock.newest_us == other.newest_us
    assert state(clock) == pytest.approx(state(other))


@pytest.mark.parametrize(
    ("ticks", "hosts"),
    [
        ([10_000], [START_NS - 1]),  # host time falls
        ([10_000], [START_NS + int(1e9 * MAX_LATENCY_S) + 1]),  # a stalled link
        ([10_000, 700_000], [START_NS, START_NS + 1]),  # more ahead than half of what is explained
        ([900_000, 100_000], [START_NS + 10**9] * 2),  # back by more than half of what reordering explains
        ([WRAP - 600_000], [START_NS]),  # before the newest
    ],
)
def test_what_is_in_doubt_is_left_to_the_chunk_by_chunk_way(ticks, hosts):
    clock = unwrapper()
    before = vars(clock).copy()
    assert clock.unwrap_many(np.array(ticks, np.uint32), np.array(hosts, np.int64)) is None
    assert vars(clock) == before
    assert ClockUnwrapper().unwrap_many(np.array([1], np.uint32), np.array([1], np.int64)) is None


@pytest.mark.parametrize(
    ("ticks", "hosts"),
    [
        ([10_000], [START_NS]),  # no time at all went by
        ([10_000, 10_000], [START_NS + 1, START_NS + 1]),
        ([int(1e6 * MAX_LATENCY_S)], [START_NS + int(1e9 * MAX_LATENCY_S)]),  # the longest wait
        ([int(0.5e6 * MAX_AHEAD_S)], [START_NS]),  # as far ahead as may be
        ([900_000, 900_000 - int(0.5e6 * MAX_REORDER_S)], [START_NS + 900_000_000] * 2),
    ],
)
def test_what_is_just_plain_is_unwrapped_at_once(ticks, hosts):
    assert unwrapper().unwrap_many(np.array(ticks, np.uint32), np.array(hosts, np.int64)).tolist() == ticks


def test_a_reading_is_plain_up_to_a_quarter_of_what_is_explained():
    clock = unwrapper(1_000_000)
    bound_us = int(0.25e6 * min(MAX_AHEAD_S, MAX_LATENCY_S))
    for sign in (1, -1):
        assert clock.is_plain(1_000_000 + sign * bound_us, START_NS)
        assert not clock.is_plain(1_000_000 + sign * (bound_us + 1), START_NS)
        assert clock.is_plain(2_000_000 + sign * bound_us, START_NS + 10**9)
    assert clock.is_plain(1_000_000 + WRAP, START_NS)
    assert not ClockUnwrapper().is_plain(0, 0)


def test_a_reading_is_located_up_to_the_longest_latency():
    clock = unwrapper(100_000_000)
    late_us = int(1e6 * MAX_LATENCY_S)
    assert clock.locate(100_000_000 - late_us, START_NS) == 100_000_000 - late_us
    assert clock.locate(100_000_000 - late_us - 1, START_NS) is None


def estimate(**values):
    defaults = {
        "segment": 0, "reference_us": 5, "offset_ns": 1.0, "skew_ppm": 12.5, "skew_uncertainty_ppm": 0.25,
        "interval": OffsetInterval(-2e6, 3e6, True, 7), "jitter_p50_ns": 4e6, "jitter_p99_ns": 9e6, "warm": True,
        "warm_up_s": 11.0, "n": 100, "n_bins": 10, "window_s": 60.0, "bursty": False,
    }  # fmt: skip
    return ClockEstimate(**{**defaults, **values})


def test_the_account_of_an_estimate_is_in_milliseconds():
    account = estimate().account()
    assert (account.skew_ppm, account.skew_uncertainty_ppm) == (12.5, 0.25)
    assert (account.offset_interval_ms, account.offset_uncertainty_ms) == ((-2.0, 3.0), 5.0)
    assert (account.jitter_p50_ms, account.jitter_p99_ms, account.warm_up_s) == (4.0, 9.0, 11.0)
    assert (account.consistent, account.round_trips, account.bursty) == (True, 7, False)


def test_the_account_has_none_where_nothing_is_known():
    account = estimate(
        warm=False, skew_uncertainty_ppm=math.inf, interval=OffsetInterval(None, 3e6, True, 0), warm_up_s=None
    ).account()
    assert (account.skew_ppm, account.skew_uncertainty_ppm, account.warm_up_s) == (None, None, None)
    assert (account.offset_interval_ms, account.offset_uncertainty_ms, account.round_trips) == (None, None, 0)
    contradicted = estimate(interval=OffsetInterval(5e6, 3e6, False, 1), bursty=True).account()
    assert (contradicted.offset_interval_ms, contradicted.offset_uncertainty_ms) == ((5.0, 3.0), None)
    assert (contradicted.consistent, contradicted.bursty) == (False, True)


def test_a_line_of_given_slope_is_anchored_at_its_newest_point():
    line = line_with_slope([(10, 500.0), (20, 300.0), (40, 900.0)], 2.0)
    assert line.delay_at(40) == 340.0
    assert line.delay_at(20) == 300.0
    with pytest.raises(ValueError, match=r"^an envelope needs at least one point$"):
        line_with_slope([], 1.0)
