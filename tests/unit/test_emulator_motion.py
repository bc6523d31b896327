"""The hand's motion and the true drift, against scipy and against what was programmed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emulator import ScenarioError
from emulator.motion.hand_motion import DriftSettings, HandMotion, MotionSettings, drift_vectors
from emulator.scenario import load_scenario, scenario_names


def as_rotation(quats_wxyz):
    return Rotation.from_quat(np.asarray(quats_wxyz)[..., [1, 2, 3, 0]])


def steps_rad(quats_wxyz):
    rotations = as_rotation(quats_wxyz)
    return (rotations[1:] * rotations[:-1].inv()).as_rotvec()


SHAPES = [
    MotionSettings(),
    MotionSettings(shape="trapezoid", dwell=0.3, start_phase=0.2),
    MotionSettings(shape="two-hump", start_phase=0.1, axis=(0.0, 0.6, 0.8)),
    MotionSettings(shape="double-peak", second_height=1.0, saddle_height=0.1),
    MotionSettings(pause_every=2, pause_s=3.0, start_phase=0.3),
    MotionSettings(pause_every=1, pause_s=1.0, start_phase=0.7, tempo_variation=0.1),
    MotionSettings(start_phase=0.6, initial_q_wxyz=(0.5, 0.5, -0.5, 0.5)),
    MotionSettings(tempo_variation=0.15, tempo_trend=-0.3, amplitude_variation=0.2),
]
DRIFTS = [
    DriftSettings(mode="none"),
    DriftSettings(),
    DriftSettings(mode="alternating", angle_deg=2.0),
    DriftSettings(mode="slip", slip_cycle=3),
    DriftSettings(mode="random-walk", scatter_deg=2.0),
]


@pytest.mark.parametrize("motion", SHAPES)
@pytest.mark.parametrize("drift", DRIFTS)
def test_the_steps_between_primary_end_points_are_the_programmed_ones(motion, drift):
    hand = HandMotion(motion, drift, seed=5)
    programmed = drift_vectors(drift, motion.cycles, seed=5)[1:-1]
    np.testing.assert_allclose(steps_rad(hand.primary().quats_wxyz), programmed, atol=1e-12)


@pytest.mark.parametrize("motion", SHAPES)
@pytest.mark.parametrize("drift", DRIFTS)
def test_rate_of_turn_is_the_derivative_of_orientation(motion, drift):
    hand = HandMotion(motion, drift, seed=2)
    times_s = np.linspace(-0.5, hand.duration_s, 4001)
    # Away from the instants at which the rate has a corner: start, end, and where a dwell begins or ends.
    h = 1e-5
    before, after = as_rotation(hand.orientation(times_s - h)), as_rotation(hand.orientation(times_s + h))
    numeric = (after * before.inv()).as_rotvec() / (2 * h)
    error = np.linalg.norm(numeric - hand.angular_velocity(times_s), axis=1)
    assert np.quantile(error, 0.995) < 1e-6


@pytest.mark.parametrize("motion", SHAPES)
def test_both_extremes_are_turning_points_where_nothing_moves(motion):
    hand = HandMotion(motion, DriftSettings(), seed=1)
    for extremes in (hand.primary(), hand.other()):
        assert len(extremes.times_s) == motion.cycles
        assert (np.diff(extremes.times_s) > 0).all()
        np.testing.assert_allclose(hand.orientation(extremes.times_s), extremes.quats_wxyz, atol=1e-12)
        inside = extremes.times_s < hand.duration_s - motion.lead_out_s - 1e-6
        assert np.abs(hand.angular_velocity(extremes.times_s[inside])).max() < 1e-9


def test_the_primary_extreme_is_the_first_reached_after_the_start_pose():
    for start_phase, kind in [(0.0, "far"), (0.3, "far"), (0.5, "near"), (0.7, "near")]:
        hand = HandMotion(MotionSettings(start_phase=start_phase), DriftSettings(), seed=1)
        assert hand.primary().kind == kind
        assert hand.other().kind != kind
        assert hand.primary().times_s[0] < hand.other().times_s[0]


def test_the_start_pose_is_the_initial_one_and_lasts_for_the_lead_in():
    for phase in (0.0, 0.35, 0.6):
        initial = (0.5, -0.5, 0.5, 0.5)
        hand = HandMotion(MotionSettings(start_phase=phase, initial_q_wxyz=initial), DriftSettings(), seed=1)
        np.testing.assert_allclose(hand.orientation(np.array([-9.0, 0.0, 1.0, 2.0])), [initial] * 4, atol=1e-12)
        assert not hand.angular_velocity(np.array([-9.0, 0.0, 1.0])).any()


def test_without_drift_the_cosine_is_the_textbook_one():
    motion = MotionSettings(axis=(0.0, 0.0, 1.0), lead_in_s=0.0, period_s=3.0, swing_deg=50.0)
    hand = HandMotion(motion, DriftSettings(mode="none"), seed=1)
    times_s = np.linspace(0.0, 36.0, 999)
    angle_deg = as_rotation(hand.orientation(times_s)).as_rotvec(degrees=True)[:, 2]
    np.testing.assert_allclose(angle_deg, 25.0 * (1.0 - np.cos(2 * np.pi * times_s / 3.0)), atol=1e-9)


def test_a_dwell_is_really_at_rest_for_its_share_of_the_cycle():
    motion = MotionSettings(shape="trapezoid", dwell=0.25, period_s=4.0)
    hand = HandMotion(motion, DriftSettings(angle_deg=3.0), seed=1)
    middle = hand.primary().times_s[3]
    during = middle + np.linspace(-0.499, 0.499, 50)
    assert not hand.angular_velocity(during).any()
    assert np.linalg.norm(hand.angular_velocity(np.array([middle + 0.55]))) > 0.01


def test_swing_is_the_range_of_motion_between_the_extremes():
    hand = HandMotion(MotionSettings(shape="two-hump", swing_deg=45.0), DriftSettings(mode="none"), seed=1)
    between = as_rotation(hand.other().quats_wxyz) * as_rotation(hand.primary().quats_wxyz).inv()
    np.testing.assert_allclose(np.degrees(between.magnitude()), 45.0, atol=1e-9)


def test_two_humps_are_one_cycle_with_four_turning_points():
    hand = HandMotion(MotionSettings(shape="two-hump", lead_in_s=0.0), DriftSettings(mode="none"), seed=1)
    times_s = np.arange(0.0, hand.duration_s - 2.0, 0.004) + 0.0013
    rate = hand.angular_velocity(times_s)[:, 0]
    assert np.count_nonzero(np.diff(np.sign(rate))) == 4 * 12 - 1


def test_tempo_varies_about_the_nominal_and_by_seed():
    settings = MotionSettings(cycles=2000, tempo_variation=0.1)
    periods = HandMotion(settings, DriftSettings(), seed=1).periods_s
    assert periods.mean() == pytest.approx(4.0, rel=0.01)
    assert periods.std() == pytest.approx(0.4, rel=0.1)
    assert not np.array_equal(periods, HandMotion(settings, DriftSettings(), seed=2).periods_s)
    trend = HandMotion(replace(settings, tempo_variation=0.0, tempo_trend=0.5), DriftSettings(), seed=1).periods_s
    assert trend[-1] - trend[0] == pytest.approx(2.0)


def test_amplitude_variation_leaves_the_primary_end_points_alone():
    plain = HandMotion(MotionSettings(), DriftSettings(), seed=3)
    varied = HandMotion(MotionSettings(amplitude_variation=0.1), DriftSettings(), seed=3)
    np.testing.assert_allclose(
        steps_rad(varied.primary().quats_wxyz), steps_rad(plain.primary().quats_wxyz), atol=1e-12
    )
    assert np.abs(steps_rad(varied.other().quats_wxyz) - steps_rad(plain.other().quats_wxyz)).max() > 0.01


def test_an_amplitude_trend_narrows_the_other_extreme_only():
    narrowing = HandMotion(MotionSettings(amplitude_trend=-0.5), DriftSettings(mode="none"), seed=3)
    np.testing.assert_allclose(steps_rad(narrowing.primary().quats_wxyz), 0.0, atol=1e-12)
    near, far = narrowing.other().quats_wxyz, narrowing.primary().quats_wxyz
    swings_deg = np.degrees(2 * np.arccos(np.abs((near * far).sum(axis=1)).clip(0, 1)))
    assert (np.diff(swings_deg) < 0).all()
    assert swings_deg[0] == pytest.approx(40 * 1.25, rel=0.05)
    assert swings_deg[-1] == pytest.approx(40 * 0.75, rel=0.05)


def test_an_object_that_never_moves():
    hand = HandMotion(MotionSettings(cycles=0, lead_in_s=60.0, lead_out_s=0.0), DriftSettings(), seed=1)
    assert hand.duration_s == 60.0
    assert len(hand.primary().times_s) == len(hand.other().times_s) == 0
    assert (hand.orientation(np.arange(5.0)) == [1.0, 0.0, 0.0, 0.0]).all()


def test_a_slip_outside_the_trial_is_refused():
    with pytest.raises(ScenarioError, match=r"below motion\.cycles"):
        drift_vectors(DriftSettings(mode="slip", slip_cycle=12), 12, seed=1)


@pytest.mark.parametrize("name", scenario_names())
def test_orientation_of_every_shipped_scenario_is_unit_and_without_sign_jumps(name):
    scenario = load_scenario(name)
    hand = HandMotion(scenario.motion, scenario.drift, scenario.seed)
    quats = hand.orientation(np.arange(0.0, hand.duration_s, 0.01))
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1.0, atol=1e-12)
    assert (quats[1:] * quats[:-1]).sum(axis=1).min() > 0.99
