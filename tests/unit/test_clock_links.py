"""The goals on simulated links: 99 in 100 samples are mapped within the bound, live and offline.

Shorter than ``python -m benchmarks.clock_jitter``, which runs two hours of each link.
"""

import numpy as np
import pytest

from benchmarks.clock_jitter import GOALS_MS, causal, chunk_bounds, error_ms, regression
from benchmarks.clock_links import LINKS, device_samples
from host.clock.estimator import ClockEstimator
from tests.clock_chunks import remapped as remap

DURATION_S = 900.0


@pytest.mark.parametrize("busy", [False, True])
@pytest.mark.parametrize("name", list(GOALS_MS))
def test_jitter_goals(name: str, busy: bool):
    link = LINKS[name](np.random.default_rng(11), DURATION_S, busy)
    live = causal(link)
    assert live.warm_up_s < 200
    assert live.steps == 0
    assert np.percentile(error_ms(link, live.host_ns, live.warm_up_s), 99) <= GOALS_MS[name]
    assert live.estimate.bursty == (name == "ble")
    offline = remap(link.device_us % 2**32, link.arrival_ns)
    assert len(offline.segments) == 1
    assert np.percentile(error_ms(link, offline.host_time_ns), 99) <= 0.5 * GOALS_MS[name]


@pytest.mark.parametrize("name", ["usb", "ftdi"])
def test_the_offset_interval_holds_the_truth_from_the_start(name: str):
    rng = np.random.default_rng(4)
    link = LINKS[name](rng, 180.0, True)
    estimator = ClockEstimator()
    _, last = chunk_bounds(link)
    next_s = 0.0
    for k in last.tolist():
        device_us, true_ns = int(link.device_us[k]), 1e9 * float(link.true_s[k])
        estimator.feed(device_us, int(link.arrival_ns[k]))
        if link.true_s[k] < next_s:
            continue
        estimate = estimator.estimate()
        assert estimate.interval.high_ns >= true_ns - 1000 * device_us
        if next_s > 0.0:
            assert estimate.interval.low_ns <= true_ns - 1000 * device_us
            assert estimate.interval.consistent
        next_s += 4.9
        sent, received = true_ns - 1e6 * rng.exponential(1.0), true_ns + 1e6 * rng.exponential(1.0)
        assert estimator.feed_round_trip(int(sent), device_us, device_us, int(received) + 1) is None


def test_regression_is_worse_under_load():
    link = LINKS["usb"](np.random.default_rng(11), 300.0, True)
    live = causal(link)
    ours = np.percentile(error_ms(link, live.host_ns, 60.0), 99)
    assert np.percentile(error_ms(link, regression(link), 60.0), 99) > 10 * ours


@pytest.mark.parametrize("name", list(LINKS))
def test_links_deliver_everything_in_order_and_late(name: str):
    link = LINKS[name](np.random.default_rng(1), 60.0)
    assert (np.diff(link.arrival_ns) >= 0).all()
    assert (link.arrival_ns > 1e9 * link.true_s).all()
    again = LINKS[name](np.random.default_rng(1), 60.0)
    assert np.array_equal(link.arrival_ns, again.arrival_ns)


def test_the_simulated_clock_wanders_about_its_skew():
    device_us, true_s = device_samples(np.random.default_rng(1), 7200.0)
    ppm = 1e6 * (1e-6 * np.diff(device_us[::6000]) / np.diff(true_s[::6000]) - 1)
    assert 80 < ppm.min() < ppm.max() < 110
    assert ppm.max() - ppm.min() > 5
