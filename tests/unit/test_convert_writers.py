"""Writers: what is written is read back as the same recording, by our readers and by other people's programs."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.formats import FORMATS, read_series, write_series
from analysis.formats.named_csv import csv_text, endpoints_csv_text
from analysis.formats.parquet import parquet_bytes
from analysis.series import WriterError
from tests.scored_trials import scored
from tests.waiting import HANG_S

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def trial():
    series, result = scored(cycles=5)
    return replace(series, positions_m=np.outer(series.times_s, [1e-3, 2e-3, -1e-3]) + 0.1), result


def assert_same(read, series, *, atol_s=1e-8, positions=True):
    np.testing.assert_allclose(read.times_s - read.times_s[0], series.times_s - series.times_s[0], atol=atol_s)
    dots = np.abs(np.einsum("ij,ij->i", read.quats_wxyz, series.quats_wxyz))
    assert dots.min() > 1.0 - 1e-14
    if positions:
        np.testing.assert_allclose(read.positions_m, series.positions_m, atol=1e-12)
    assert not read.warnings


@pytest.mark.parametrize("kind", ["csv", "tum", "parquet", "ros2", "kit"])
def test_our_readers_read_it_back(trial, tmp_path, kind):
    series, result = trial
    assert write_series(series, tmp_path / "out", kind, result.to_json()) == ()
    assert_same(read_series(tmp_path / "out"), series)


@pytest.mark.parametrize("kind", ["tum", "kit"])
def test_made_up_positions_are_said(trial, tmp_path, kind):
    series, _ = trial
    said = write_series(replace(series, positions_m=None), tmp_path / "out", kind)
    assert "zeros are written" in said[0]
    assert_same(read_series(tmp_path / "out"), series, positions=False)


def test_a_bag_without_positions_holds_quaternions(trial, tmp_path):
    series = replace(trial[0], positions_m=None)
    write_series(series, tmp_path / "bag", "ros2")
    read = read_series(tmp_path / "bag")
    assert read.positions_m is None
    assert "QuaternionStamped" in read.convention


def test_matlab_files_hold_samples_end_points_and_score(trial, tmp_path):
    from scipy.io import loadmat

    series, result = trial
    write_series(series, tmp_path / "out.mat", "mat", result.to_json())
    values = loadmat(tmp_path / "out.mat")
    np.testing.assert_array_equal(values["q_wxyz"], series.quats_wxyz)
    np.testing.assert_array_equal(values["t_s"][:, 0], series.times_s)
    assert values["theta_bar_deg"][0, 0] == result.theta_bar_deg
    assert values["endpoint_q_wxyz"].shape == (result.n_endpoints, 4)


def test_nothing_is_overwritten_and_needs_are_said(trial, tmp_path):
    (tmp_path / "there").write_text("mine")
    for kind in FORMATS:
        with pytest.raises(FileExistsError):
            write_series(trial[0], tmp_path / "there", kind, trial[1])
    assert (tmp_path / "there").read_text() == "mine"
    with pytest.raises(WriterError, match="need a score"):
        write_series(trial[0], tmp_path / "e.csv", "endpoints")
    with pytest.raises(WriterError, match="ROS 1"):
        write_series(trial[0], tmp_path / "trial.bag", "ros2")


def test_texts_and_tables_are_the_same_every_time(trial):
    assert csv_text(trial[0]) == csv_text(trial[0])
    assert parquet_bytes(trial[0]) == parquet_bytes(trial[0])


def test_a_reason_cannot_become_a_formula_or_a_new_cell():
    point = {"row": 1, "time_s": 0.5, "quat_wxyz": [1, 0, 0, 0], "reason": '=HYPERLINK("x"),\nnext'}
    text = endpoints_csv_text({"endpoints": [point]})
    assert "\"'=HYPERLINK" in text
    import csv
    import io

    assert len(list(csv.reader(io.StringIO(text)))) == 2


@pytest.mark.parametrize("drift_deg", [0.8, 1e-5])
def test_the_octave_script_agrees(tmp_path, drift_deg):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("GNU Octave is not installed")
    series, result = scored(cycles=6, drift_deg=drift_deg, slip_deg=0.0, noise_deg=0.0)
    write_series(series, tmp_path / "endpoints.csv", "endpoints", result.to_json())
    program = (
        f"addpath('{DOCS}'); [theta, steps, axis] = rotdrift_score('{tmp_path / 'endpoints.csv'}');"
        "printf('%.17g ', theta, steps, axis);"
    )
    done = subprocess.run(
        [octave, "--no-gui", "--norc", "--eval", program], capture_output=True, text=True, timeout=HANG_S, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "are these end points" not in done.stderr
    numbers = [float(word) for word in done.stdout.split()]
    wanted = [result.theta_bar_deg, *result.steps_deg, *result.axis]
    np.testing.assert_allclose(numbers[:-3], wanted[:-3], rtol=0, atol=1e-9)
    if drift_deg > 0.1:
        np.testing.assert_allclose(numbers[-3:], wanted[-3:], atol=1e-9)
