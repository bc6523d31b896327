"""Gates at the ends of a run: a grasp is left out, a slip in a regular cycle is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.cycles.search import CycleAnalysis, find_cycles
from analysis.series import OrientationSeries
from tests.simulated_motion import Trial, simulate


def jumped(trial: Trial, at_s: float, jump_deg: float, *, before: bool, within_s: float = 0.25) -> OrientationSeries:
    """The trial with its pose turned within a moment: all that comes before it, or all that comes after."""
    t = trial.series.times_s
    share = np.clip((t - at_s) / within_s + 0.5, 0.0, 1.0)
    share = 1.0 - share if before else share
    turn = Rotation.from_rotvec(np.radians(jump_deg) * share[:, None] * [0.48, 0.6, 0.64])
    quats = (turn * Rotation.from_quat(trial.series.quats_wxyz, scalar_first=True)).as_quat(scalar_first=True)
    return OrientationSeries(t, quats, trial.series.index)


def uneven(first: float = 1.0, last: float = 1.0, n: int = 10) -> np.ndarray:
    tempo = 1.0 + 0.01 * np.random.default_rng(2).uniform(-1.0, 1.0, n)
    tempo[0] *= first
    tempo[-1] *= last
    return tempo


def grasps(found: CycleAnalysis) -> list[str]:
    return [item.reason for item in found.left_out if item.grasp and item.primary]


def test_a_jump_in_a_first_cycle_of_another_length_is_the_grasp():
    trial = simulate(tempo=uneven(first=1.3))
    found = find_cycles(jumped(trial, trial.endpoint_s[0] + 0.35 * 4.0, 5.0, before=True))
    assert found.valid, found.reasons
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s[1:], abs=0.05)
    (reason,) = grasps(found)
    assert reason.startswith("first cycle: the grasp: a step of ")
    assert "where 0.80° is usual, and the cycle lasts 1.1" in reason
    assert found.theta_bar_deg == pytest.approx(0.8, abs=0.02)


def test_a_jump_in_a_last_cycle_of_another_length_is_the_release():
    trial = simulate(tempo=uneven(last=0.72))
    found = find_cycles(jumped(trial, trial.endpoint_s[-1] - 0.35 * 4.0, 5.0, before=False))
    assert found.valid, found.reasons
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s[:-1], abs=0.05)
    (reason,) = grasps(found)
    assert reason.startswith("last cycle: the release: a step of ")
    assert found.theta_bar_deg == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("step", range(9))
def test_a_slip_in_a_regular_cycle_is_never_left_out_wherever_it_is(step):
    trial = simulate(tempo=uneven())
    found = find_cycles(jumped(trial, trial.endpoint_s[step] + 1.1, 5.0, before=False))
    assert found.valid, found.reasons
    assert len(found.endpoints) == 10
    assert grasps(found) == []
    assert "pose jump" in found.endpoints[step + 1].flags
    assert found.theta_bar_deg == pytest.approx(np.linalg.norm([0.8 + 5.0 / 9.0]), rel=0.15)


def test_an_end_of_another_length_without_a_jump_stays():
    trial = simulate(tempo=uneven(first=1.3, last=0.75))
    found = find_cycles(trial.series)
    assert len(found.endpoints) == 10
    assert grasps(found) == []


def test_where_no_cycle_is_like_another_a_jump_at_the_end_is_no_grasp():
    """Length and dwell are judged by how much they vary anyway."""
    tempo = 1.0 + 0.2 * np.random.default_rng(5).uniform(-1.0, 1.0, 10)
    trial = simulate(tempo=tempo)
    found = find_cycles(jumped(trial, trial.endpoint_s[0] + 1.1, 5.0, before=False))
    assert len(found.endpoints) == 10
    assert grasps(found) == []


def test_four_end_points_show_too_little_to_leave_one_out():
    trial = simulate(cycles=4, tempo=uneven(first=1.3, n=4))
    found = find_cycles(jumped(trial, trial.endpoint_s[0] + 1.4, 5.0, before=True))
    assert len(found.endpoints) == 4


def test_a_window_keeps_every_end_point_in_it():
    trial = simulate(tempo=uneven(first=1.3))
    series = jumped(trial, trial.endpoint_s[0] + 0.35 * 4.0, 5.0, before=True)
    found = find_cycles(series, window=(0.0, 60.0))
    assert len(found.endpoints) == 10
