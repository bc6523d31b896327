"""Whatever was recorded, the score is a result or a refusal, in finite JSON, and frames do not change it."""

import json

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.geometry import rotations
from analysis.scoring.trial import score_series
from analysis.series import OrientationSeries
from tests.simulated_motion import cosine, simulate, trapezoid, two_humps


def recording(seed, n, kind):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.choice([1e-5, 0.01, 0.01, 0.011, 0.3], size=n, p=[0.02, 0.5, 0.3, 0.17, 0.01]))
    scale = {"walk": 0.02, "still": 0.0, "noise": 0.0, "wild": 2.0}[kind]
    path = np.cumsum(rng.normal(scale=scale, size=(n, 3)), axis=0)
    path += rng.normal(scale=0.5 if kind == "noise" else 0.0, size=(n, 3))
    return OrientationSeries(times, rotations.exp(path), np.arange(n))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 3000), st.sampled_from(["walk", "still", "noise", "wild"]))
def test_never_raises_and_json_is_finite(seed, n, kind):
    score = score_series(recording(seed, n, kind))
    result = json.loads(json.dumps(score.to_json(), allow_nan=False))
    assert result["valid"] == (not result["reasons"])
    assert (result["theta_bar_deg"] is None) == (not result["valid"])


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([cosine, trapezoid, two_humps]), st.floats(0.05, 3.0))
def test_frames_and_signs_change_nothing(seed, shape, drift_deg):
    rng = np.random.default_rng(seed)
    series = simulate(shape, drift_deg=drift_deg, cycles=7, noise_deg=0.02, seed=seed).series
    turn, mounting = rotations.exp(rng.normal(size=(2, 3)))
    quats = rotations.multiply(turn, rotations.multiply(series.quats_wxyz, mounting))
    other = OrientationSeries(series.times_s, quats * rng.choice([-1.0, 1.0], size=(len(series), 1)), series.index)
    first, second = score_series(series), score_series(other)
    assert first.valid
    assert second.valid
    assert abs(first.theta_bar_deg - second.theta_bar_deg) < 1e-8
    np.testing.assert_allclose(rotations.rotate(turn, np.array(first.axis)), second.axis, atol=1e-6)
