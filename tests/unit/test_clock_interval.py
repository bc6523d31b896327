"""The offset interval of the offline pass: it holds the truth, everywhere, and says when it cannot."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.clock_links import can, ftdi, usb
from host.clock.interval import RoundTrips
from tests.clock_chunks import remapped as remap

MODULUS = 2**32


def trips_on(link, rng, to_s, fro_s, every=100):
    """A round trip each second: both ways take ``to_s`` and ``fro_s`` at least, and some more by chance."""
    at = np.arange(every, len(link.device_us) - every, every)
    turn_us = 50
    sent_s = link.true_s[at] - to_s - rng.exponential(1e-3, len(at))
    received_s = link.true_s[at] + turn_us * 1e-6 * (1 - 1e-4) + fro_s + rng.exponential(1e-3, len(at))
    return RoundTrips(
        np.floor(1e9 * sent_s).astype(np.int64),
        link.device_us[at],
        link.device_us[at] + turn_us,
        np.ceil(1e9 * received_s).astype(np.int64),
    )


@pytest.mark.parametrize(("make", "widest_ms"), [(usb, 2.0), (can, 1.2), (ftdi, 3.0)])
def test_the_interval_holds_the_truth_of_every_sample(make, widest_ms):
    rng = np.random.default_rng(3)
    link = make(rng, 400.0)
    trips = trips_on(link, rng, 0.2e-3, 0.3e-3)
    origin_us = MODULUS - 100_000_000  # wraps on the way; the reply's u64 reading has no wrap
    result = remap((link.device_us + origin_us) % MODULUS, link.arrival_ns, round_trips=_moved(trips, origin_us))
    (segment,) = result.segments
    error_ns = 1e9 * link.true_s - result.host_time_ns
    assert segment.interval.n_round_trips == len(trips)
    assert segment.interval.consistent
    # Beyond the last whole beat the line may lie above the truth by what the tolerance stands for.
    assert segment.interval.low_ns <= error_ns.min() + 2e4
    assert segment.interval.high_ns >= error_ns.max() - 2e4
    assert 0 < segment.interval.high_ns - segment.interval.low_ns < 1e6 * widest_ms


def _moved(trips, by_us):
    return replace(trips, receive_us=trips.receive_us + by_us, transmit_us=trips.transmit_us + by_us)


def test_without_round_trips_there_is_no_lower_bound():
    link = usb(np.random.default_rng(1), 60.0)
    interval = remap(link.device_us, link.arrival_ns).segments[0].interval
    assert interval.low_ns is None
    assert interval.consistent
    assert 0.0 <= interval.high_ns < 1e6


def test_whoever_stamps_too_early_is_found_out():
    rng = np.random.default_rng(2)
    link = usb(rng, 120.0)
    honest = trips_on(link, rng, 0.2e-3, 0.3e-3)
    early = _moved(honest, -20_000)  # stamped with the clock reading of the last sample, say
    assert remap(link.device_us, link.arrival_ns, round_trips=honest).segments[0].interval.consistent
    assert not remap(link.device_us, link.arrival_ns, round_trips=early).segments[0].interval.consistent


def test_round_trips_of_another_boot_or_without_sense_are_left_out():
    rng = np.random.default_rng(2)
    link = usb(rng, 60.0)
    trips = trips_on(link, rng, 0.2e-3, 0.3e-3)
    backwards = replace(trips, transmit_us=trips.receive_us - 5)
    for nonsense in (_moved(trips, 10**9), backwards):
        interval = remap(link.device_us, link.arrival_ns, round_trips=nonsense).segments[0].interval
        assert interval.n_round_trips == 0
        assert interval.low_ns is None
