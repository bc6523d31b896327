"""What an orientation series accepts, and how its samples are found."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.series import OrientationSeries, SeriesError, SetAside

UNIT = np.array([1.0, 0.0, 0.0, 0.0])


def series(times, **more):
    times = np.asarray(times, dtype=float)
    more.setdefault("quats_wxyz", np.tile(UNIT, (len(times), 1)))
    more.setdefault("index", np.arange(len(times)))
    return OrientationSeries(times, **more)


def test_rounding_is_mended_but_a_wrong_norm_is_refused():
    assert np.linalg.norm(series([0, 1], quats_wxyz=np.tile(1.004 * UNIT, (2, 1))).quats_wxyz[0]) == 1.0
    with pytest.raises(SeriesError, match=r"sample 1 has norm 1\.0200"):
        series([0, 1], quats_wxyz=np.array([UNIT, 1.02 * UNIT]))
    with pytest.raises(SeriesError, match="sample 1 has norm nan"):
        series([0, 1], quats_wxyz=np.array([UNIT, np.nan * UNIT]))


@pytest.mark.parametrize("times", [[0, 1, 1], [0, 1, 0.5], [0, 2, 1]])
def test_time_must_increase(times):
    with pytest.raises(SeriesError, match="does not increase at sample 2"):
        series(times)


def test_shapes_must_fit():
    with pytest.raises(SeriesError, match="do not fit"):
        series([0, 1], index=np.arange(3))
    with pytest.raises(SeriesError, match="positions"):
        series([0, 1], positions_m=np.zeros((3, 3)))
    with pytest.raises(SeriesError, match="accelerations"):
        series([0, 1], accelerations_mps2=np.zeros((2, 4)))
    with pytest.raises(SeriesError, match="sample 1 is not a number"):
        series([0, np.nan])


def test_gaps_and_interval():
    recording = series([0.0, 0.01, 0.02, 0.03, 0.5, 0.51, 0.52])
    assert recording.interval_s == pytest.approx(0.01)
    assert recording.gaps().tolist() == [[0.03, 0.5]]
    assert series([0.0]).gaps().shape == (0, 2)
    assert recording.duration_s == 0.52


def test_samples_are_found_by_row_even_when_set_aside():
    aside = SetAside(np.array([1.0]), np.array([[0.0, 1.0, 0, 0]]), np.array([2]))
    recording = series([0, 1, 2], index=np.array([0, 1, 3]), set_aside=aside)
    assert recording.sample(3).time_s == 2.0
    assert recording.sample(2).quat_wxyz.tolist() == [0.0, 1.0, 0.0, 0.0]
    with pytest.raises(SeriesError, match="no row 4 in the recording \\(0 to 3\\)"):
        recording.sample(4)


def test_a_copy_of_a_series_is_bit_for_bit_the_same():
    rng = np.random.default_rng(3)
    quats = rng.normal(size=(2000, 4))
    quats *= (1.0 + rng.uniform(-5e-3, 5e-3, size=2000))[:, None] / np.linalg.norm(quats, axis=1)[:, None]
    first = OrientationSeries(np.arange(2000.0), quats, np.arange(2000))
    np.testing.assert_array_equal(replace(first, source="copy").quats_wxyz, first.quats_wxyz)
