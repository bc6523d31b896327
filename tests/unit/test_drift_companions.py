"""The companions of θ̄ against closed forms on chains of known steps."""

import numpy as np
import pytest

from analysis.geometry import averages, rotations
from analysis.scoring import diagnostics
from analysis.scoring.card import rotation_drift
from analysis.scoring.diagnostics import drift_over_phase, orientation_at, pose_slope
from analysis.scoring.interval import leave_one_out
from analysis.series import OrientationSeries, SeriesError

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
ACROSS = np.array([1.0, 2.0, 0.0]) / np.sqrt(5.0)


def chain(steps_rad, start=(0.3, -0.5, 1.1)):
    quats = [rotations.exp(np.array(start))]
    for step in np.asarray(steps_rad):
        quats.append(rotations.multiply(rotations.exp(step), quats[-1]))
    return np.array(quats)


def drift_diagnostics(quats):
    return diagnostics.drift_diagnostics(quats, rotation_drift(quats))


def test_steps_about_one_axis():
    steps_deg = np.array([1.0, 3.0, -1.0, 2.0])
    companions = drift_diagnostics(chain(np.radians(steps_deg)[:, None] * AXIS))
    assert companions.n_steps == 4
    assert companions.mean_step_deg == pytest.approx(1.75)
    assert companions.median_step_deg == pytest.approx(1.5)
    assert companions.axis_share == pytest.approx(1.0)
    assert companions.net_rotation_deg == pytest.approx(5.0)
    assert companions.max_excursion_deg == pytest.approx(5.0)
    assert companions.dispersion_deg == pytest.approx(np.std(steps_deg, ddof=1), rel=1e-3)
    assert companions.without_first_deg == pytest.approx(4 / 3, rel=1e-3)
    assert companions.without_last_deg == pytest.approx(1.0, rel=1e-3)
    assert companions.leave_one_out_deg == pytest.approx((2 / 3, 2.0), rel=1e-3)
    poses = np.concatenate(([0], np.cumsum(steps_deg)))
    assert companions.slope_deg_per_cycle == pytest.approx(np.polyfit(np.arange(5), poses, 1)[0], rel=1e-9)
    np.testing.assert_allclose(companions.slope_axis, AXIS, atol=1e-12)
    np.testing.assert_allclose(companions.step_axes, np.array([1, 1, -1, 1])[:, None] * AXIS, atol=1e-12)


def test_share_along_the_axis_falls_with_scatter_across():
    steps = np.radians(1.0) * AXIS + np.radians(1.0) * np.array([1, -1, 1, -1])[:, None] * ACROSS
    companions = drift_diagnostics(chain(steps))
    assert companions.axis_share == pytest.approx(0.5, abs=0.01)
    assert companions.mean_step_deg == pytest.approx(np.sqrt(2), rel=1e-6)


def test_excursion_that_comes_back():
    steps = np.radians([4.0, 4.0, -4.0, -4.0])[:, None] * AXIS
    companions = drift_diagnostics(chain(steps))
    assert companions.max_excursion_deg == pytest.approx(8.0)
    assert companions.net_rotation_deg == pytest.approx(0.0, abs=1e-9)
    assert rotation_drift(chain(steps)).theta_bar_deg == pytest.approx(0.0, abs=1e-9)
    onward = drift_diagnostics(chain(np.radians([-3.0, 4.0, 4.0])[:, None] * AXIS))
    assert onward.max_excursion_deg == pytest.approx(5.0)  # from the first end point, not from the last


def test_leave_one_out_equals_scoring_the_rest():
    steps = rotations.exp(np.random.default_rng(1).normal(scale=0.05, size=(7, 3)))
    expected = [rotations.angle(averages.average(np.delete(steps, k, axis=0))) for k in range(7)]
    np.testing.assert_allclose(leave_one_out(steps), expected, rtol=1e-10)


def test_without_first_and_last_are_scores_of_fewer_end_points():
    quats = chain(np.random.default_rng(2).normal(scale=0.05, size=(6, 3)))
    companions = drift_diagnostics(quats)
    assert companions.without_first_deg == pytest.approx(rotation_drift(quats[1:]).theta_bar_deg, rel=1e-9)
    assert companions.without_last_deg == pytest.approx(rotation_drift(quats[:-1]).theta_bar_deg, rel=1e-9)


def test_one_step_has_no_leave_one_out():
    companions = drift_diagnostics(chain([0.1 * AXIS]))
    assert companions.leave_one_out_deg is None
    assert companions.without_first_deg is None


def test_slope_follows_past_half_a_turn():
    quats = chain(np.tile(np.radians(40.0) * AXIS, (30, 1)))  # 1200 degrees in all
    slope = pose_slope(rotations.log(rotation_drift(quats).step_rotations_wxyz))
    np.testing.assert_allclose(slope, np.radians(40.0) * AXIS, rtol=1e-9)


@pytest.mark.filterwarnings("error")
def test_no_motion_at_all_gives_finite_figures():
    companions = drift_diagnostics(np.tile([1.0, 0, 0, 0], (5, 1)))
    assert companions.axis_share == 0.0
    assert companions.slope_deg_per_cycle == 0.0
    assert companions.step_axes == ((0.0, 0.0, 0.0),) * 4


def swinging(drift_rad_per_cycle, n=1001, period=2.0):
    times = np.linspace(0.0, 10.0, n)
    swing = rotations.exp(np.outer(0.3 * np.sin(2 * np.pi * times / period), AXIS))
    creep = rotations.exp(np.outer(drift_rad_per_cycle * times / period, AXIS))
    return OrientationSeries(times, rotations.multiply(creep, swing), np.arange(n))


def test_drift_over_phase_is_flat_for_a_steady_creep():
    sweep = drift_over_phase(swinging(0.02), [0.5, 2.5, 4.5, 6.5, 8.5], n_phases=8)
    np.testing.assert_allclose(sweep.theta_bar_deg, np.degrees(0.02), rtol=1e-6)
    assert sweep.n_cycles == 4
    assert sweep.phases == (0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
    with pytest.raises(SeriesError, match="at least 3"):
        drift_over_phase(swinging(0.02), [0.5, 2.5])


def test_orientation_between_samples_and_beyond_the_ends():
    series = OrientationSeries(np.array([0.0, 1.0, 2.0]), rotations.exp(np.outer([0.0, 0.2, 0.6], AXIS)), np.arange(3))
    angles = rotations.angle(orientation_at(series, [-5.0, 0.0, 0.5, 1.0, 1.75, 2.0, 9.0]))
    np.testing.assert_allclose(angles, [0, 0, 0.1, 0.2, 0.5, 0.6, 0.6], atol=1e-12)
