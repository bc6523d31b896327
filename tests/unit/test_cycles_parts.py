"""The parts of the search for cycles, each against a closed form or plain code."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.cycles.axis import motion_axis
from analysis.cycles.endpoints import pose_jumps
from analysis.cycles.motion import angular_velocity
from analysis.cycles.online.peaks import PeakFilter
from analysis.cycles.period import find_period, vector_autocorrelation
from analysis.cycles.repetition import alternation, irregularity, likeness, rests, swing_trend
from analysis.cycles.settings import Endpoint
from analysis.cycles.turning_points import dwell, swings, turning_points, without_short_pairs
from analysis.cycles.usable_samples import Samples, lone_outliers, sample_noise_rad
from analysis.series import OrientationSeries
from tests.simulated_motion import from_angular_velocity, from_rotation_vectors, simulate, trapezoid


def velocity(series: OrientationSeries):
    motion = angular_velocity(Samples.of(series), rate_hz=100.0, sigma_s=0.04, moving_share=0.15)
    assert motion is not None
    return motion


def test_angular_velocity_of_a_steady_turn_in_world_axes():
    rate = np.array([0.3, -1.2, 0.5])
    motion = velocity(from_angular_velocity(np.tile(rate, (1000, 1))))
    np.testing.assert_allclose(motion.omega[20:-20], np.tile(rate, (len(motion.omega) - 40, 1)), atol=1e-9)


def test_angular_velocity_does_not_know_the_mounting():
    series = simulate(cycles=3).series
    turned = (
        Rotation.from_quat(series.quats_wxyz, scalar_first=True) * Rotation.from_rotvec([1.0, 2.0, -0.5])
    ).as_quat(scalar_first=True)
    other = velocity(OrientationSeries(series.times_s, turned, series.index))
    np.testing.assert_allclose(other.omega, velocity(series).omega, atol=1e-12)


def test_blocks_leave_no_seams():
    """More grid points than one block holds: a steady turn stays steady everywhere."""
    angle = 0.2 * np.arange(70_000)[:, None] / 100.0 * np.array([0.0, 0.6, 0.8])
    motion = velocity(from_rotation_vectors(angle))
    speed = np.linalg.norm(motion.omega[20:-20], axis=1)
    np.testing.assert_allclose(speed, 0.2, atol=1e-9)


def test_autocorrelation_against_plain_sums():
    rng = np.random.default_rng(0)
    omega = rng.normal(size=(200, 3))
    curve = vector_autocorrelation(omega, 90)
    for lag in (0, 1, 17, 90):
        ahead, behind = omega[lag:], omega[: len(omega) - lag]
        expected = (ahead * behind).sum() / np.sqrt((ahead**2).sum() * (behind**2).sum())
        assert curve[lag] == pytest.approx(expected, abs=1e-12)


def test_period_between_grid_points():
    t = np.arange(4000) / 100.0
    omega = np.sin(2.0 * np.pi * t / 3.337)[:, None] * [1.0, 0.0, 0.0]
    found = find_period(omega, 100.0, min_period_s=0.4, max_period_s=60.0, peak_share=0.8)
    assert found is not None
    assert found.seconds == pytest.approx(3.337, abs=0.002)
    assert found.confidence == pytest.approx(1.0, abs=1e-3)


def test_a_steady_turn_with_ripples_has_no_period():
    t = np.arange(4000) / 100.0
    omega = (1.0 + 0.1 * np.sin(2.0 * np.pi * t))[:, None] * [1.0, 0.0, 0.0]
    assert find_period(omega, 100.0, min_period_s=0.4, max_period_s=60.0, peak_share=0.8) is None


def test_the_motion_axis_is_not_the_drift_axis():
    """Drift of 3° a cycle spreads the poses further than the swing of 12°."""
    series = simulate(cycles=30, swing_deg=12.0, drift_deg=3.0, axis=(1.0, 0.0, 0.0), drift_axis=(0.0, 0.0, 1.0)).series
    motion = velocity(series)
    first, last = motion.active()
    found = motion_axis(motion.part(first, last), 4.0, sigma_periods=1.5)
    begin = found.axes[len(found.axes) // 10]
    assert abs(begin[2]) < 0.2
    assert np.degrees(found.swing_rad) == pytest.approx(12.0, rel=0.1)


def test_turning_points_of_a_cosine_and_the_hysteresis():
    t = np.arange(1000)
    angle = np.cos(2.0 * np.pi * t / 200.0) + 0.1 * np.cos(2.0 * np.pi * t / 10.0)
    found = turning_points(angle, 0.8)
    assert np.abs(found.points - np.arange(100, 1000, 100)).max() <= 10
    assert found.upper.tolist() == [False, True] * 4 + [False]
    assert len(turning_points(angle, 0.05)) > 100
    assert len(turning_points(np.linspace(0.0, 5.0, 100), 0.1)) == 0
    assert len(turning_points(np.zeros(50), 0.1)) == 0


def test_the_first_turning_point_needs_travel_on_both_sides():
    angle = np.concatenate((np.linspace(0.0, 0.3, 30), np.linspace(0.3, -1.0, 100), np.linspace(-1.0, 1.0, 100)))
    found = turning_points(angle, 0.5)
    assert found.upper.tolist() == [False]
    assert found.points[0] == pytest.approx(129, abs=1)


def test_travel_before_and_after_each_extreme():
    angle = np.interp(np.arange(401), [0, 100, 200, 300, 400], [0.0, 3.0, 1.0, 5.0, 2.5])
    before, after = swings(turning_points(angle, 1.0), angle)
    assert before.tolist() == pytest.approx([3.0, 2.0, 4.0])
    assert after.tolist() == pytest.approx([2.0, 4.0, 2.5])


def test_the_smallest_detour_is_taken_out():
    angle = np.interp(np.arange(401), [0, 100, 150, 170, 200, 300, 400], [0.0, 10.0, 5.0, 7.0, 0.0, 10.0, 0.0])
    found = turning_points(angle, 1.0)
    assert len(found) == 5
    kept = without_short_pairs(found, angle, 110.0)
    assert kept.points.tolist() == [100, 200, 300]


def test_dwell_of_a_plateau_is_its_middle():
    angle = np.interp(np.arange(401), [0, 100, 200, 400], [0.0, 10.0, 10.0, 0.0])
    start, end = dwell(angle, 103, 0, 400, 1.0)
    assert start == pytest.approx(90.0)
    assert end == pytest.approx(220.0)
    assert dwell(angle, 150, 120, 180, 1.0) == (120.0, 180.0)


@pytest.mark.parametrize("noise_deg", [0.02, 0.5])
def test_sample_noise_is_measured(noise_deg):
    series = simulate(noise_deg=noise_deg, rate_hz=200.0).series
    assert np.degrees(sample_noise_rad(series.quats_wxyz)) == pytest.approx(noise_deg, rel=0.1)


def test_likeness_tells_repeated_from_random():
    trial = simulate(cycles=10, tempo=np.linspace(0.8, 1.2, 10))
    assert likeness(velocity(trial.series), trial.endpoint_s) > 0.95
    noise = np.random.default_rng(0).normal(size=(4000, 3))
    assert abs(likeness(velocity(from_angular_velocity(noise)), np.arange(2.0, 38.0, 4.0))) < 0.4


def test_irregularity_of_even_and_uneven_cycles():
    even = np.arange(10.0)
    assert irregularity(np.diff(even), np.full(10, 7.0)) == 0.0
    uneven = np.random.default_rng(0).normal(1.0, 0.3, 2000)
    assert irregularity(uneven[1:], np.full(2000, 7.0)) == pytest.approx(0.3, rel=0.1)


def test_a_trapezoid_rests_twice_a_cycle():
    motion = velocity(simulate(trapezoid, cycles=10).series)
    number, share = rests(motion.part(500, 4100), 4.0)
    assert number == pytest.approx(2.0, abs=0.15)
    assert share == pytest.approx(0.42, abs=0.05)


def test_pose_jumps_are_steps_far_beyond_the_others():
    angle = np.radians(np.array([0.0, 0.8, 1.7, 2.4, 10.4, 11.1, 12.0]))
    quats = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_quat(scalar_first=True)
    assert pose_jumps(quats).tolist() == [False, False, False, True, False, False]
    assert pose_jumps(quats[:3]).tolist() == [False, False]


def test_lone_outliers_are_found_and_the_tip_of_a_stroke_is_none():
    tip = 10.0 - 3.0 * np.abs(np.arange(101) - 50.0)  # deg: as fast as 75 deg/s at 25 Hz
    step = np.where(np.arange(101) < 80, 0.0, 9.0)
    angle = np.radians(tip + step)
    angle[[20, 70]] += np.radians([20.0, -40.0])
    quats = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_quat(scalar_first=True)
    assert lone_outliers(quats).tolist() == [20, 70]
    assert lone_outliers(quats[:5]).tolist() == []
    still = from_rotation_vectors(np.radians(1.0) * np.random.default_rng(0).normal(size=(20_000, 3)))
    assert lone_outliers(still.quats_wxyz).tolist() == []


def test_an_average_over_time_is_not_pulled_by_lost_samples():
    """The object turns steadily through the moment; of the samples before it, most are lost."""
    t = np.arange(400) / 1000.0
    keep = (t >= 0.2) | (np.arange(400) % 5 == 0)
    quats = Rotation.from_rotvec(np.radians(30.0 * t)[:, None] * [1.0, 0.0, 0.0]).as_quat(scalar_first=True)
    samples = Samples.of(OrientationSeries(t[keep], quats[keep], np.arange(400)[keep]))
    got = Rotation.from_quat(samples.orientations(np.array([0.2]), 0.05)[0], scalar_first=True)
    assert np.degrees(got.magnitude()) == pytest.approx(6.0, abs=0.01)
    assert samples.nearest(np.array([-1.0, 0.0, 0.0024, 0.2004, 0.9])).tolist() == [0, 0, 0, 200, 399]
    around_s = samples.brackets_s(np.array([-0.1, 0.0, 0.1001, 0.399, 0.9]))
    assert around_s == pytest.approx([np.inf, 0.0, 0.005, 0.001, np.inf])
    starts_s, ends_s = np.array([0.1, 0.1999, 0.2, 0.2001, 0.0]), np.array([0.1001, 0.2, 0.21, 0.3, 0.004])
    assert samples.have_gaps(starts_s, ends_s, 0.002).tolist() == [True, True, True, False, True]


def test_a_pattern_of_peaks_is_believed_after_four_cycles_and_given_up_when_it_breaks():
    def point(time_s: float) -> Endpoint:
        return Endpoint(time_s, 0, np.array([1.0, 0.0, 0.0, 0.0]), 0.1, 1.0)

    filter_ = PeakFilter(1.0)
    passed: list[float] = []
    heights = [1.0, 0.6] * 8
    for k, height in enumerate(heights):
        new, restarted = filter_.add(point(float(k)), height + 0.01 * k, 1.0)
        passed = [p.time_s for p in new] if restarted else passed + [p.time_s for p in new]
    assert filter_.per_cycle == 2
    assert passed == [float(k) for k in range(0, 16, 2)]
    for k in range(16, 32):
        filter_.add(point(float(k)), 1.0, 1.0)
    assert filter_.per_cycle == 1


def test_a_steady_trend_of_the_swing_and_none_in_scatter():
    cycle = np.arange(12)
    assert swing_trend(30.0 * 0.97**cycle) == pytest.approx(-0.03)
    assert swing_trend(30.0 * 1.05**cycle) == pytest.approx(0.05)
    assert swing_trend(30.0 * 1.002**cycle) == 0.0  # steady, but hardly a change
    rng = np.random.default_rng(5)
    scattered = [swing_trend(30.0 * (1.0 + 0.1 * rng.uniform(-1.0, 1.0, 12))) for _ in range(400)]
    assert np.count_nonzero(scattered) <= 8  # chance 0.005 each


def test_steps_that_alternate_correlate_with_the_next():
    axis = np.array([0.0, 0.6, 0.8])
    alternating = np.where(np.arange(20) % 2, 0.01, 0.05)[:, None] * axis
    assert alternation(alternating) == pytest.approx(-0.95)  # one product less than squares
    assert abs(alternation(np.random.default_rng(2).normal(size=(4000, 3)))) < 0.05
    assert alternation(np.tile(axis, (9, 1))) == 0.0
