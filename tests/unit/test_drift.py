"""The card's score against closed forms, and against scipy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.geometry import averages, rotations
from analysis.scoring.card import rotation_drift, step_rotations, translation_drift_mm
from analysis.series import SeriesError

AXIS = np.array([2.0, -1.0, 2.0]) / 3.0
ACROSS = np.array([0.6, 0.8, 0.0])


def chain(steps_rad, start=(0.3, -0.5, 1.1)):
    """Orientations whose left differences are the given rotation vectors."""
    quats = [rotations.exp(np.array(start))]
    for step in np.asarray(steps_rad):
        quats.append(rotations.multiply(rotations.exp(step), quats[-1]))
    return np.array(quats)


@pytest.mark.parametrize("theta_deg", [1e-7, 1e-3, 0.8, 45.0, 179.0])
@pytest.mark.parametrize("n", [2, 3, 30])
def test_constant_drift_is_found_exactly(theta_deg, n):
    drift = rotation_drift(chain(np.tile(np.radians(theta_deg) * AXIS, (n - 1, 1))))
    assert drift.theta_bar_deg == pytest.approx(theta_deg, rel=1e-7)
    np.testing.assert_allclose(drift.axis, AXIS, atol=1e-6)
    np.testing.assert_allclose(drift.steps_deg, theta_deg, rtol=1e-6)
    assert len(drift.steps_deg) == n - 1
    assert drift.top_eigenvalue_share == pytest.approx(1.0, abs=1e-12)


def test_no_drift_at_all_is_zero_with_no_axis():
    drift = rotation_drift(np.tile(rotations.exp(np.array([0.1, 0.2, 0.3])), (5, 1)))
    assert drift.theta_bar_deg == pytest.approx(0.0, abs=1e-13)
    drift = rotation_drift(np.tile([1.0, 0.0, 0.0, 0.0], (5, 1)))
    assert drift.theta_bar_deg == 0.0
    assert (drift.axis == 0.0).all()


def test_about_one_axis_it_is_the_card_s_double_angle_mean():
    # About one axis M has the closed form of a circular mean of the half angles, taken at twice the angle.
    steps = np.radians([0.5, -2.0, 3.0, 1.0, 9.0])
    expected = np.angle(np.exp(1j * steps).sum())
    drift = rotation_drift(chain(steps[:, None] * AXIS))
    assert drift.theta_bar_rad == pytest.approx(abs(expected), rel=1e-12)


def test_literal_card_formula_with_scipy():
    rng = np.random.default_rng(11)
    quats = chain(rng.normal(scale=0.05, size=(12, 3)))
    turns = Rotation.from_quat(rotations.to_xyzw(quats))
    r = (turns[1:] * turns[:-1].inv()).as_quat()
    values, vectors = np.linalg.eigh(sum(np.outer(v, v) for v in r))
    assert rotation_drift(quats).theta_bar_rad == pytest.approx(2 * np.arccos(abs(vectors[3, -1])), rel=1e-9)
    assert rotation_drift(quats).top_eigenvalue_share == pytest.approx(values[-1] / 12, rel=1e-12)


def test_differences_are_left_ones():
    quats = chain([0.2 * AXIS, -0.1 * ACROSS])
    np.testing.assert_allclose(rotations.log(step_rotations(quats)), [0.2 * AXIS, -0.1 * ACROSS], atol=1e-14)
    quats = chain(np.random.default_rng(14).normal(scale=0.4, size=(9, 3)))
    right = rotations.multiply(rotations.conjugate(quats[:-1]), quats[1:])
    assert rotations.angle(averages.average(right)) != pytest.approx(rotation_drift(quats).theta_bar_rad, rel=1e-3)


def test_theta_bar_telescopes():
    steps = np.random.default_rng(12).normal(scale=0.01, size=(9, 3)) + 0.005
    quats = chain(steps)
    net = rotations.distance(quats[-1], quats[0])
    assert rotation_drift(quats).theta_bar_rad == pytest.approx(net / 9, rel=1e-2)


def test_one_slip_is_spread_over_the_steps():
    steps = np.zeros((10, 3))
    steps[4] = np.radians(8.0) * AXIS
    assert rotation_drift(chain(steps)).theta_bar_deg == pytest.approx(0.8, rel=0.01)


@pytest.mark.parametrize("quats", [np.zeros((0, 4)), [[1.0, 0, 0, 0]], np.zeros((3, 3)), [1.0, 0, 0, 0]])
def test_too_few_or_misshapen(quats):
    with pytest.raises(SeriesError, match="at least 2"):
        rotation_drift(quats)


@pytest.mark.parametrize(("left_out", "message"), [([3], "cannot be left out"), ([-1], "cannot"), ([0, 1, 2], "every")])
def test_steps_that_cannot_be_left_out(left_out, message):
    with pytest.raises(SeriesError, match=message):
        rotation_drift(chain(np.full((3, 3), 0.01)), left_out)


def test_translation_drift_is_net_over_steps():
    positions = np.cumsum(np.random.default_rng(13).normal(size=(6, 3)), axis=0) * 1e-3
    expected = np.linalg.norm(positions[-1] - positions[0]) / 5 * 1000
    assert translation_drift_mm(positions) == pytest.approx(expected, rel=1e-12)
    with pytest.raises(SeriesError):
        translation_drift_mm(positions[:1])
