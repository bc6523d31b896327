"""The authors' Euler figure, and their stale-array fault, on end points made for it."""

import numpy as np
import pytest

from analysis.geometry.euler_angles import from_euler
from analysis.scoring.as_published import euler_differences_deg, published_drift
from analysis.series import SeriesError


def end_points(angles_deg):
    return from_euler(np.radians(angles_deg), "zyx", intrinsic=True)


LONG = [[0.0, 0, 0], [2.0, 0, 0], [3.0, 1.0, 0], [5.0, 1.0, 0], [9.0, 1.0, 0]]
SHORT = [[10.0, 5.0, 0], [10.0, 6.0, 0], [10.0, 8.0, 1.0]]


def test_corrected_is_the_mean_difference():
    drift = published_drift(end_points(SHORT))
    assert drift.euler_drift_deg == pytest.approx(np.hypot(1.5, 0.5))
    assert drift.euler_drift_as_published_deg == drift.euler_drift_deg
    assert drift.stale_rows == 0
    assert drift.n_steps == 2
    np.testing.assert_allclose(euler_differences_deg(end_points(SHORT)), [[0, 1, 0], [0, 2, 1]], atol=1e-12)


def test_a_shorter_motion_is_averaged_with_leftovers_of_the_longer():
    drift = published_drift(end_points(SHORT), [end_points(LONG)])
    # Rows 3 and 4 of the long motion, (2, 0, 0) and (4, 0, 0), were left in the array.
    assert drift.euler_drift_as_published_deg == pytest.approx(np.linalg.norm([6.0, 3.0, 1.0]) / 4)
    assert drift.euler_drift_deg == pytest.approx(np.hypot(1.5, 0.5))
    assert drift.stale_rows == 2
    assert drift.stale_of == (2,)


def test_a_longer_motion_leaves_nothing_of_the_shorter():
    drift = published_drift(end_points(LONG), [end_points(SHORT)])
    assert drift.stale_rows == 0
    assert drift.euler_drift_as_published_deg == pytest.approx(np.hypot(9.0, 1.0) / 4)


def test_leftovers_outlive_motions_between():
    middle = end_points(LONG[:4])
    drift = published_drift(end_points(SHORT), [end_points(LONG), middle])
    assert drift.stale_rows == 2
    assert drift.euler_drift_as_published_deg == pytest.approx(np.linalg.norm([6.0, 3.0, 1.0]) / 4)


def test_it_is_said_whose_rows_were_left_behind():
    longest = end_points([*LONG, [9.0, 2.0, 0], [9.0, 4.0, 0]])
    drift = published_drift(end_points(SHORT), [longest, end_points(LONG), end_points(SHORT)])
    assert drift.stale_of == (2, 2, 0)  # rows 5 and 6 of the longest, 3 and 4 of the next
    assert drift.stale_rows == 4
    assert drift.euler_drift_as_published_deg == pytest.approx(np.linalg.norm([6.0, 6.0, 1.0]) / 6)


def test_wraps_are_kept_because_the_scripts_keep_them():
    drift = published_drift(end_points([[179.0, 0, 0], [-179.0, 0, 0]]))
    assert drift.euler_drift_deg == pytest.approx(358.0)


def test_one_end_point_is_too_few():
    with pytest.raises(SeriesError, match="at least 2"):
        published_drift(end_points(SHORT[:1]))
