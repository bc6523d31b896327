"""The card's score where one changed sign, bound or word would not show in a usual trial."""

import numpy as np
import pytest

from analysis.geometry import rotations
from analysis.scoring.card import rotation_drift, step_rotations, translation_drift_mm
from analysis.series import SeriesError


def turned(*angles_deg, axis=(0.0, 0.0, 1.0)):
    """Orientations about one axis."""
    return rotations.exp(np.radians(np.array(angles_deg))[:, None] * np.array(axis))


def test_a_step_has_no_negative_scalar_part_whatever_the_signs_of_its_ends():
    quats = turned(0.0, 10.0, 25.0, 20.0)
    expected = turned(10.0, 15.0, -5.0)
    for signs in ([1, -1, 1, -1], [1, 1, -1, -1], [-1, 1, 1, 1]):
        steps = step_rotations(quats * np.array(signs)[:, None])
        assert (steps[:, 0] > 0).all()
        np.testing.assert_allclose(steps, expected, atol=1e-15)


def test_half_a_turn_keeps_the_sign_of_its_axis():
    steps = step_rotations([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    assert steps.tolist() == [[0.0, 1.0, 0.0, 0.0]]


def test_steps_that_are_left_out_are_kept_but_do_not_count():
    quats = turned(0.0, 1.0, 2.0, 42.0, 43.0)
    drift = rotation_drift(quats, [2])
    assert drift.left_out == (2,)
    assert drift.theta_bar_deg == pytest.approx(1.0, abs=1e-9)
    assert rotation_drift(quats).theta_bar_deg > 10.0
    np.testing.assert_allclose(drift.steps_deg, [1.0, 1.0, 40.0, 1.0], atol=1e-9)
    assert drift.counted_step_rotations_wxyz.shape == (3, 4)
    np.testing.assert_allclose(np.degrees(rotations.angle(drift.counted_step_rotations_wxyz)), 1.0, atol=1e-9)
    assert drift.top_eigenvalue_share == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(rotation_drift(quats, [0, 1, 3]).theta_bar_deg, 40.0, atol=1e-9)
    assert rotation_drift(quats, [3, 0, 3]).left_out == (0, 3)


def test_nothing_is_left_out_unless_asked_for():
    drift = rotation_drift(turned(0.0, 1.0, 2.0))
    assert drift.left_out == ()
    assert drift.counted_step_rotations_wxyz is drift.step_rotations_wxyz


def test_without_drift_the_axis_is_three_zeros():
    drift = rotation_drift(turned(5.0, 5.0, 5.0))
    assert drift.theta_bar_deg == 0.0
    assert drift.axis.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("left_out", [[-1], [2], [0, 2], [-1, 0]])
def test_a_step_that_is_not_there_cannot_be_left_out(left_out):
    without = tuple(sorted(left_out))
    with pytest.raises(SeriesError) as raised:
        rotation_drift(turned(0.0, 1.0, 2.0), left_out)
    assert str(raised.value) == f"there are 2 steps, from 0; {without} cannot be left out"


def test_the_first_and_the_last_step_can_be_left_out_but_not_all():
    quats = turned(0.0, 3.0, 5.0)
    assert rotation_drift(quats, [0]).theta_bar_deg == pytest.approx(2.0, abs=1e-9)
    assert rotation_drift(quats, [1]).theta_bar_deg == pytest.approx(3.0, abs=1e-9)
    with pytest.raises(SeriesError) as raised:
        rotation_drift(quats, [0, 1])
    assert str(raised.value) == "every step is left out: no drift remains"


@pytest.mark.parametrize("quats", [np.zeros((2, 3)), np.zeros((1, 4)), np.zeros(4), np.zeros((2, 2, 4))])
def test_what_are_no_end_points_is_refused_with_its_shape(quats):
    with pytest.raises(SeriesError) as raised:
        step_rotations(quats)
    assert str(raised.value) == f"a drift needs at least 2 end points as (n, 4) quaternions, got shape {quats.shape}"


def test_two_end_points_are_one_step():
    assert rotation_drift(turned(0.0, 7.0)).theta_bar_deg == pytest.approx(7.0, abs=1e-9)


def test_a_translation_is_worked_out_in_double_precision_and_in_millimetres():
    positions = np.float32([[0.1, 0.2, 0.3], [0.7, 0.1, 0.3], [0.4, 0.4, 0.1]])
    exact = np.linalg.norm(np.diff(positions.astype(np.float64), axis=0).mean(axis=0)) * 1000
    assert translation_drift_mm(positions) == exact
    assert translation_drift_mm([[0, 0, 0], [0, 0, 1]]) == 1000.0


@pytest.mark.parametrize("positions", [[[0.0, 0.0, 0.0]], [1.0, 2.0, 3.0]])
def test_one_position_has_no_translation(positions):
    with pytest.raises(SeriesError) as raised:
        translation_drift_mm(positions)
    shape = np.asarray(positions).shape
    assert str(raised.value) == f"a translation drift needs at least 2 positions, got shape {shape}"
