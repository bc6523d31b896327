"""Interval, Hotelling's test and detectable drift against scipy.stats, closed forms and simulation."""

import numpy as np
import pytest
from scipy import stats

from analysis.geometry import rotations
from analysis.scoring.interval import MAX_CORRELATION, drift_interval, hotelling_p
from analysis.sensor.baseline import StaticBaseline

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0


def steps_about_axis(*degrees):
    return rotations.exp(np.radians(degrees)[:, None] * AXIS)


def test_one_axis_case_is_student_s_interval_widened():
    degrees = np.array([1.0, 3.0, 2.0, 4.0, 1.5, 2.5])
    interval = drift_interval(steps_about_axis(*degrees))
    error = degrees.std(ddof=1) / np.sqrt(6)
    assert interval.delta_error_deg == pytest.approx(error, rel=1e-3)
    assert interval.jackknife_error_deg == pytest.approx(error, rel=1e-3)  # the mean's jackknife is the same
    off = degrees - degrees.mean()
    rho = np.clip((off[1:] @ off[:-1]) / (off @ off) + 1 / 6, 0, MAX_CORRELATION)
    assert interval.correlation == pytest.approx(rho, abs=1e-3)
    half = stats.t.ppf(0.975, 5) * error * np.sqrt((1 + rho) / (1 - rho))
    assert interval.half_width_deg == pytest.approx(half, rel=2e-3)
    assert interval.low_deg == pytest.approx(degrees.mean() - half, rel=1e-2)
    assert interval.high_deg == pytest.approx(degrees.mean() + half, rel=1e-3)
    assert interval.n_steps == 6
    assert interval.level == 0.95
    assert interval.standard_error_deg == pytest.approx(half / stats.t.ppf(0.975, 5), rel=2e-3)


def test_the_larger_of_the_two_errors_counts():
    rng = np.random.default_rng(6)
    ratios = []
    for _ in range(20):
        vectors = np.radians(rng.normal(scale=1.0, size=(6, 3)))
        interval = drift_interval(rotations.exp(vectors))
        larger = max(interval.jackknife_error_deg, interval.delta_error_deg)
        rho = interval.correlation
        assert interval.half_width_deg == pytest.approx(stats.t.ppf(0.975, 5) * larger * np.sqrt((1 + rho) / (1 - rho)))
        assert interval.no_drift_p == pytest.approx(hotelling_p(vectors, (1 + rho) / (1 - rho)), rel=1e-9)
        ratios.append(interval.jackknife_error_deg / interval.delta_error_deg)
    assert min(ratios) < 0.9  # either can be the larger one
    assert max(ratios) > 1.1


@pytest.mark.parametrize("n_steps", [1, 2, 3])
def test_few_steps_have_no_interval(n_steps):
    assert drift_interval(steps_about_axis(*range(1, n_steps + 1))) is None
    assert drift_interval(steps_about_axis(1.0, 2.0, 1.5, 1.2)) is not None


def test_slow_scatter_widens_the_interval():
    rng = np.random.default_rng(1)
    noise = np.sort(rng.normal(size=12))  # as correlated as can be
    mixed = noise[rng.permutation(12)]
    slow = drift_interval(steps_about_axis(*(5 + noise)))
    fast = drift_interval(steps_about_axis(*(5 + mixed)))
    assert slow.correlation == MAX_CORRELATION
    assert slow.half_width_deg > 1.5 * fast.half_width_deg


def test_lower_end_is_zero_when_no_drift_cannot_be_excluded():
    rng = np.random.default_rng(2)
    interval = drift_interval(rotations.exp(np.radians(rng.normal(scale=0.5, size=(8, 3)))))
    assert interval.no_drift_p > 0.05
    assert interval.low_deg == 0.0
    assert interval.high_deg > 0.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("degrees", [0.0, 1.0])
def test_steps_without_any_scatter(degrees):
    interval = drift_interval(steps_about_axis(*[degrees] * 6))
    assert interval.low_deg == pytest.approx(degrees, abs=1e-9)
    assert interval.high_deg == pytest.approx(degrees, abs=1e-9)
    assert interval.no_drift_p == (1.0 if degrees == 0.0 else 0.0)


def test_hotelling_equals_its_textbook_form():
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(9, 3)) @ rng.normal(size=(3, 3)) + [0.3, -0.2, 0.5]
    mean, scatter = vectors.mean(axis=0), np.cov(vectors.T)
    t_squared = 9 * mean @ np.linalg.solve(scatter, mean)
    assert hotelling_p(vectors, 1.0) == pytest.approx(stats.f.sf(t_squared * 6 / (3 * 8), 3, 6), rel=1e-9)
    assert hotelling_p(vectors, 2.0) == pytest.approx(stats.f.sf(t_squared / 2 * 6 / (3 * 8), 3, 6), rel=1e-9)


def test_hotelling_is_a_t_test_when_all_is_along_one_axis():
    values = np.array([0.4, -0.1, 0.3, 0.2, 0.6, -0.3])
    expected = stats.ttest_1samp(values, 0.0).pvalue
    assert hotelling_p(values[:, None] * AXIS * 1e-3, 1.0) == pytest.approx(expected, rel=1e-9)


def test_hotelling_p_is_uniform_without_drift():
    rng = np.random.default_rng(4)
    values = [hotelling_p(rng.normal(size=(6, 3)), 1.0) for _ in range(600)]
    assert stats.kstest(values, "uniform").pvalue > 0.01


def sensor(rate_deg_per_min, noise_deg=0.0, walk_deg_per_sqrt_s=0.0):
    rate = (0.0, 0.0, rate_deg_per_min)
    return StaticBaseline(rate, (0.0, 0.0, 0.0), noise_deg, walk_deg_per_sqrt_s, duration_s=600.0, n_samples=60_000)


def test_heading_drift_bound():
    assert sensor(-6.0).per_cycle_deg(14.5) == pytest.approx(1.45)


def test_detectable_drift_of_pure_heading_is_rate_times_period():
    assert sensor(1.0).detectable_deg(5.0, 10) == pytest.approx(1 / 12)


@pytest.mark.parametrize(
    ("rate", "noise", "walk"), [(0.0, 0.3, 0.0), (2.0, 0.0, 0.05), (1.0, 0.1, 0.02), (0.0, 0.0, 0.0)]
)
def test_detectable_drift_equals_simulation(rate, noise, walk):
    rng = np.random.default_rng(5)
    period, n, trials = 4.0, 8, 20_000
    start, end = rng.normal(scale=noise / np.sqrt(3), size=(2, trials, 3))
    wander = rng.normal(scale=walk * np.sqrt((n - 1) * period) / np.sqrt(3), size=(trials, 3))
    theta = np.linalg.norm((end - start + wander) / (n - 1) + np.array([0, 0, rate * period / 60]), axis=1)
    expected = np.percentile(theta, 95)
    assert sensor(rate, noise, walk).detectable_deg(period, n) == pytest.approx(expected, rel=0.02)


def test_a_degree_a_minute_hides_a_tenth_of_a_degree_at_five_seconds():
    assert sensor(1.0, 0.05, 0.01).detectable_deg(5.0, 8) == pytest.approx(0.1, abs=0.02)
