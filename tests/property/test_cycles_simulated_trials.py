"""Trials of any shape, size, tempo and rate, with drift, slips, wobble and noise: every end point, and no other."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from analysis.cycles.online.detector import OnlineCycleDetector
from analysis.cycles.search import find_cycles
from tests.simulated_motion import Trial, cosine, sawtooth, simulate, trapezoid, triangle, two_humps


@st.composite
def trials(draw) -> Trial:
    shape = draw(st.sampled_from([cosine, trapezoid, triangle, sawtooth, two_humps]))
    cycles = draw(st.integers(5, 16))
    period_s = draw(st.floats(0.8, 15.0))
    swing_deg = draw(st.floats(3.0, 150.0))
    rate_hz = draw(st.sampled_from([25.0, 50.0, 100.0, 240.0]))
    assume(shape is not two_humps or rate_hz * period_s > 60)
    assume(cycles * period_s * rate_hz < 30_000)
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    return simulate(
        shape,
        cycles=cycles,
        period_s=period_s,
        swing_deg=swing_deg,
        rate_hz=rate_hz,
        axis=tuple(rng.normal(size=3)),
        drift_axis=tuple(rng.normal(size=3)),
        drift_deg=swing_deg * draw(st.floats(0.0, 0.1)),
        lead_s=draw(st.floats(0.0, 5.0)),
        tempo=1.0 + 0.05 * rng.normal(size=cycles).clip(-2.0, 2.0),
        amplitude=1.0 + 0.08 * rng.normal(size=cycles).clip(-2.0, 2.0),
        wobble_deg=swing_deg * draw(st.floats(0.0, 0.12)),
        noise_deg=swing_deg * draw(st.floats(0.0, 0.01)),
        slip_deg=swing_deg * draw(st.sampled_from([0.0, 0.0, 0.2])),
        slip_cycle=int(rng.integers(1, cycles - 1)),
        seed=seed,
    )


def offsets(times_s: np.ndarray, trial: Trial) -> np.ndarray:
    """Distance of each found end point from the nearest true one, periods."""
    away = times_s[:, None] - trial.endpoint_s
    return away[np.arange(len(times_s)), np.abs(away).argmin(axis=1)] / np.median(np.diff(trial.endpoint_s))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(trials())
def test_every_end_point_and_no_other(trial):
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    extremes = [np.array([point.time_s for point in points]) for points in (found.endpoints, found.other_endpoints)]
    times_s = min(extremes, key=lambda times_s: float(np.abs(offsets(times_s, trial)).mean()))
    assert len(times_s) == len(trial.endpoint_s)
    off = offsets(times_s, trial)
    assert np.abs(off - np.median(off)).max() < 0.06
    assert abs(found.period_s / np.median(np.diff(trial.endpoint_s)) - 1.0) < 0.02


@settings(max_examples=20, deadline=None, derandomize=True)
@given(trials())
def test_online_finds_the_same(trial):
    found = find_cycles(trial.series)
    detector = OnlineCycleDetector()
    known: list[float] = []
    withdrawn = 0
    series = trial.series
    for start in range(0, len(series), 16):
        new = detector.feed(series.times_s[start : start + 16], series.quats_wxyz[start : start + 16])
        if detector.state.withdrawn > withdrawn:
            known, withdrawn = [], detector.state.withdrawn
        known += [point.time_s for point in new]
    online_s = np.array(known)
    extremes = [np.array([point.time_s for point in points]) for points in (found.endpoints, found.other_endpoints)]
    reference_s = min(extremes, key=lambda times_s: float(np.abs(times_s[:, None] - online_s).min(axis=0).mean()))
    inside = (online_s > reference_s[0] - 0.5 * found.period_s) & (online_s < reference_s[-1] + 0.5 * found.period_s)
    assert inside.sum() == len(reference_s)
    assert np.abs(online_s[inside] - reference_s).max() < 0.06 * found.period_s
