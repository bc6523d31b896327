"""The acceptance figures on the authors' recordings: the same functions that print the table."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from analysis.cycles.search import find_cycles
from analysis.geometry import rotations
from analysis.series import OrientationSeries
from benchmarks import recordings_table

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(
        not (recordings_table.FOLDER / "endpoints.json").exists(), reason="the authors' recordings are not here"
    ),
]


@pytest.fixture(scope="module")
def recordings():
    return recordings_table.recordings()


def test_every_acceptance_figure_is_met():
    """All but the one that is meant of more recordings than are here, with its one known miss."""
    lines: list[str] = []
    assert recordings_table.main(lines.append) == 0, "\n".join(lines)
    assert sum(line.startswith("ok  ") for line in lines) == 20
    (undecided,) = [line for line in lines if line.startswith("open ")]
    assert "θ̄ on the same cycles" in undecided
    assert undecided.split("   ")[-2:][0].strip().endswith("5 of 6")
    outside = [line for line in lines if "outside max" in line]
    assert [line.split()[0] for line in outside] == list(recordings_table.KNOWN_MISSES)
    assert any("too few to decide; not met on these alone" in line for line in lines)


def test_the_page_shows_what_the_automatic_window_gives_beside_the_authors():
    page = (Path(__file__).parents[2] / "docs" / "benchmark.md").read_text(encoding="utf-8")
    for row in recordings_table.automatic_rows():
        assert row.rstrip(" |") in page


def test_a_share_of_recordings_is_never_softened():
    def judge(good, of, explained):
        return recordings_table._share("", good, of, 0.85, explained=explained).mark

    assert judge(6, 6, True) == "ok"
    assert judge(5, 6, True) == "open"
    assert judge(5, 6, False) == "MISS"  # an unexplained miss is never open
    assert judge(3, 6, True) == "MISS"  # 16 of 19 is all that could be reached
    assert judge(17, 19, False) == "ok"
    assert judge(16, 19, True) == "MISS"


def test_a_recording_that_is_not_known_to_miss_is_a_miss(monkeypatch):
    monkeypatch.setattr(recordings_table, "KNOWN_MISSES", {})
    agreed = [
        recordings_table.Agreement(f"{k}.csv", 0.0, 0, 0, 4, 0.0, 0.0, 1.0 if k else 2.0, 1.0, 1.0) for k in range(6)
    ]
    causal = recordings_table.Causal("0.csv", 0, 0, 4, np.zeros(4), np.zeros(4), 1.0, 0.0)
    marks = {goal.what: goal.mark for goal in recordings_table.goals(agreed, [causal], [{}])}
    assert marks["θ̄ on the same cycles within max(0.05°, 10 %)"] == "MISS"
    monkeypatch.setattr(recordings_table, "KNOWN_MISSES", {"0.csv": "known"})
    marks = {goal.what: goal.mark for goal in recordings_table.goals(agreed, [causal], [{}])}
    assert marks["θ̄ on the same cycles within max(0.05°, 10 %)"] == "open"


def test_the_authors_end_points_are_maxima_of_a_position(recordings):
    """Why theirs need not be extremes of the rotation: the reason of the known miss."""
    for name, (series, reference) in recordings.items():
        if reference is None:
            continue
        rows = np.array(reference["endpoints_row"])
        reach = int(0.2 * np.median(np.diff(rows)))
        positions = series.positions_m[np.searchsorted(series.index, rows)[:, None] + np.arange(-reach, reach + 1)]
        is_maximum = (positions[:, reach] >= positions.max(axis=1)).all(axis=0)
        assert is_maximum.sum() == 1, name


def test_a_missed_figure_is_reported(monkeypatch):
    """The table can fail: an end point shifted by a fifth of a period is one missed and one extra."""
    found = find_cycles

    def shifted(series, *args, **kwargs):
        result = found(series, *args, **kwargs)
        points = list(result.endpoints)
        points[4] = dataclasses.replace(points[4], time_s=points[4].time_s + 0.2 * result.period_s)
        scored = next(run for run in result.runs if run.scored)
        return dataclasses.replace(result, runs=(dataclasses.replace(scored, endpoints=tuple(points)),))

    monkeypatch.setattr(recordings_table, "find_cycles", shifted)
    lines: list[str] = []
    assert recordings_table.main(lines.append) == 1
    assert any(line.startswith("MISS") and "missed or extra" in line for line in lines)


def test_the_authors_window_gives_the_authors_end_points(recordings):
    for name, (series, reference) in recordings.items():
        if reference is None:
            continue
        authors_s = np.array([series.sample(row).time_s for row in reference["endpoints_row"]])
        found = find_cycles(series, window=(authors_s[0], authors_s[-1]))
        assert found.valid, (name, found.reasons)
        assert len(found.endpoints) == len(authors_s), name
        assert np.abs([point.time_s for point in found.endpoints] - authors_s).max() < 0.12 * found.period_s, name


@pytest.mark.parametrize("what", ["backwards", "every tenth row", "half lost", "a third of the size", "cut"])
def test_changed_recordings_are_still_found(recordings, what):
    for name, (series, reference) in recordings.items():
        if reference is None:
            continue
        t, q, n = series.times_s - series.times_s[0], series.quats_wxyz, len(series)
        rows: np.ndarray = np.arange(n)
        if what == "backwards":
            t, q = t[-1] - t[::-1], q[::-1]
        elif what == "every tenth row":
            rows = rows[::10]
        elif what == "half lost":
            rows = np.sort(np.random.default_rng(5).choice(n, n // 2, replace=False))
        elif what == "a third of the size":
            q = rotations.multiply(rotations.exp(rotations.log(rotations.difference(q, q[0])) / 3.0), q[0])
        else:
            rows = rows[int(0.3 * n) : int(0.75 * n)]
        before = find_cycles(series)
        after = find_cycles(OrientationSeries(t[rows], q[rows], series.index[rows]))
        assert after.valid, (name, after.reasons)
        assert after.period_s == pytest.approx(before.period_s, rel=0.02), name
        if what != "cut":
            assert abs(len(after.endpoints) - len(before.endpoints)) <= 1, name  # a cycle at an end may be irregular


def test_grasp_and_release_claims_nothing(recordings):
    (refused,) = [series for series, reference in recordings.values() if reference is None]
    found = find_cycles(refused)
    assert not found.valid
    assert any("grasp-and-release" in reason for reason in found.reasons)
    assert any("grasp-and-release" in warning for warning in found.warnings)
