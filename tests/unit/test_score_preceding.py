"""``rotdrift score --preceding``: what the authors' script left behind from the motions before."""

import json

import numpy as np
import pytest

from host.cli import main

COLUMNS = "t=t,e1=azimuth,e2=elevation,e3=roll,angle=deg,euler=intrinsic-zyx"
LONG = np.array([[0, 0, 0], [2, 0, 0], [3, 1, 0], [5, 1, 0], [9, 1, 0], [9, 4, 0], [9, 4, 6]], dtype=float)
SHORT = np.array([[10, 5, 0], [10, 6, 0], [10, 8, 1], [11, 8, 1]], dtype=float)


@pytest.fixture
def files(tmp_path):
    """Recordings whose every tenth row is an end point."""
    for name, angles in (("long", LONG), ("short", SHORT)):
        rows = np.arange(10 * (len(angles) - 1) + 1)
        at = np.stack([np.interp(rows, 10 * np.arange(len(angles)), angles[:, k]) for k in range(3)], axis=1)
        lines = [f"{row / 10},{','.join(map(str, angle))}" for row, angle in zip(rows, at.tolist(), strict=True)]
        (tmp_path / f"{name}.csv").write_text("t,azimuth,elevation,roll\n" + "\n".join(lines) + "\n")
    return tmp_path


def endpoints(angles):
    return ",".join(str(10 * k) for k in range(len(angles)))


def score(files, *more):
    short = ["score", str(files / "short.csv"), "--columns", COLUMNS, "--endpoints", endpoints(SHORT)]
    return main([*short, *more])


def expected(*motions):
    """The authors' script: one array, filled from the front by each motion, never cleared."""
    array = np.zeros((0, 3))
    for angles in motions:
        steps = np.diff(angles, axis=0)
        array = np.concatenate((steps, array[len(steps) :]))
    return float(np.linalg.norm(array.mean(axis=0)))


def test_steps_of_a_longer_motion_are_left_behind(files, capsys):
    before = f"{files / 'long.csv'}={endpoints(LONG)}"
    assert score(files, "--preceding", before, "--json") == 0
    published = json.loads(capsys.readouterr().out)["as_published"]
    assert published["euler_drift_deg"] == pytest.approx(expected(SHORT))
    assert published["euler_drift_as_published_deg"] == pytest.approx(expected(LONG, SHORT))
    assert published["stale_rows"] == len(LONG) - len(SHORT)
    assert published["stale_of"] == [3]
    assert published["preceding"] == 1

    assert score(files, "--preceding", before) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert f"{expected(SHORT):.4f}° by the authors' script, its array cleared" in shown
    assert f"{expected(LONG, SHORT):.4f}° with 3 steps of earlier motions left in it (3 of motion 1 given" in shown


def test_several_in_their_order_and_end_points_from_a_file(files, capsys):
    listed = files / "long.endpoints.csv"
    listed.write_text("row\n" + endpoints(LONG[:6]).replace(",", "\n") + "\n")
    more = [f"{files / 'short.csv'}=0,10,20", f"{files / 'long.csv'}={listed}"]
    assert score(files, "--preceding", more[0], "--preceding", more[1], "--json") == 0
    published = json.loads(capsys.readouterr().out)["as_published"]
    assert published["euler_drift_as_published_deg"] == pytest.approx(expected(SHORT[:3], LONG[:6], SHORT))
    assert published["preceding"] == 2


def test_without_it_the_terminal_says_that_the_figure_may_differ(files, capsys):
    assert score(files, "--as-published") == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "the same as published, unless a longer motion came before (--preceding)" in shown
    assert score(files, "--preceding", f"{files / 'short.csv'}=0,10,20") == 0
    assert "no earlier motion had more cycles" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("given", "code", "said"),
    [
        ("nowhere.csv", 4, "there is no file nowhere.csv"),
        ("{}/long.csv=1,x", 2, "1,x"),
        ("{}/long.csv=5", 2, "1 end points, too few"),
        ("{}/long.csv=0,10,999", 2, "999"),
    ],
)
def test_what_cannot_be_used_is_said(files, capsys, given, code, said):
    assert score(files, "--preceding", given.format(files)) == code
    assert said in capsys.readouterr().err


def test_it_belongs_to_one_recording(files, capsys):
    assert main(["score", str(files), "--preceding", "x.csv"]) == 2
    assert "--preceding belongs to one recording" in capsys.readouterr().err
