"""How many strokes make a cycle: on shapes made for it, and on trials of regimes whose period is known."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import analysis
from analysis.cycles.pairing.grouping import Grouping, group, kinds, one_a_cycle
from analysis.cycles.pairing.strokes import StrokePairs
from analysis.cycles.repetition import agreement
from analysis.cycles.search import find_cycles
from analysis.cycles.turning_points import turning_points
from benchmarks import simulated_trials
from benchmarks.regimes import RANDOM, draw, random_motion
from tests.simulated_motion import from_rotation_vectors, simulate

REGIMES = {
    "two peaks, one a little lower": 2,
    "two peaks that differ across": 2,
    "two peaks, speeding up": 2,
    "three peaks, nearly alike": 3,
    "tempo ±20 %": 1,
}


def pairs(shapes) -> StrokePairs:
    return StrokePairs(np.asarray(shapes), np.zeros((len(shapes), 2)))


def cycles_of(k: int, n: int, *, apart: float, noise: float, seed: int = 0) -> np.ndarray:
    """(n, 40) shapes of n pairs, k kinds in turn that are so far apart, with noise and drift."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(k, 40))
    means *= apart / np.sqrt(2.0) / np.linalg.norm(means, axis=1)[:, None]
    drift = 0.01 * np.arange(n)[:, None] * rng.normal(size=40) / np.sqrt(40.0)
    return means[np.arange(n) % k] + drift + noise * rng.normal(size=(n, 40)) / np.sqrt(40.0)


def grouped(shapes) -> Grouping:
    return group((pairs(shapes), pairs(shapes[:-1])))


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_kinds_that_are_far_apart_are_counted(k):
    shapes = cycles_of(k, 5 * k + 4, apart=0.3, noise=0.02)
    found = grouped(shapes)
    assert (found.pairs, found.possible) == (k, 0)
    assert found.spread == pytest.approx(0.02 * np.sqrt(2.0), rel=0.3)


def test_a_pair_too_few_does_not_hide_the_kinds_and_does_not_turn_them():
    shapes = np.delete(cycles_of(2, 24, apart=0.3, noise=0.02), 11, axis=0)
    assert grouped(shapes).pairs == 2
    label = kinds(pairs(shapes), 2)
    expected = np.delete(np.arange(24) % 2, 11)
    assert (label == expected).all() or (label == 1 - expected).all()


def test_what_hardly_differs_is_found_in_many_pairs_and_both_periods_remain_possible():
    found = grouped(cycles_of(2, 24, apart=0.05, noise=0.02))
    assert (found.pairs, found.possible) == (2, 1)


def test_scatter_alone_makes_no_kinds():
    counts = [grouped(cycles_of(1, 6 + seed % 20, apart=0.0, noise=0.12, seed=seed)).pairs for seed in range(60)]
    assert counts.count(1) >= 59


def test_pairs_that_are_all_one_are_one_kind():
    assert grouped(np.ones((12, 40))).pairs == 1
    assert grouped(np.ones((1, 40))).pairs == 1


def test_one_turning_point_a_cycle_is_always_the_same():
    t = np.arange(2400) / 200.0
    angle = np.sin(2.0 * np.pi * 2.0 * t) * (1.0 + 0.3 * np.sin(2.0 * np.pi * t))
    found = turning_points(angle, 0.4)
    label = np.arange((len(found) - 1) // 2) % 2
    chosen = one_a_cycle(found, angle, label, 2, 200.0)
    upper = angle[chosen.points[chosen.upper]]
    assert np.diff(chosen.points[chosen.upper]).tolist() == pytest.approx([200] * (len(upper) - 1), abs=1)
    assert upper == pytest.approx(np.full(len(upper), angle.max()), abs=0.01)


@pytest.mark.parametrize("seed", range(2000, 2004))
@pytest.mark.parametrize("name", REGIMES)
def test_the_period_of_a_regime_is_right(name, seed):
    trial = draw(name, seed)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_s == pytest.approx(trial.period_s, rel=0.15)
    assert len(found.endpoints) >= trial.n_cycles - 1


def test_two_peaks_that_nothing_separates_are_reported_with_both_periods():
    """Strokes of one form, every second one a little larger."""
    t = np.arange(3600) / 100.0
    rng = np.random.default_rng(4)
    depth = 1.0 + 0.02 * np.cos(np.pi * np.floor(t / 2.0)) + 0.01 * rng.normal(size=18)[(t / 2.0).astype(int)]
    angle = np.radians(20.0) * np.sin(np.pi * t / 2.0) ** 2 * depth
    found = find_cycles(from_rotation_vectors(angle[:, None] * [0.0, 0.6, 0.8]))
    assert found.valid, found.reasons
    (both,) = [warning for warning in found.warnings if "two periods are possible" in warning]
    periods_s = [float(value) for value in re.findall(r"([0-9.]+) s with", both)]
    assert sorted(periods_s) == pytest.approx([2.0, 4.0], abs=0.1)
    assert periods_s[0] == pytest.approx(found.period_s, abs=0.01)
    assert both.count("θ̄") == 2
    assert f"{found.theta_bar_deg:.2f}°" in both


def test_a_shrinking_swing_does_not_pass_as_drift():
    """One end of the motion stays, the other comes nearer by 4 % a cycle: no drift at all."""
    trial = simulate(cycles=12, swing_deg=30.0, drift_deg=0.0, amplitude=0.96 ** np.arange(12))
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert any("the swing shrinks by 4.0% a cycle" in warning for warning in found.warnings)
    assert found.theta_bar_deg < 0.05


def test_a_swing_beyond_a_full_turn_is_not_valid():
    found = find_cycles(simulate(swing_deg=700.0, period_s=8.0).series)
    assert not found.valid
    assert any("more than a full turn" in reason for reason in found.reasons)


@pytest.mark.parametrize("swing_deg", [15.0, 100.0])
@pytest.mark.parametrize("scatter", [0.0, 0.15, 0.6])
def test_steps_agree_or_not_whatever_the_size_of_the_swing(swing_deg, scatter):
    """The eigenvalue share of the card's matrix alone would pass anything small, and little that is large."""
    rng = np.random.default_rng(3)
    apart = np.radians(scatter * swing_deg) * rng.normal(size=(400, 3)) / np.sqrt(3.0)
    share = agreement(Rotation.from_rotvec(apart).as_quat(scalar_first=True), np.radians(swing_deg))
    assert share == pytest.approx(np.exp(-(scatter**2)), abs=0.03)


def test_one_slip_does_not_make_steps_disagree():
    steps = np.zeros((10, 3))
    steps[4] = np.radians(12.0)
    assert agreement(Rotation.from_rotvec(steps).as_quat(scalar_first=True), np.radians(20.0)) > 0.9


def test_a_steady_drift_is_claimed_however_large_it_is_beside_the_swing():
    found = find_cycles(simulate(swing_deg=12.0, drift_deg=6.0, drift_axis=(0.9, -0.2, 0.0)).series)
    assert found.valid, found.reasons
    assert found.theta_bar_deg == pytest.approx(6.0, abs=0.05)


@pytest.mark.parametrize("seed", [711, 771])
def test_sizes_that_alternate_by_chance_leave_both_periods_possible(seed):
    trial = simulated_trials.draw(seed)
    found = find_cycles(trial.series)
    (both,) = [warning for warning in found.warnings if "two periods are possible" in warning]
    assert f"{trial.period_s:.2f} s with θ̄" in both


def test_turning_points_that_were_missed_make_no_pause():
    """The motion axis is ambiguous and hides one cycle; the object turns on meanwhile, it does not rest."""
    found = find_cycles(simulated_trials.draw(231).series)
    assert np.diff([point.time_s for point in found.endpoints]).max() < 1.3 * found.period_s
    assert not any("pause" in warning for warning in found.warnings)


def test_steps_that_scatter_by_a_third_of_the_swing_claim_nothing():
    rng = np.random.default_rng(1)
    t = np.arange(6000) / 100.0
    swing = np.radians(10.0) * (0.5 - 0.5 * np.cos(2.0 * np.pi * t / 4.0))
    pose = np.radians(6.0) * rng.normal(size=16)[(t / 4.0).astype(int)]
    found = find_cycles(from_rotation_vectors(swing[:, None] * [0.0, 0.6, 0.8] + pose[:, None] * [1.0, 0.0, 0.0]))
    assert not found.valid
    assert any("steps scatter" in reason or "do not repeat" in reason for reason in found.reasons)


@pytest.mark.parametrize("name", RANDOM)
def test_random_motion_is_not_taken_for_a_trial(name):
    taken = [analysis.score(random_motion(name, seed)).valid for seed in range(2000, 2005)]
    assert not any(taken)
