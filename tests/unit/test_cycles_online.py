"""The online search: what it confirms, when, and what it keeps to itself."""

from __future__ import annotations

import time
import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.cycles.online.detector import OnlineCycleDetector
from analysis.cycles.search import find_cycles
from analysis.cycles.settings import Endpoint
from analysis.series import OrientationSeries
from benchmarks.regimes import draw
from tests.simulated_motion import cosine, from_rotation_vectors, sawtooth, simulate, trapezoid, two_humps
from tests.waiting import SLOW_S


def follow(series: OrientationSeries, chunk: int = 7) -> tuple[OnlineCycleDetector, list[tuple[Endpoint, float]]]:
    """Feed in chunks; give the detector and each end point with the time at which it was known."""
    detector = OnlineCycleDetector()
    known: list[tuple[Endpoint, float]] = []
    withdrawn = 0
    for start in range(0, len(series), chunk):
        rows = slice(start, start + chunk)
        new = detector.feed(series.times_s[rows], series.quats_wxyz[rows], series.index[rows].tolist())
        if detector.state.withdrawn > withdrawn:
            known, withdrawn = [], detector.state.withdrawn
        known += [(point, float(series.times_s[rows][-1])) for point in new]
    return detector, known


@pytest.mark.parametrize("period_s", [0.7, 4.0, 15.0])
@pytest.mark.parametrize("shape", [cosine, trapezoid, sawtooth])
def test_agrees_with_the_offline_search(shape, period_s):
    trial = simulate(shape, period_s=period_s, noise_deg=0.02)
    offline = find_cycles(trial.series)
    detector, known = follow(trial.series, chunk=1)
    assert len(known) == len(offline.endpoints) == len(trial.endpoint_s)
    late = [(at_s - point.time_s) / period_s for point, at_s in known]
    off = [
        abs(point.time_s - reference.time_s) / period_s
        for (point, _), reference in zip(known, offline.endpoints, strict=True)
    ]
    assert np.median(off) < 0.005
    assert max(off) < 0.02
    assert np.median(late) <= 0.27  # a fast trapezoid dwells longest
    assert max(late) <= 0.40
    state = detector.state
    assert state.period_s == pytest.approx(period_s, rel=0.01)
    assert state.endpoints == len(known)
    assert state.other_endpoints >= len(known) - 1
    assert abs(np.dot(state.axis, np.array([0.2, 0.9, -0.4]) / np.linalg.norm([0.2, 0.9, -0.4]))) > 0.98
    assert state.swing_deg == pytest.approx(40.0, rel=0.05)
    assert not state.moving
    assert 0.0 < state.phase <= 1.0


def test_chunks_make_no_difference():
    trial = simulate(noise_deg=0.1, cycles=6)
    _, one = follow(trial.series, 1)
    _, all_at_once = follow(trial.series, len(trial.series))
    assert [point.time_s for point, _ in one] == [point.time_s for point, _ in all_at_once]
    for (a, _), (b, _) in zip(one, all_at_once, strict=True):
        np.testing.assert_array_equal(a.quat_wxyz, b.quat_wxyz)


def test_end_points_carry_the_name_of_the_nearest_sample():
    trial = simulate(cycles=5)
    series = OrientationSeries(trial.series.times_s, trial.series.quats_wxyz, trial.series.index + 70_000)
    _, known = follow(series)
    for point, _ in known:
        nearest = int(np.argmin(np.abs(series.times_s - point.time_s)))
        assert abs(point.index - 70_000 - nearest) <= 1


@pytest.mark.parametrize("noise_deg", [0.0, 0.02, 0.2])
def test_an_object_at_rest_has_no_end_points(noise_deg):
    rng = np.random.default_rng(3)
    series = from_rotation_vectors(np.radians(noise_deg) * rng.standard_normal((6000, 3)))
    detector, known = follow(series)
    assert known == []
    assert detector.state.endpoints == 0
    assert np.isnan(detector.state.period_s)


def test_a_quick_move_into_place_and_a_hold_are_the_start_pose():
    ramp = np.clip(np.arange(800) / 100.0, 0.0, 1.0)
    t = np.arange(2400) / 100.0
    angle = np.concatenate((17.0 * ramp, 17.0 - 12.0 * (1.0 - np.cos(2.0 * np.pi * t / 4.0))))
    series = from_rotation_vectors(np.radians(angle)[:, None] * [0.0, 0.6, 0.8])
    _, known = follow(series)
    assert [point.time_s for point, _ in known] == pytest.approx(8.0 + 2.0 + 4.0 * np.arange(6), abs=0.05)


def test_a_wriggle_before_the_first_cycle_is_withdrawn():
    trial = simulate(cycles=5)
    t = trial.series.times_s
    wriggle = np.radians(-4.0) * np.exp(-(((t - 1.5) / 0.2) ** 2))
    moved = Rotation.from_rotvec(wriggle[:, None] * [0.2, 0.9, -0.4]) * Rotation.from_quat(
        trial.series.quats_wxyz, scalar_first=True
    )
    series = OrientationSeries(t, moved.as_quat(scalar_first=True), trial.series.index)
    detector, known = follow(series)
    assert detector.state.withdrawn == 1
    assert [point.time_s for point, _ in known] == pytest.approx(trial.endpoint_s, abs=0.05)


def test_lone_outliers_change_next_to_nothing():
    trial = simulate(swing_deg=6.0, cycles=6)
    quats = trial.series.quats_wxyz.copy()
    rng = np.random.default_rng(1)
    rows = rng.choice(np.arange(10, len(quats) - 10, 4), 20, replace=False)
    wrong = Rotation.from_rotvec(np.radians(10.0) * rng.normal(size=(20, 3)))
    quats[rows] = (wrong * Rotation.from_quat(quats[rows], scalar_first=True)).as_quat(scalar_first=True)
    _, clean = follow(trial.series, 1)
    _, known = follow(OrientationSeries(trial.series.times_s, quats, trial.series.index), 1)
    assert [point.time_s for point, _ in known] == pytest.approx([point.time_s for point, _ in clean], abs=0.02)


@pytest.mark.parametrize("hold_s", [0.3, 1.5])
def test_putting_the_object_in_place_does_not_hide_smaller_cycles(hold_s):
    """Moved by more than twice the swing: the cycles after it are known as soon as any others."""
    ramp = np.minimum(np.arange(100 + round(100 * hold_s)) / 100.0, 1.0)
    t = np.arange(2400) / 100.0
    angle = np.concatenate((45.0 * ramp, 45.0 - 9.0 * (1.0 - np.cos(2.0 * np.pi * t / 4.0))))
    _, known = follow(from_rotation_vectors(np.radians(angle)[:, None] * [0.0, 0.6, 0.8]), chunk=1)
    first_s = 1.0 + hold_s + 4.0
    cycles = [(point.time_s, at_s) for point, at_s in known if point.time_s > first_s - 1.0]
    assert [time_s for time_s, _ in cycles] == pytest.approx(first_s + 4.0 * np.arange(5), abs=0.05)
    assert max(at_s - time_s for time_s, at_s in cycles) < 0.4 * 4.0


def test_of_several_humps_the_highest_ends_the_cycle():
    trial = simulate(two_humps, cycles=12)
    detector, known = follow(trial.series)
    assert detector.state.withdrawn > 0  # until the pattern is plain, every hump counts
    assert [point.time_s for point, _ in known] == pytest.approx(trial.endpoint_s, abs=0.1)
    assert detector.state.period_s == pytest.approx(4.0, rel=0.01)
    assert detector.state.endpoints == 12


def test_a_gap_in_the_data_starts_a_new_run():
    trial = simulate(cycles=8)
    t = trial.series.times_s
    keep = (t < 16.2) | (t > 17.6)
    series = OrientationSeries(t[keep], trial.series.quats_wxyz[keep], trial.series.index[keep])
    detector, known = follow(series)
    assert detector.state.runs == 2
    missing = [end for end in trial.endpoint_s if min(abs(point.time_s - end) for point, _ in known) > 0.2]
    assert missing == [17.0]  # the one inside the gap, and no other


def test_slips_are_flagged_and_never_dropped():
    trial = simulate(cycles=10, slip_deg=18.0, slip_cycle=5, swing_deg=20.0, drift_axis=(0.2, 0.9, -0.4))
    _, known = follow(trial.series)
    assert len(known) == 10
    assert ["pose jump" in point.flags for point, _ in known] == [k == 6 for k in range(10)]


def test_samples_out_of_order_or_not_numbers_are_passed_over():
    trial = simulate(cycles=4)
    t, q = trial.series.times_s.copy(), trial.series.quats_wxyz.copy()
    _, clean = follow(trial.series)
    t = np.insert(t, [700, 900], [t[650], np.nan])
    q = np.insert(q, [700, 900], q[0], axis=0)
    detector = OnlineCycleDetector()
    known = detector.feed(t, q)
    assert [point.time_s for point in known] == [point.time_s for point, _ in clean]


def test_the_state_is_a_snapshot():
    trial = simulate(cycles=4)
    detector = OnlineCycleDetector()
    assert np.isnan(detector.state.time_s)
    detector.feed(trial.series.times_s[:1400], trial.series.quats_wxyz[:1400])
    middle = detector.state
    assert middle.moving
    assert middle.endpoints == 3
    assert 0.0 < middle.phase < 1.0
    detector.feed(trial.series.times_s[1400:], trial.series.quats_wxyz[1400:])
    assert middle.endpoints == 3
    assert detector.state.endpoints == 4


def test_memory_and_time_per_sample_stay_small():
    trial = simulate(cycles=100, period_s=1.0)
    detector = OnlineCycleDetector()
    size = 100
    sizes = []
    tracemalloc.start()
    for start in range(0, len(trial.series), size):
        rows = slice(start, start + size)
        detector.feed(trial.series.times_s[rows], trial.series.quats_wxyz[rows])
        sizes.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    started = time.process_time()
    OnlineCycleDetector().feed(trial.series.times_s, trial.series.quats_wxyz)
    assert time.process_time() - started < SLOW_S
    half = len(sizes) // 2
    assert max(sizes[half:]) < 1.05 * max(sizes[:half])  # the ring of moments is full by then


@pytest.mark.parametrize("seed", range(2000, 2005))
def test_a_tremor_before_the_first_cycle_makes_no_end_points(seed):
    """8 Hz, 1° from top to bottom, for seconds before the motion: faster than any cycle, and never a part of one."""
    series = draw("tremor of 8 Hz", seed).series
    _, known = follow(series, chunk=16)
    times_s = np.array([point.time_s for point in find_cycles(series).endpoints])
    assert [point.time_s for point, _ in known] == pytest.approx(times_s, abs=0.15)
