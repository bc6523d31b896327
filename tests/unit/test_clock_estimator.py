"""ClockEstimator: exact lines, jitter, steps, gaps and the offset interval, against known clocks."""

import tracemalloc

import numpy as np
import pytest

from host.clock.estimator import ClockEstimator

S = 1_000_000  # us
OFFSET_NS = 123_456_789_012_345


class Device:
    """A clock with a constant skew; a chunk of one sample every 10 ms, late by the given delay."""

    def __init__(self, skew_ppm: float = 100.0, jumped_us: int = 0):
        self.rate = 1 + 1e-6 * skew_ppm
        self.jumped_us = jumped_us

    def host_ns(self, device_us: int) -> int:
        """True host time of a device reading."""
        return OFFSET_NS + round(1000 * (device_us - self.jumped_us) / self.rate)

    def device_us(self, seconds: float) -> int:
        return round(1e6 * seconds * self.rate) + self.jumped_us


def run(estimator, device, start_s, stop_s, delay_s=lambda _: 0.0, rate_hz=100):
    """Feed a stretch; return the steps told and the error of each newest sample's mapped time, us."""
    steps, errors = [], []
    for i in range(round(start_s * rate_hz), round(stop_s * rate_hz)):
        x = device.device_us(i / rate_hz)
        moved = estimator.feed(x, device.host_ns(x) + round(1e9 * delay_s(i / rate_hz)))
        if moved is not None:
            steps.append((i / rate_hz, moved))
        errors.append((estimator.line.to_host_ns(x) - device.host_ns(x)) / 1e3)
    return steps, np.array(errors)


@pytest.mark.parametrize("skew_ppm", [-200.0, -1.0, 0.0, 100.0, 200.0])
def test_a_perfect_link_gives_the_clock_back(skew_ppm: float):
    estimator, device = ClockEstimator(), Device(skew_ppm)
    _, errors = run(estimator, device, 0.0, 20.0)
    estimate = estimator.estimate()
    assert estimate.skew_ppm == pytest.approx(skew_ppm, abs=0.3)  # arrival and ticks are rounded
    assert abs(errors[1200:]).max() < 2.0
    ahead = [device.device_us(t) for t in (0.0, 10.0, 25.0)]
    assert estimator.line.to_host_ns(ahead) == pytest.approx([device.host_ns(x) for x in ahead], abs=5_000)
    assert (estimate.segment, estimate.n, estimate.warm, estimate.bursty) == (0, 2000, True, False)
    assert 9.0 <= estimate.warm_up_s <= 12.0


def test_jitter_is_that_of_the_link():
    rng = np.random.default_rng(5)
    delays = rng.gamma(2.0, 0.2e-3, 6000)
    estimator = ClockEstimator()
    run(estimator, Device(), 0.0, 60.0, lambda t: delays[round(100 * t)])
    estimate = estimator.estimate()
    last = delays[-2048:] - delays.min()
    assert estimate.jitter_p50_ns == pytest.approx(1e9 * np.percentile(last, 50), rel=0.1)
    assert estimate.jitter_p99_ns == pytest.approx(1e9 * np.percentile(last, 99), rel=0.1)
    assert 1e9 * np.median(delays) / 60e6 == pytest.approx(estimate.skew_uncertainty_ppm * 1e-3, rel=0.2)


def test_a_constant_delay_stays_in_the_offset_and_a_stall_does_not():
    estimator, device = ClockEstimator(), Device()
    _, errors = run(estimator, device, 0.0, 90.0, lambda t: 0.002 + (1.5 if 50 <= t < 53 else 0.0))
    assert errors[2000:] == pytest.approx(2000.0, abs=3.0)


def test_arrivals_before_the_line_lower_it_at_once():
    estimator, device = ClockEstimator(), Device()
    _, errors = run(estimator, device, 0.0, 60.0, lambda t: 0.004 if t < 30 else 0.001)
    assert errors[3000] == pytest.approx(1000.0, abs=3.0)
    assert (errors[3000:] <= 1003.0).all()


def test_forward_step_is_proven_by_the_first_early_arrival():
    estimator = ClockEstimator()
    assert run(estimator, Device(), 0.0, 40.0)[0] == []
    steps, errors = run(estimator, Device(jumped_us=300_000), 40.0, 60.0)
    assert steps == [(40.0, pytest.approx(-300e6, rel=1e-3))]
    assert estimator.segment == 1
    assert abs(errors).max() < 5.0  # at once: the skew was kept


def test_lasting_lateness_is_taken_for_a_backward_step():
    estimator = ClockEstimator()
    run(estimator, Device(), 0.0, 40.0)
    steps, errors = run(estimator, Device(jumped_us=-300_000), 40.0, 60.0)
    assert steps == [(pytest.approx(50.0, abs=1.1), pytest.approx(300e6, rel=1e-3))]
    assert estimator.segment_start_ns == pytest.approx(OFFSET_NS + 40e9, abs=1.1e9)
    assert abs(errors[1200:]).max() < 5.0


def test_passing_lateness_is_not():
    estimator = ClockEstimator()
    steps, _ = run(estimator, Device(), 0.0, 80.0, lambda t: 0.3 if 40 <= t < 48 else 0.0)
    assert steps == []


def test_round_trip_proves_a_backward_step():
    estimator = ClockEstimator()
    run(estimator, Device(), 0.0, 40.0)
    device = Device(jumped_us=-300_000)
    x = device.device_us(40.0)
    assert estimator.feed_round_trip(
        device.host_ns(x) - 1_000_000, x, x + 100, device.host_ns(x) + 2_000_000
    ) == pytest.approx(299e6, rel=1e-3)
    assert estimator.segment == 1
    assert estimator.estimate() is None
    assert run(estimator, device, 40.0, 50.0)[0] == []


def test_round_trips_make_the_offset_an_interval_that_holds_the_truth():
    rng = np.random.default_rng(3)
    estimator, device = ClockEstimator(), Device()
    run(estimator, device, 0.0, 2.0, lambda _: 0.003 + rng.exponential(1e-3))
    assert estimator.estimate().interval.low_ns is None
    widths = []
    for second in range(2, 100):
        run(estimator, device, second, second + 1, lambda _: 0.003 + rng.exponential(1e-3))
        x = device.device_us(second + 0.995)
        up, down = rng.exponential(1e-3, 2) + 0.2e-3
        sent, received = device.host_ns(x) - round(1e9 * up), device.host_ns(x + 500) + round(1e9 * down)
        assert estimator.feed_round_trip(sent, x, x + 500, received) is None
        estimate = estimator.estimate()
        truth = device.host_ns(estimate.reference_us) - 1000 * estimate.reference_us
        assert estimate.interval.low_ns <= truth <= estimate.interval.high_ns
        widths.append(estimate.interval.high_ns - estimate.interval.low_ns)
    assert estimate.interval.n_round_trips == 64
    assert 0.4e6 < np.median(widths[20:]) < 1.5e6  # the two constant parts, and little more
    assert estimate.interval.high_ns < estimate.offset_ns  # samples are 3 ms late, replies 0.2 ms: that is told


def test_a_round_trip_that_contradicts_itself_is_ignored():
    estimator, device = ClockEstimator(), Device()
    run(estimator, device, 0.0, 20.0)
    x, now = device.device_us(20.0), device.host_ns(device.device_us(20.0))
    assert estimator.feed_round_trip(now, x, x + 50_000, now + 1_000_000) is None  # 50 ms inside of 1 ms
    assert estimator.feed_round_trip(now, x, x - 1, now + 1_000_000) is None
    assert estimator.estimate().interval.n_round_trips == 0
    assert estimator.segment == 0


def test_a_device_that_stamps_requests_too_early_is_told():
    estimator, device = ClockEstimator(), Device()
    run(estimator, device, 0.0, 20.0)
    assert estimator.estimate().interval.consistent
    x, now = device.device_us(20.0), device.host_ns(device.device_us(20.0))
    assert estimator.feed_round_trip(now, x, x + 100, now + 2_000_000) is None
    assert estimator.estimate().interval.consistent
    assert estimator.feed_round_trip(now, x - 5_000, x + 100, now + 7_000_000) is None
    assert not estimator.estimate().interval.consistent


def test_a_gap_of_hours_keeps_the_skew_and_is_no_step():
    estimator, device = ClockEstimator(), Device()
    run(estimator, device, 0.0, 60.0)
    drifted = Device(jumped_us=-20_000)  # what 2 ppm of wander make of 10,000 s
    steps, errors = run(estimator, drifted, 10_060.0, 10_090.0)
    assert steps == []
    assert estimator.segment == 0
    assert abs(errors).max() < 5.0
    assert estimator.estimate().warm


def test_a_gap_forgets_what_it_makes_stale():
    estimator = ClockEstimator()
    run(estimator, Device(), 0.0, 60.0)
    run(estimator, Device(), 200.0, 205.0)
    estimate = estimator.estimate()
    assert not estimate.warm
    assert estimate.n_bins <= 5
    assert estimate.skew_ppm == pytest.approx(100.0, abs=1.0)


@pytest.mark.parametrize("skew_ppm", [-150.0, 150.0])
def test_a_new_segment_keeps_the_skew_only(skew_ppm: float):
    estimator = ClockEstimator()
    run(estimator, Device(skew_ppm), 0.0, 60.0)
    estimator.new_segment()
    assert estimator.segment == 1
    assert estimator.estimate() is None
    assert estimator.line is None
    rebooted = Device(skew_ppm, jumped_us=-60 * S)
    _, errors = run(estimator, rebooted, 60.0, 64.0)
    assert abs(errors).max() < 5.0
    assert (estimator.estimate().n, estimator.estimate().warm) == (400, False)


def test_bursts_lengthen_the_window():
    estimator, device = ClockEstimator(), Device()
    for i in range(200):
        x = device.device_us(0.03 * i)
        estimator.feed(x, device.host_ns(x), span_us=20_000)
    assert estimator.estimate().bursty
    assert estimator.estimate().window_s == 300.0


def test_slow_beats_lengthen_the_window():
    estimator = ClockEstimator()
    run(estimator, Device(), 0.0, 60.0, lambda t: 0.01 * (t % 25.0) / 25.0, rate_hz=20)
    assert estimator.estimate().bursty


def test_an_impossible_skew_is_not_believed():
    estimator = ClockEstimator()
    run(estimator, Device(900.0), 0.0, 6.0)
    assert estimator.estimate().skew_ppm == pytest.approx(500.0, abs=0.3)


def test_memory_is_bounded(monkeypatch):
    monkeypatch.setattr("host.clock.estimator.BURSTY_WINDOW_S", 60.0)
    estimator, device = ClockEstimator(), Device()
    run(estimator, device, 0.0, 300.0, rate_hz=10)  # past the window and the residuals kept
    tracemalloc.start()
    for i in range(3000, 6000):
        x = device.device_us(i / 10)
        estimator.feed(x, device.host_ns(x))
        estimator.feed_round_trip(device.host_ns(x), x, x, device.host_ns(x))
    current, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # What was kept before has been replaced by as much, now traced: 2048 residuals, 60 seconds, 64 round trips.
    assert current < 250_000
    assert estimator.estimate().n_bins <= 61
    assert estimator.estimate().interval.n_round_trips == 64
