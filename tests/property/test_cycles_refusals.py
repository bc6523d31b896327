"""Motions that are no trials: refused with the reason, never scored."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.cycles.search import find_cycles
from analysis.series import OrientationSeries
from tests.simulated_motion import (
    cosine,
    from_angular_velocity,
    from_rotation_vectors,
    random_smooth,
    simulate,
    trapezoid,
)

seeds = st.integers(0, 2**32 - 1)
AXIS = np.array([0.2, 0.9, -0.4]) / np.linalg.norm([0.2, 0.9, -0.4])


@settings(max_examples=15, deadline=None)
@given(seeds, st.floats(0.0, 0.5))
def test_a_static_object(seed, noise_deg):
    noise = np.random.default_rng(seed).standard_normal((4000, 3))
    found = find_cycles(from_rotation_vectors(np.radians(noise_deg) * noise))
    assert not found.valid
    assert any(word in found.reasons[0] for word in ("no period", "range of motion", "does not move"))


@settings(max_examples=15, deadline=None)
@given(seeds, st.floats(1.0, 30.0))
def test_a_random_walk(seed, rate_deg):
    omega = np.radians(rate_deg) * np.random.default_rng(seed).standard_normal((3000, 3))
    found = find_cycles(from_angular_velocity(omega))
    assert not found.valid
    assert found.reasons


@settings(max_examples=15, deadline=None)
@given(seeds, st.floats(1.0, 200.0), st.floats(0.0, 0.2))
def test_a_constant_rotation(seed, rate_deg, noise_deg):
    rng = np.random.default_rng(seed)
    turn = np.radians(rate_deg) * np.arange(4000)[:, None] / 100.0 * AXIS
    found = find_cycles(from_rotation_vectors(turn + np.radians(noise_deg) * rng.standard_normal((4000, 3))))
    assert not found.valid
    assert any("one-way" in reason or "no period" in reason for reason in found.reasons)


@settings(max_examples=15, deadline=None)
@given(st.floats(0.0, 0.35), st.floats(1.0, 6.0))
def test_one_way_finger_gaiting(back_share, period_s):
    """Forward by 30° and back by a part of that, over and over."""
    t = np.arange(int(12 * period_s * 100)) / 100.0
    part, cycle = (t / period_s) % 1.0, np.floor(t / period_s)
    forward = 30.0 * (0.5 - 0.5 * np.cos(np.pi * np.clip(part / 0.5, 0.0, 1.0)))
    back = 30.0 * back_share * (0.5 - 0.5 * np.cos(np.pi * np.clip((part - 0.6) / 0.3, 0.0, 1.0)))
    angle = 30.0 * (1.0 - back_share) * cycle + forward - back
    found = find_cycles(from_rotation_vectors(np.radians(angle)[:, None] * AXIS))
    assert not found.valid
    assert any("one-way" in reason for reason in found.reasons), found.reasons


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2), st.sampled_from([cosine, trapezoid]), st.floats(1.0, 10.0), st.floats(0.0, 0.1))
def test_fewer_than_three_cycles(cycles, shape, period_s, noise_deg):
    trial = simulate(
        shape, cycles=max(cycles, 1), swing_deg=40.0 if cycles else 0.0, period_s=period_s, noise_deg=noise_deg
    )
    found = find_cycles(trial.series)
    assert not found.valid
    assert "fewer than 3 cycles" in found.reasons[0] or not cycles


@pytest.mark.parametrize("swings", [1, 2, 3, 4, 5])
def test_a_recording_that_ends_before_the_third_cycle_says_so(swings):
    """Cut at every extreme, and after a rest there: three swings leave it turned by a third of its path."""
    whole = simulate(cycles=6, period_s=4.0, swing_deg=40.0, drift_deg=0.8)
    held = whole.series.times_s <= whole.endpoint_s[0] - 2.0 + 2.0 * swings
    for rest in (0, 200):
        quats = np.concatenate([whole.series.quats_wxyz[held], np.repeat(whole.series.quats_wxyz[held][-1:], rest, 0)])
        times_s = np.arange(len(quats)) / 100.0
        found = find_cycles(OrientationSeries(times_s, quats, np.arange(len(quats))))
        assert not found.valid
        assert "fewer than 3 cycles" in found.reasons[0], (rest, found.reasons)


@pytest.mark.parametrize("swing_deg", [0.1, 0.3, 0.45])
def test_too_small_a_motion(swing_deg):
    found = find_cycles(simulate(swing_deg=swing_deg, drift_deg=0.0).series)
    assert not found.valid
    assert "range of motion" in found.reasons[0]


@pytest.mark.parametrize("rows", [0, 1, 2, 9])
def test_next_to_no_samples(rows):
    series = simulate().series
    found = find_cycles(OrientationSeries(series.times_s[:rows], series.quats_wxyz[:rows], series.index[:rows]))
    assert not found.valid
    assert "too short" in found.reasons[0]


def test_random_smooth_motion_is_scored_in_at_most_one_of_fifty_trials():
    """A sample of what ``benchmarks/random_motion.py`` measures over many more."""
    accepted = [
        len(found.endpoints) >= 5
        for seed in range(60)
        for found in [find_cycles(random_smooth(seed, bandwidth_s=(0.3, 0.6, 1.2)[seed % 3], one_axis=seed % 2 == 0))]
        if found.valid
    ]
    assert sum(accepted) <= 1


@settings(max_examples=10, deadline=None)
@given(seeds)
def test_jerks_between_rests_about_changing_axes_are_called_grasp_and_release(seed):
    """Four snaps per cycle, each about its own axis, at rest in between: let go, open, come back, close."""
    rng = np.random.default_rng(seed)
    snaps = np.array([[3.0, 1.0, 0.0], [-1.0, 2.5, 1.0], [-2.0, -1.0, 1.5], [0.0, -2.5, -2.5]])
    t = np.arange(6000) / 100.0
    rotvec = np.zeros((len(t), 3))
    for cycle in range(12):
        for k, snap in enumerate(snaps + 0.3 * rng.standard_normal((4, 3))):
            rotvec += snap * np.clip((t - 5.0 * cycle - 1.25 * k - 0.5) / 0.15, 0.0, 1.0)[:, None]
    found = find_cycles(from_rotation_vectors(np.radians(rotvec)))
    assert not found.valid
    assert found.reasons
