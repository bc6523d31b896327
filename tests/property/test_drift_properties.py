"""What no change of frame, sign or mounting may do to θ̄."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from analysis.geometry import rotations
from analysis.scoring.card import rotation_drift
from analysis.scoring.diagnostics import drift_diagnostics
from analysis.scoring.interval import drift_interval


@st.composite
def endpoint_sets(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(2, 30))
    theta, scatter = draw(st.floats(0.0, 0.5)), draw(st.sampled_from([0.0, 1e-6, 1e-3, 0.02, 0.1]))
    quats = [rotations.exp(rng.normal(size=3))]
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    for _ in range(n - 1):
        step = rotations.exp(theta * axis + rng.normal(scale=scatter, size=3))
        quats.append(rotations.multiply(step, quats[-1]))
    return np.array(quats), rng


@given(endpoint_sets())
def test_theta_bar_ignores_signs_mounting_and_world(case):
    quats, rng = case
    theta = rotation_drift(quats).theta_bar_deg
    signs = rng.choice([-1.0, 1.0], size=(len(quats), 1))
    assert rotation_drift(quats * signs).theta_bar_deg == theta
    turn = rotations.exp(rng.normal(size=3))
    np.testing.assert_allclose(rotation_drift(rotations.multiply(quats, turn)).theta_bar_deg, theta, atol=1e-8)
    turned = rotation_drift(rotations.multiply(turn, quats))
    np.testing.assert_allclose(turned.theta_bar_deg, theta, atol=1e-8)
    if theta > 1e-3:
        axis = rotations.rotate(turn, rotation_drift(quats).axis)
        np.testing.assert_allclose(turned.axis, axis, atol=1e-6)


@given(endpoint_sets())
def test_backwards_the_drift_is_as_large(case):
    quats, _ = case
    forward, backward = rotation_drift(quats), rotation_drift(quats[::-1])
    np.testing.assert_allclose(backward.theta_bar_deg, forward.theta_bar_deg, atol=1e-8)


@given(endpoint_sets())
def test_companions_and_interval_are_finite_and_ordered(case):
    quats, _ = case
    drift = rotation_drift(quats)
    diagnostics = drift_diagnostics(quats, drift)
    assert drift.theta_bar_deg <= diagnostics.mean_step_deg * 1.1 + 1e-9
    assert 0.0 <= diagnostics.axis_share <= 1.0 + 1e-9
    assert diagnostics.net_rotation_deg <= diagnostics.max_excursion_deg + 1e-9
    if diagnostics.leave_one_out_deg is not None:
        low, high = diagnostics.leave_one_out_deg
        assert low <= min(diagnostics.without_first_deg, diagnostics.without_last_deg)
        assert high >= max(diagnostics.without_first_deg, diagnostics.without_last_deg)
    interval = drift_interval(drift.step_rotations_wxyz)
    assert (interval is None) == (len(quats) < 5)
    if interval is not None:
        assert 0.0 <= interval.low_deg <= drift.theta_bar_deg + 1e-9
        assert drift.theta_bar_deg <= interval.high_deg + 1e-9 <= 180.0 + 1e-6
        assert 0.0 <= interval.no_drift_p <= 1.0
