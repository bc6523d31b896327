"""DeviceClock: chunks of raw ticks to host time, over wraps, resets, reboots and round trips."""

import numpy as np
import pytest

from host.clock.device_clock import DeviceClock

MODULUS = 2**32
S = 1_000_000
HOST_NS = 55_555_000_000_000
FIRST_US = MODULUS - 5 * S  # wraps after five seconds


def feed(clock: DeviceClock, start_s: float, stop_s: float, origin_us: int = FIRST_US):
    """Chunks of two samples 10 ms apart, delivered 1 ms after the second; a device that is 50 ppm fast."""
    out = []
    for k in range(round(start_s * 50), round(stop_s * 50)):
        seconds = np.array([0.02 * k, 0.02 * k + 0.01])
        ticks = origin_us + np.rint(1e6 * seconds * 1.00005).astype(np.int64)
        arrival_ns = HOST_NS + round(1e9 * (seconds[1] + 0.001))
        out.append((seconds, clock.feed((ticks % MODULUS).astype(np.uint32), arrival_ns)))
    return out


def test_mapping_over_the_wrap():
    clock = DeviceClock()
    for seconds, mapped in feed(clock, 0.0, 40.0)[1000:]:
        assert (mapped.host_time_ns - HOST_NS) / 1e9 - 0.001 == pytest.approx(seconds, abs=5e-6)
        assert mapped.segment.tolist() == [0, 0]
        assert mapped.steps == ()
        assert len(mapped) == 2
    estimate = clock.estimate()
    assert estimate.skew_ppm == pytest.approx(50.0, abs=0.3)
    assert estimate.reference_us > MODULUS


def test_a_reset_inside_a_chunk_splits_it():
    clock = DeviceClock()
    feed(clock, 0.0, 30.0)
    old = (FIRST_US + round(30e6 * 1.00005)) % MODULUS
    mapped = clock.feed(np.array([old, 1_000, 11_000], np.uint32), HOST_NS + 30_031_000_000)
    assert mapped.segment.tolist() == [0, 1, 1]
    (step,) = mapped.steps
    assert (step.index, step.segment) == (1, 1)
    assert (mapped.host_time_ns[0] - HOST_NS) / 1e9 == pytest.approx(30.001, abs=5e-6)
    assert np.diff(mapped.host_time_ns[1:]) == pytest.approx(10_000_000, abs=1_000)
    assert clock.segment == 1


def test_a_step_too_small_for_the_unwrapper_is_told_too():
    clock = DeviceClock()
    feed(clock, 0.0, 30.0)
    chunks = feed(clock, 30.0, 35.0, origin_us=FIRST_US + 200_000)
    (step,) = chunks[0][1].steps
    assert step.disagreement_us == pytest.approx(200_000, abs=10)
    assert (step.index, step.segment, step.gap_ns) == (0, 1, 20_000_000)
    assert all(mapped.steps == () for _, mapped in chunks[1:])
    seconds, mapped = chunks[-1]
    assert (mapped.host_time_ns - HOST_NS) / 1e9 - 0.001 == pytest.approx(seconds, abs=5e-6)


def test_boot_id():
    clock = DeviceClock()
    assert not clock.boot(7)
    feed(clock, 0.0, 1.0)
    assert not clock.boot(7)
    assert clock.segment == 0
    assert clock.boot(8)
    assert clock.segment == 1
    assert clock.estimate() is None
    assert feed(clock, 1.0, 1.1, origin_us=0)[0][1].steps == ()  # told before, so no surprise


def test_new_segment_without_samples_is_none():
    clock = DeviceClock()
    assert clock.new_segment() == 0
    feed(clock, 0.0, 0.1)
    assert clock.new_segment() == 1
    assert clock.new_segment() == 1


def test_round_trip_with_wrapped_or_whole_uptime():
    clock = DeviceClock()
    feed(clock, 0.0, 20.0)
    for uptime in (FIRST_US + round(20e6 * 1.00005), (FIRST_US + round(20e6 * 1.00005)) % MODULUS):
        sent = HOST_NS + 20_000_000_000 - 700_000
        assert clock.feed_round_trip(sent, uptime, uptime + 100, sent + 1_600_000) is None
    estimate = clock.estimate()
    assert estimate.n_round_trips == 2
    assert estimate.offset_low_ns < estimate.offset_ns - 1_000_000 < estimate.offset_high_ns


def test_round_trip_of_another_life_is_ignored():
    clock = DeviceClock()
    assert clock.feed_round_trip(HOST_NS, 5, 6, HOST_NS + 1000) is None
    feed(clock, 0.0, 20.0)
    assert clock.feed_round_trip(HOST_NS, 900 * S, 900 * S + 10, HOST_NS + 20_000_000_000) is None
    assert clock.estimate().n_round_trips == 0


def test_round_trip_that_proves_a_step():
    clock = DeviceClock()
    feed(clock, 0.0, 20.0)
    late = FIRST_US + 20 * S - 400_000
    sent = HOST_NS + 20_000_000_000
    step = clock.feed_round_trip(sent, late, late + 100, sent + 1_000_000)
    assert step.disagreement_us == pytest.approx(-400_000, abs=3000)
    assert clock.segment == step.segment == 1


def test_empty_chunk():
    clock = DeviceClock()
    mapped = clock.feed([], HOST_NS)
    assert len(mapped) == 0
    assert clock.estimate() is None
