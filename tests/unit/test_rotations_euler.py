"""Euler angles against scipy, in every order and both ways."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.geometry import euler_angles, rotations


def assert_same_rotation(p, q, tolerance=1e-12):
    signs = np.sign(np.sum(p * q, axis=-1, keepdims=True))
    np.testing.assert_allclose(p * signs, q, atol=tolerance, rtol=0)


@pytest.mark.parametrize("order", ["xyz", "zyx", "zxz", "yxz", "xzx"])
@pytest.mark.parametrize("intrinsic", [True, False])
def test_euler_equals_scipy(order, intrinsic):
    angles = np.random.default_rng(5).uniform(-np.pi, np.pi, size=(200, 3))
    expected = Rotation.from_euler(order.upper() if intrinsic else order, angles)
    ours = euler_angles.from_euler(angles, order, intrinsic=intrinsic)
    assert_same_rotation(ours, rotations.from_xyzw(expected.as_quat()))


def test_euler_zyx_back_and_its_extrinsic_mirror():
    angles = np.random.default_rng(6).uniform([-3, -1.5, -3], [3, 1.5, 3], size=(200, 3))
    back = euler_angles.to_euler_zyx(euler_angles.from_euler(angles, "zyx", intrinsic=True))
    np.testing.assert_allclose(back, angles, atol=1e-12)
    mirrored = euler_angles.from_euler(angles[:, ::-1], "xyz", intrinsic=False)
    np.testing.assert_allclose(euler_angles.to_euler_zyx(mirrored), angles, atol=1e-12)


@pytest.mark.parametrize("order", ["xx", "xxy", "xyyz", "abc", ""])
def test_euler_order_is_checked(order):
    with pytest.raises(ValueError, match="Euler order"):
        euler_angles.from_euler(np.zeros(3), order, intrinsic=True)
