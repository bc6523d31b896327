"""Data that contradict the declared convention are warned of; data that agree are not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.formats.conventions import _wander_deg, convention_warnings
from analysis.series import OrientationSeries

N = 3000
TIMES = np.arange(N) / 100.0
SWING = np.outer(np.sin(2 * np.pi * TIMES / 3.0), [0.1, 0.2, 0.6])
CREEP = np.outer(TIMES / 3.0, np.radians([2.0, 1.0, 0.0]))
POSES = Rotation.from_rotvec(SWING) * Rotation.from_rotvec(CREEP) * Rotation.from_rotvec([0.5, 0.2, -0.9])
UP = 9.81 * POSES.inv().apply([0.0, 0.0, 1.0]) + np.random.default_rng(1).normal(scale=0.1, size=(N, 3))


def series(quats, accelerations=None):
    return OrientationSeries(TIMES[: len(quats)], quats, np.arange(len(quats)), accelerations_mps2=accelerations)


def test_sound_data_are_silent():
    assert convention_warnings(series(POSES.as_quat(scalar_first=True), UP)) == ()
    assert convention_warnings(series(POSES.as_quat(scalar_first=True)[:5])) == ()


def test_gravity_shows_the_other_way_round():
    (warning, *_) = convention_warnings(series(POSES.inv().as_quat(scalar_first=True), UP))
    assert "gravity wanders" in warning
    assert "read the other way round (world to body) it would be 0." in warning


def test_gravity_shows_the_order_of_components():
    warnings = convention_warnings(series(POSES.as_quat(), UP))  # scalar last, read as scalar first
    assert "read with the scalar last it would be 0." in warnings[0]


def test_a_swing_of_a_few_degrees_is_enough_to_see_it():
    small = Rotation.from_rotvec(SWING * 0.2) * Rotation.from_rotvec([0.5, 0.2, -0.9])  # 7 degrees to each side
    up = 9.81 * small.inv().apply([1.0, 0.0, 0.0]) + np.random.default_rng(3).normal(scale=0.1, size=(N, 3))
    assert convention_warnings(series(small.as_quat(scalar_first=True), up)) == ()
    for wrong in (small.inv().as_quat(scalar_first=True), small.as_quat()):
        assert "gravity wanders" in convention_warnings(series(wrong, up))[0]


def test_the_wandering_of_gravity_is_its_root_mean_square_angle():
    tilted = 9.81 * Rotation.from_rotvec([np.radians(4.0), 0.0, 0.0]).apply([0.0, 0.0, 1.0])
    forces = np.where(np.arange(N)[:, None] % 2, tilted, tilted * [1.0, -1.0, 1.0])
    assert _wander_deg(np.tile([1.0, 0, 0, 0], (N, 1)), forces) == pytest.approx(4.0, rel=1e-3)


def test_a_wandering_of_a_few_degrees_counts_if_another_reading_has_none():
    tilt = Rotation.from_rotvec(np.outer(np.sin(TIMES), [np.radians(5.5), 0.0, 0.0]))
    up = 9.81 * tilt.inv().apply([0.0, 0.0, 1.0])
    (warning,) = convention_warnings(series(tilt.inv().as_quat(scalar_first=True), up))
    assert "gravity wanders by 7.8°" in warning  # twice 5.5 over the root of two
    assert "it would be 0.0°" in warning


@pytest.mark.parametrize("scale", [1.0 / 9.81, 0.02, 100.0])
def test_accelerations_in_another_unit_or_without_gravity_are_said(scale):
    (warning,) = convention_warnings(series(POSES.as_quat(scalar_first=True), scale * UP))
    assert "another unit, or gravity taken off" in warning


def test_gravity_is_not_judged_without_turning():
    still = np.tile(POSES[0].as_quat(scalar_first=True), (N, 1))
    assert convention_warnings(series(still, np.random.default_rng(2).normal(scale=5.0, size=(N, 3)))) == ()


def test_axis_of_motion_shows_the_other_way_round():
    (warning,) = convention_warnings(series(POSES.inv().as_quat(scalar_first=True)))
    assert "steadier in the object" in warning


def test_jumps_are_named():
    quats = POSES.as_quat(scalar_first=True)
    quats[1500:] = (Rotation.from_rotvec([0, 1.5, 0]) * POSES[1500:]).as_quat(scalar_first=True)
    warnings = convention_warnings(series(quats))
    assert "jumps 1 time, first by 86° at row 1500" in warnings[0]


def test_a_jump_across_a_gap_is_none():
    quats = POSES.as_quat(scalar_first=True)
    keep = np.r_[0:1000, 1075:3000]
    cut = OrientationSeries(TIMES[keep], quats[keep], keep)
    assert convention_warnings(cut) == ()
