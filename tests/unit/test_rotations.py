"""Quaternion arithmetic against scipy and closed forms."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.geometry import averages, rotations
from tests.waiting import HANG_S

N = 10_000  # more than two blocks


@pytest.fixture(scope="module")
def pair():
    p = rotations.from_xyzw(Rotation.random(N, rng=1).as_quat())
    q = rotations.from_xyzw(Rotation.random(N, rng=2).as_quat())
    return p, q


def scipy_rotation(q):
    return Rotation.from_quat(rotations.to_xyzw(q))


def assert_same_rotation(p, q, tolerance=1e-12):
    signs = np.sign(np.sum(p * q, axis=-1, keepdims=True))
    np.testing.assert_allclose(p * signs, q, atol=tolerance, rtol=0)


def test_hamilton_units():
    one, i, j, k = np.eye(4)
    assert (rotations.multiply(i, j) == k).all()
    assert (rotations.multiply(j, k) == i).all()
    assert (rotations.multiply(k, i) == j).all()
    for unit in (i, j, k):
        assert (rotations.multiply(unit, unit) == -one).all()


def test_multiply_and_difference_equal_scipy(pair):
    p, q = pair
    assert_same_rotation(
        rotations.multiply(p, q), rotations.from_xyzw((scipy_rotation(p) * scipy_rotation(q)).as_quat())
    )
    assert_same_rotation(
        rotations.difference(p, q), rotations.from_xyzw((scipy_rotation(p) * scipy_rotation(q).inv()).as_quat())
    )


def test_conjugate_is_the_inverse(pair):
    p, _ = pair
    assert_same_rotation(rotations.conjugate(p), rotations.from_xyzw(scipy_rotation(p).inv().as_quat()))


def test_log_angle_and_distance_equal_scipy(pair):
    p, q = pair
    np.testing.assert_allclose(rotations.log(p), scipy_rotation(p).as_rotvec(), atol=1e-12, rtol=0)
    np.testing.assert_allclose(rotations.angle(p), scipy_rotation(p).magnitude(), atol=1e-12, rtol=0)
    expected = (scipy_rotation(p).inv() * scipy_rotation(q)).magnitude()
    np.testing.assert_allclose(rotations.distance(p, q), expected, atol=1e-12, rtol=0)


def test_exp_equals_scipy_beyond_a_full_turn(pair):
    vectors = np.random.default_rng(3).normal(scale=4.0, size=(N, 3))
    assert_same_rotation(rotations.exp(vectors), rotations.from_xyzw(Rotation.from_rotvec(vectors).as_quat()))


def test_rotate_equals_scipy(pair):
    p, _ = pair
    vectors = np.random.default_rng(4).normal(size=(N, 3))
    np.testing.assert_allclose(rotations.rotate(p, vectors), scipy_rotation(p).apply(vectors), atol=1e-12, rtol=0)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-150, 1e-12, 1.7e-8, 1e-4, 1.0, np.pi - 1e-9, np.pi])
def test_log_exp_angle_keep_relative_precision(angle_rad):
    axis = np.array([0.6, -0.48, 0.64])
    q = rotations.exp(angle_rad * axis)
    np.testing.assert_allclose(rotations.angle(q), angle_rad, rtol=1e-14)
    np.testing.assert_allclose(rotations.log(q), angle_rad * axis, rtol=1e-7 if angle_rad == np.pi else 1e-13)
    np.testing.assert_allclose(rotations.log(-q), rotations.log(q), rtol=1e-12)


def test_single_quaternions_and_broadcasting(pair):
    p, q = pair
    rows = rotations.multiply(p[0], q)
    assert rows.shape == (N, 4)
    assert (rows[7] == rotations.multiply(p[0], q[7])).all()
    assert rotations.multiply(p[:6].reshape(2, 3, 4), q[:3]).shape == (2, 3, 4)
    assert rotations.angle(p[0]).shape == ()
    assert rotations.log(p[0]).shape == (3,)
    assert rotations.exp(np.zeros(3)).tolist() == [1, 0, 0, 0]
    assert rotations.multiply(np.empty((0, 4)), p[0]).shape == (0, 4)


def test_non_contiguous_and_read_only_input(pair):
    p, q = pair
    view = np.asfortranarray(p)[::3]
    view.flags.writeable = False
    expected = rotations.multiply(np.ascontiguousarray(view), q[::3])
    assert (rotations.multiply(view, q[::3]) == expected).all()
    assert (rotations.log(view) == rotations.log(p)[::3]).all()


def test_inputs_are_left_alone(pair):
    p, q = (a.copy() for a in pair)
    for act in (rotations.log, rotations.angle, rotations.conjugate):
        act(p)
        act(p[:1])  # one row is contiguous either way round
        act(p[3])
    rotations.multiply(p, q)
    assert (p == pair[0]).all()
    assert (q == pair[1]).all()


def test_continuous_signs():
    walk = np.cumsum(np.random.default_rng(7).normal(scale=0.1, size=(500, 3)), axis=0)
    smooth = rotations.exp(walk)  # passes a full turn, where the sign is not that of the scalar part
    flipped = smooth * np.random.default_rng(8).choice([-1.0, 1.0], size=(500, 1))
    mended = rotations.continuous_signs(flipped)
    assert (mended == smooth * np.sign(flipped[0] @ smooth[0])).all()
    assert rotations.continuous_signs(smooth[:1]).shape == (1, 4)


def test_average_of_symmetric_scatter_is_its_centre():
    centre = rotations.exp(np.array([0.3, 2.0, -0.4]))
    offsets = np.concatenate((np.eye(3), -np.eye(3))) * 0.2
    quats = rotations.multiply(rotations.exp(offsets), centre) * np.array([1, -1, 1, 1, -1, 1])[:, None]
    mean, share = averages.average_and_share(quats)
    assert_same_rotation(mean, centre)
    assert share == pytest.approx(np.cos(0.1) ** 2, abs=1e-12)
    assert mean[0] >= 0


def test_average_equals_scipy_and_takes_weights(pair):
    p = rotations.multiply(rotations.exp(0.3 * np.random.default_rng(9).normal(size=(40, 3))), pair[0][0])
    weights = np.random.default_rng(10).uniform(size=40)
    assert_same_rotation(averages.average(p), rotations.from_xyzw(scipy_rotation(p).mean().as_quat()))
    assert_same_rotation(
        averages.average(p, weights), rotations.from_xyzw(scipy_rotation(p).mean(weights=weights).as_quat())
    )
    with pytest.raises(ValueError, match="n >= 1"):
        averages.average(np.empty((0, 4)))


def test_average_keeps_tiny_angles():
    tiny = rotations.exp(np.array([[1e-9, 0, 0], [3e-9, 0, 0]]))
    assert rotations.angle(averages.average(tiny)) == pytest.approx(2e-9, rel=1e-6)


def test_slerp_ends_and_middle(pair):
    p, q = pair
    assert_same_rotation(rotations.slerp(p, q, 0.0), p)
    assert_same_rotation(rotations.slerp(p, q, 1.0), q)
    middle = rotations.slerp(p, q, 0.5)
    np.testing.assert_allclose(rotations.distance(p, middle), rotations.distance(middle, q), atol=1e-12)
    assert rotations.slerp(p[:5], q[:5], np.linspace(0, 1, 5)).shape == (5, 4)


@pytest.mark.parametrize("act", [rotations.angle, rotations.log, rotations.conjugate, rotations.to_xyzw])
def test_wrong_last_axis_is_refused(act):
    with pytest.raises(ValueError, match="last axis of 4"):
        act(np.zeros((4, 3)))


def test_scipy_border_round_trip(pair):
    assert (rotations.from_xyzw(rotations.to_xyzw(pair[0])) == pair[0]).all()
    assert rotations.to_xyzw([1, 0, 0, 0]).tolist() == [0, 0, 0, 1]


def test_importing_rotations_does_not_import_scipy():
    code = "import sys, analysis.geometry.rotations; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=HANG_S).returncode == 0
