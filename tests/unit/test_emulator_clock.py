"""The object's clock: skew, wander, inverse, restart and step."""

import numpy as np
import pytest

from emulator.device.clock import ClockSettings, DeviceClock

HOUR_S = np.linspace(0.0, 7200.0, 5001)


def test_a_perfect_clock_counts_microseconds_from_its_start():
    clock = DeviceClock(ClockSettings(skew_ppm=0.0, wander_ppm=0.0, start_us=4_294_967_295), seed=1)
    assert clock.read_us(0.0) == 4_294_967_295
    assert clock.read_us(1.0) == 4_295_967_295


@pytest.mark.parametrize("skew_ppm", [-200.0, 0.0, 35.0])
def test_rate_error_stays_within_skew_and_wander(skew_ppm):
    clock = DeviceClock(ClockSettings(skew_ppm=skew_ppm, wander_ppm=20.0), seed=3)
    rate_ppm = np.diff(clock.uptime_us(HOUR_S)) / np.diff(HOUR_S) - 1e6
    assert np.abs(rate_ppm - skew_ppm).max() <= 20.0 + 1e-6
    assert np.ptp(rate_ppm) > 5.0  # it does wander


def test_time_of_uptime_inverts_uptime_of_time():
    clock = DeviceClock(ClockSettings(skew_ppm=-500.0, wander_ppm=500.0, wander_period_s=10.0), seed=4)
    np.testing.assert_allclose(clock.time_s(clock.uptime_us(HOUR_S)), HOUR_S, atol=1e-9)


def test_restart_and_step_move_the_reading_and_nothing_else():
    clock = DeviceClock(ClockSettings(start_us=77, wander_ppm=0.0), seed=1)
    before = clock.uptime_us(np.array([100.0, 101.0]))
    clock.step(100.0, 5_000_000.0)
    np.testing.assert_allclose(clock.uptime_us(np.array([100.0, 101.0])), before + 5_000_000.0)
    clock.step(100.0, -1e15)
    assert clock.read_us(100.0) == 0
    clock.step(200.0, 1000.0)
    clock.restart(300.0)
    assert clock.uptime_us(np.array([300.0, 301.0])) == pytest.approx([0.0, before[1] - before[0]], abs=0.1)


def test_seed_decides_the_wander():
    readings = [DeviceClock(ClockSettings(wander_ppm=50.0), seed).uptime_us(HOUR_S) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(readings[0], readings[1])
    assert np.abs(readings[0] - readings[2]).max() > 10.0
