"""What must not change the end points: signs, frames, quantisation, lost samples, noise, the sensor's heading drift."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analysis.cycles.search import CycleAnalysis, find_cycles
from analysis.series import FloatArray, OrientationSeries
from tests.simulated_motion import cosine, simulate, theta_bar_deg, trapezoid, two_humps

TRIALS = {
    "cosine": simulate(cosine, noise_deg=0.01),
    "trapezoid": simulate(trapezoid, period_s=2.0, swing_deg=25.0, noise_deg=0.01, seed=1),
    "two humps": simulate(two_humps, period_s=6.0, cycles=6, noise_deg=0.01, seed=2),
    "slips": simulate(cosine, slip_deg=8.0, slip_cycle=4, noise_deg=0.01, seed=3),
}
FOUND = {name: find_cycles(trial.series) for name, trial in TRIALS.items()}

trials = st.sampled_from(sorted(TRIALS))
turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


def changed(name: str, quats_wxyz: FloatArray, rows: slice | FloatArray = slice(None)) -> CycleAnalysis:
    series = TRIALS[name].series
    return find_cycles(OrientationSeries(series.times_s[rows], quats_wxyz, series.index[rows]))


def theta(found: CycleAnalysis) -> float:
    return theta_bar_deg(np.array([point.quat_wxyz for point in found.endpoints]))


def poses(name: str) -> Rotation:
    return Rotation.from_quat(TRIALS[name].series.quats_wxyz, scalar_first=True)


def wxyz(turned: Rotation) -> FloatArray:
    return np.asarray(turned.as_quat(scalar_first=True))


def same_count(found: CycleAnalysis, name: str) -> None:
    assert found.valid, found.reasons
    assert len(found.endpoints) == len(FOUND[name].endpoints)
    assert len(found.other_endpoints) == len(FOUND[name].other_endpoints)


def test_the_trials_themselves_are_found():
    for name, trial in TRIALS.items():
        assert FOUND[name].valid, (name, FOUND[name].reasons)
        assert len(FOUND[name].endpoints) == len(trial.endpoint_s)


@settings(max_examples=20, deadline=None)
@given(trials, st.integers(0, 2**32 - 1))
def test_signs_of_quaternions_change_nothing_at_all(name, seed):
    quats = TRIALS[name].series.quats_wxyz
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=(len(quats), 1))
    found, plain = changed(name, quats * signs), changed(name, quats)
    for point, before in zip(found.endpoints, plain.endpoints, strict=True):
        assert point.time_s == before.time_s
        assert point.flags == before.flags
        np.testing.assert_array_equal(point.quat_wxyz, before.quat_wxyz)


@settings(max_examples=20, deadline=None)
@given(trials, turns, turns)
def test_mounting_and_world_frame_change_nothing(name, world, mounting):
    left, right = Rotation.from_rotvec(world), Rotation.from_rotvec(mounting)
    found = changed(name, wxyz(left * poses(name) * right))
    same_count(found, name)
    assert theta(found) == pytest.approx(theta(FOUND[name]), abs=1e-8)
    expected = Rotation.from_quat([p.quat_wxyz for p in FOUND[name].endpoints], scalar_first=True)
    got = Rotation.from_quat([p.quat_wxyz for p in found.endpoints], scalar_first=True)
    assert np.degrees((got * (left * expected * right).inv()).magnitude()).max() < 1e-8


def smallest_three(quats: FloatArray, bits: int = 18) -> FloatArray:
    """Drop the largest component, quantise the others to ``bits`` over ±1/√2."""
    largest = np.argmax(np.abs(quats), axis=1)
    quats = quats * np.sign(np.take_along_axis(quats, largest[:, None], axis=1))
    scale = (2 ** (bits - 1) - 1) * np.sqrt(2.0)
    coarse = np.round(quats * scale) / scale
    np.put_along_axis(coarse, largest[:, None], 0.0, axis=1)
    rest = np.sqrt(np.maximum(1.0 - (coarse**2).sum(axis=1), 0.0))
    np.put_along_axis(coarse, largest[:, None], rest[:, None], axis=1)
    return coarse


@pytest.mark.parametrize("name", sorted(TRIALS))
@pytest.mark.parametrize(
    "quantise",
    [
        pytest.param(lambda q: q.astype(np.float32).astype(np.float64), id="float32"),
        pytest.param(lambda q: np.round(q * 32767.0) / 32767.0, id="int16"),
        pytest.param(smallest_three, id="smallest-three-18"),
    ],
)
def test_quantisation_moves_theta_by_less_than_two_thousandths(name, quantise):
    found = changed(name, quantise(TRIALS[name].series.quats_wxyz))
    same_count(found, name)
    assert theta(found) == pytest.approx(theta(FOUND[name]), abs=0.002)


@settings(max_examples=20, deadline=None)
@given(trials, st.integers(0, 2**32 - 1))
def test_a_tenth_of_the_samples_lost_changes_next_to_nothing(name, seed):
    series = TRIALS[name].series
    rows = np.flatnonzero(np.random.default_rng(seed).random(len(series)) > 0.1)
    found = changed(name, series.quats_wxyz[rows], rows)
    same_count(found, name)
    assert theta(found) == pytest.approx(theta(FOUND[name]), abs=0.005)


@settings(max_examples=12, deadline=None)
@given(trials, st.integers(0, 2**32 - 1))
def test_noise_of_a_tenth_of_a_degree(name, seed):
    quats = poses(name)
    noise = np.radians(0.1) * np.random.default_rng(seed).standard_normal((len(quats), 3))
    found = changed(name, wxyz(Rotation.from_rotvec(noise) * quats))
    same_count(found, name)
    assert theta(found) == pytest.approx(theta(FOUND[name]), abs=0.05)


@settings(max_examples=12, deadline=None)
@given(trials, st.sampled_from([-1.0, 1.0]))
def test_heading_drift_of_one_degree_a_minute(name, direction):
    series = TRIALS[name].series
    heading = np.radians(direction / 60.0) * series.times_s
    found = changed(name, wxyz(Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0]) * poses(name)))
    same_count(found, name)
    assert abs(theta(found) - theta(FOUND[name])) <= FOUND[name].period_s / 60.0 + 0.005


@settings(max_examples=12, deadline=None)
@given(st.integers(2, 7), st.sampled_from([8.0, -8.0]), st.booleans())
def test_an_interior_slip_reaches_the_score(cycle, slip_deg, along):
    axis = (0.2, 0.9, -0.4) if along else (0.9, 0.1, 0.3)
    still = find_cycles(simulate(cycles=10, drift_deg=0.0, drift_axis=axis).series)
    slipped = find_cycles(
        simulate(cycles=10, drift_deg=0.0, slip_deg=slip_deg, slip_cycle=cycle, drift_axis=axis).series
    )
    assert len(slipped.endpoints) == len(still.endpoints) == 10
    assert theta(slipped) - theta(still) == pytest.approx(8.0 / 9.0, rel=0.1)
    assert ["pose jump" in point.flags for point in slipped.endpoints].index(True) == cycle + 1


def test_time_and_amplitude_have_no_scale():
    base = simulate(cycles=8, period_s=4.0)
    for stretch in (0.3, 3.0):
        series = base.series
        found = find_cycles(OrientationSeries(series.times_s * stretch, series.quats_wxyz, series.index))
        assert len(found.endpoints) == 8
        assert found.period_s == pytest.approx(4.0 * stretch, rel=2e-3)
    for swing_deg in (2.0, 5.0, 120.0, 300.0):
        trial = simulate(cycles=8, swing_deg=swing_deg, drift_deg=0.1)
        found = find_cycles(trial.series)
        assert len(found.endpoints) == 8
        assert found.swing_deg == pytest.approx(swing_deg, rel=0.02)
