"""``rotdrift score`` of several recordings: one table, all cores, one bad file not stopping the rest; and the plot."""

import json

import numpy as np
import pytest

from tests.command_line import one_sentence, rotdrift_here


def trial_file(path, drift_deg, cycles=8):
    """A CSV at 50 Hz: 30 degrees to and fro in 2 s about x, a constant drift about z."""
    times_s = np.arange(int(cycles * 2.0 * 50) + 1) / 50.0
    swing = np.radians(15.0 * np.cos(np.pi * times_s)) / 2.0
    drift = np.radians(drift_deg * times_s / 2.0) / 2.0
    rows = [
        f"{t:.2f},{np.cos(d) * np.cos(s):.12f},{np.cos(d) * np.sin(s):.12f},"
        f"{np.sin(d) * np.sin(s):.12f},{np.sin(d) * np.cos(s):.12f}"
        for t, s, d in zip(times_s, swing, drift, strict=True)
    ]
    path.write_text("t,qw,qx,qy,qz\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def folder(tmp_path):
    trials = tmp_path / "trials"
    (trials / "later").mkdir(parents=True)
    trial_file(trials / "a.csv", 0.5)
    trial_file(trials / "later" / "b.csv", 1.5)
    (trials / "bad.csv").write_text("t,qw,qx,qy,qz\n0,1,0,0,0\n0.1,x,0,0,0\n", encoding="utf-8")
    trial_file(trials / "short.csv", 0.5, cycles=2)
    (trials / "notes.md").write_text("not a recording", encoding="utf-8")
    return trials


def test_a_folder_makes_one_table_and_a_bad_file_is_only_a_row(folder):
    result = rotdrift_here("score", folder, COLUMNS="140")
    assert result.returncode == 4
    assert "Traceback" not in result.stderr
    lines = {line.split()[0]: line for line in result.stdout.splitlines() if line.strip()}
    assert "0.500°" in lines["trials/a.csv"]
    assert "1.500°" in lines["later/b.csv"]
    assert "no score" in lines["trials/short.csv"]
    assert "line 3" in result.stdout
    assert "2 of 4 recordings scored" in result.stdout


def test_json_has_every_file_in_order_and_equals_the_single_score(folder):
    result = rotdrift_here("score", folder / "later" / "b.csv", folder / "a.csv", "--json")
    assert result.returncode == 0
    rows = json.loads(result.stdout)["results"]
    assert [row["file"] for row in rows] == [str(folder / "later" / "b.csv"), str(folder / "a.csv")]
    assert rows[1]["result"] == json.loads(rotdrift_here("score", folder / "a.csv", "--json").stdout)


def test_what_belongs_to_one_recording_is_refused_for_many(folder, tmp_path):
    assert "--endpoints" in one_sentence(rotdrift_here("score", folder, "--endpoints", "1,2,3,4"), 2)
    assert "--plot" in one_sentence(rotdrift_here("score", folder, "--plot", tmp_path / "p.png"), 2)


@pytest.mark.parametrize(("suffix", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_the_plot(folder, tmp_path, suffix, begins):
    plot = tmp_path / f"trial.{suffix}"
    result = rotdrift_here("score", folder / "a.csv", "--plot", plot)
    assert result.returncode == 0, result.stderr
    assert plot.read_bytes().startswith(begins)
    assert plot.stat().st_size > 5000
    assert "exists already" in one_sentence(rotdrift_here("score", folder / "a.csv", "--plot", plot), 4)


def test_a_trial_without_a_score_is_drawn_as_well(folder, tmp_path):
    assert rotdrift_here("score", folder / "short.csv", "--plot", tmp_path / "short.png").returncode == 1
    assert (tmp_path / "short.png").is_file()


def test_a_picture_of_no_known_kind(folder, tmp_path):
    assert "p.gif is not a known kind of picture" in one_sentence(
        rotdrift_here("score", folder / "a.csv", "--plot", tmp_path / "p.gif"), 2
    )
