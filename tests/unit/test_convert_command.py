"""``rotdrift convert``: the format by name or by choice, nothing overwritten, every trouble in one sentence."""

import pytest

from analysis.formats import read_series
from analysis.formats.named_csv import csv_text
from host.cli import main
from tests.scored_trials import scored


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "trial.csv"
    path.write_text(csv_text(scored(cycles=5)[0]))
    return path


def test_the_name_says_the_format(source, tmp_path, capsys):
    assert main(["convert", str(source), str(tmp_path / "new" / "trial.mat")]) == 0
    assert main(["convert", str(source), str(tmp_path / "trial.tum")]) == 0
    said = capsys.readouterr()
    assert "MATLAB" in said.out
    assert "zeros are written" in said.err
    assert len(read_series(tmp_path / "trial.tum")) == len(read_series(source))
    assert main(["convert", str(source), str(tmp_path / "e.csv"), "--to", "endpoints"]) == 0
    assert (tmp_path / "e.csv").read_text().startswith("endpoint,row,t_s,qw")


@pytest.mark.parametrize(
    ("out", "code", "said"), [("trial.xyz", 2, "--to"), ("trial.csv", 4, "exists already"), ("other.csv", 0, "")]
)
def test_trouble_is_one_sentence(source, tmp_path, capsys, out, code, said):
    assert main(["convert", str(source), str(tmp_path / out)]) == code
    assert said in capsys.readouterr().err


def test_a_missing_file_is_said(tmp_path, capsys):
    assert main(["convert", str(tmp_path / "none.mcap"), str(tmp_path / "a.csv")]) == 4
    assert "there is no file" in capsys.readouterr().err
