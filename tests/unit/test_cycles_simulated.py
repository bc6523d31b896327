"""The offline search on simulated trials whose end points are known."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.cycles.search import CycleAnalysis, find_cycles
from analysis.series import OrientationSeries
from tests.simulated_motion import (
    cosine,
    equal_peaks,
    from_rotation_vectors,
    sawtooth,
    simulate,
    staircase,
    theta_bar_deg,
    trapezoid,
    triangle,
    two_humps,
)
from tests.waiting import HANG_S, SLOW_S


def theta(found: CycleAnalysis) -> float:
    return theta_bar_deg(np.array([point.quat_wxyz for point in found.endpoints]))


@pytest.mark.parametrize("period_s", [0.7, 4.0, 15.0])
@pytest.mark.parametrize("shape", [cosine, trapezoid, triangle, sawtooth])
def test_every_end_point_is_found_at_one_phase(shape, period_s):
    trial = simulate(shape, period_s=period_s)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_s == pytest.approx(period_s, rel=1e-3)
    assert found.period_confidence > 0.85
    assert len(found.endpoints) == len(trial.endpoint_s)
    assert len(found.other_endpoints) == len(trial.endpoint_s) - 1
    offset = (np.array([point.time_s for point in found.endpoints]) - trial.endpoint_s) / period_s
    assert np.abs(offset - np.median(offset)).max() < 0.01
    assert abs(np.median(offset)) < 0.08
    assert theta(found) == pytest.approx(trial.theta_bar_deg, abs=0.006)


@pytest.mark.parametrize("period_s", [1.0, 6.0])
def test_of_several_humps_one_ends_the_cycle(period_s):
    trial = simulate(two_humps, period_s=period_s, cycles=8, rate_hz=200.0)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_s == pytest.approx(period_s, rel=1e-3)
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s, abs=0.03 * period_s)
    assert theta(found) == pytest.approx(0.8, abs=0.005)


@pytest.mark.parametrize("cycles", [6, 12])
def test_of_two_equal_peaks_half_a_cycle_apart_one_ends_the_cycle(cycles):
    trial = simulate(equal_peaks, period_s=6.0, cycles=cycles, noise_deg=0.02)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_s == pytest.approx(6.0, rel=1e-2)
    assert found.peaks_per_cycle == 2
    assert theta(found) == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("period_s", [4.0, 15.0])
@pytest.mark.parametrize("wobble_deg", [0.0, 15.0])
def test_steps_of_a_stroke_are_no_cycles(period_s, wobble_deg):
    """A hand that sticks and slips: what repeats most often never comes back. Its many rests alone refuse nothing."""
    trial = simulate(staircase, period_s=period_s, wobble_deg=wobble_deg)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_s == pytest.approx(period_s, rel=1e-3)
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s, abs=0.03 * period_s)
    assert all("let go" in warning for warning in found.warnings)


@pytest.mark.parametrize("at_endpoints", [False, True])
def test_lone_outliers_of_a_tracker_do_not_reach_the_score(at_endpoints):
    trial = simulate(swing_deg=6.0, noise_deg=0.02)
    rng = np.random.default_rng(0)
    rows = np.searchsorted(trial.series.times_s, trial.endpoint_s) if at_endpoints else rng.integers(9, 4500, 15)
    quats = trial.series.quats_wxyz.copy()
    wrong = Rotation.from_rotvec(np.radians(12.0) * rng.normal(size=(len(rows), 3)))
    quats[rows] = (wrong * Rotation.from_quat(quats[rows], scalar_first=True)).as_quat(scalar_first=True)
    found = find_cycles(OrientationSeries(trial.series.times_s, quats, trial.series.index))
    assert found.valid, found.reasons
    assert theta(found) == pytest.approx(theta(find_cycles(trial.series)), abs=0.01)
    assert found.warnings == (f"{len(set(rows.tolist()))} samples stand apart from both their neighbours: set aside",)


def test_humps_are_found_though_drift_turns_the_axis_round():
    trial = simulate(two_humps, cycles=20, drift_deg=8.0, period_s=5.0)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.peaks_per_cycle > 1
    assert len(found.endpoints) == 20


def test_it_says_what_it_found():
    trial = simulate()
    found = find_cycles(trial.series)
    axis = np.array([0.2, 0.9, -0.4]) / np.linalg.norm([0.2, 0.9, -0.4])
    assert np.degrees(np.arccos(np.dot(found.axis, axis))) < 6.0  # drift of 0.8° a cycle turns it a little
    assert found.axis_share > 0.99
    assert found.swing_deg == pytest.approx(40.0, rel=0.01)
    assert found.likeness > 0.99
    assert found.irregularity < 0.01
    assert found.active_s == pytest.approx((3.0, 43.0), abs=0.6)
    assert found.window is None
    assert found.warnings == ()
    (run,) = found.runs
    assert run.scored
    assert run.endpoints == found.endpoints
    for point in found.endpoints:
        assert point.index == pytest.approx(point.time_s * 100.0, abs=0.51)
        assert point.dwell_s == pytest.approx(0.82, abs=0.02)  # 2·acos(0.8)/2π of a period within a tenth of R
        assert point.prominence_deg == pytest.approx(40.0, rel=0.03)
        assert point.flags == ()
        assert point.quat_wxyz[0] >= 0.0
        assert np.linalg.norm(point.quat_wxyz) == pytest.approx(1.0, abs=1e-12)


def test_long_rest_before_and_after_does_not_hide_a_short_trial():
    trial = simulate(cycles=6, lead_s=600.0, noise_deg=0.1, rate_hz=50.0)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert len(found.endpoints) == 6


def test_a_start_in_the_middle_of_the_range_counts_from_the_first_extreme():
    t = np.arange(3600) / 100.0
    angle = 20.0 * np.sin(2.0 * np.pi * np.clip(t - 2.0, 0.0, 32.0) / 4.0)
    found = find_cycles(from_rotation_vectors(np.radians(angle)[:, None] * [0.0, 0.6, 0.8]))
    assert found.valid, found.reasons
    assert [point.time_s for point in found.endpoints] == pytest.approx(3.0 + 4.0 * np.arange(8), abs=0.05)
    assert [point.time_s for point in found.other_endpoints] == pytest.approx(5.0 + 4.0 * np.arange(8), abs=0.05)


def test_putting_the_object_in_place_is_left_out_with_the_reason():
    ramp = np.clip((np.arange(900) / 100.0 - 1.0) / 0.8, 0.0, 1.0)
    t = np.arange(3400) / 100.0
    angle = np.concatenate((20.0 * ramp, 20.0 - 12.0 * (1.0 - np.cos(2.0 * np.pi * np.clip(t, 0.0, 32.0) / 4.0))))
    found = find_cycles(from_rotation_vectors(np.radians(angle)[:, None] * [0.0, 0.6, 0.8]))
    assert found.valid, found.reasons
    assert [point.time_s for point in found.endpoints] == pytest.approx(11.0 + 4.0 * np.arange(8), abs=0.05)
    assert any("held 7." in item.reason and not item.primary for item in found.left_out)


def test_a_pause_in_which_the_phase_goes_on_ends_no_run():
    trial = simulate(cycles=12, pause_after=7, pause_s=9.0)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s, abs=0.01)
    assert [k for k, point in enumerate(found.endpoints) if "after a pause" in point.flags] == [7]
    assert found.period_s == pytest.approx(4.0, abs=0.01)
    assert any("steps across a pause" in warning for warning in found.warnings)


def test_a_run_ends_where_part_of_a_cycle_is_unseen():
    """Two cycles without samples: a step across them would be one of three cycles."""
    trial = simulate(cycles=14)
    found = find_cycles(with_gaps(trial, (trial.endpoint_s[6], 9.0)))
    assert found.valid, found.reasons
    assert [run.scored for run in found.runs] == [False, True]
    assert not any("after a pause" in point.flags for run in found.runs for point in run.endpoints)


@pytest.mark.parametrize("window", [(12.0, 33.0), (13.0, 33.0), (13.1, 32.9)])
def test_a_window_takes_all_end_points_it_touches(window):
    trial = simulate(cycles=12)  # end points at 5, 9, 13 … 49 s, each with a dwell of 0.82 s
    found = find_cycles(trial.series, window=window)
    assert found.valid
    assert found.window == window
    assert [point.time_s for point in found.endpoints] == pytest.approx([13.0, 17.0, 21.0, 25.0, 29.0, 33.0], abs=0.01)


def test_a_window_outside_the_motion_has_nothing_to_score():
    found = find_cycles(simulate(cycles=6).series, window=(27.6, 29.5))
    assert not found.valid
    assert found.endpoints == ()


def test_interior_oddities_are_kept_and_flagged():
    scale, tempo = np.ones(10), np.ones(10)
    scale[4], tempo[6] = 0.5, 2.0
    trial = simulate(cycles=10, amplitude=scale, tempo=tempo)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert len(found.endpoints) == 10
    assert "odd swing" in found.endpoints[4].flags
    assert "odd spacing" in found.endpoints[6].flags
    assert any("tempo changes" in warning for warning in found.warnings)


def test_a_slip_within_a_cycle_adds_no_end_point():
    """It turns the angle back by half the swing, which is above the hysteresis."""
    axis = (0.2, 0.9, -0.4)
    trial = simulate(cycles=10, swing_deg=16.0, slip_deg=8.0, slip_cycle=4, drift_deg=0.0, axis=axis, drift_axis=axis)
    found = find_cycles(trial.series)
    assert len(found.endpoints) == 10
    assert "pose jump" in found.endpoints[5].flags


def test_tempo_that_hides_the_period_is_warned_of():
    tempo = 1.0 + 0.3 * np.random.default_rng(1).uniform(-1.7, 1.7, 20)
    found = find_cycles(simulate(cycles=20, tempo=tempo).series)
    assert found.valid, found.reasons
    assert len(found.endpoints) >= 18  # the gates may take a cycle off at either end
    assert any("tempo changes" in warning for warning in found.warnings)
    assert any("cycles differ much" in warning for warning in found.warnings)


def test_circular_motion_is_warned_of():
    t = np.arange(4000) / 100.0
    on = np.clip(t - 1.0, 0.0, 36.0)
    circle = np.stack((1.0 - np.cos(np.pi * on / 2.0), np.sin(np.pi * on / 2.0), np.zeros_like(on)), axis=1)
    found = find_cycles(from_rotation_vectors(np.radians(15.0) * circle))
    assert any("motion axis ambiguous" in warning for warning in found.warnings)


def test_fast_coarse_and_noisy_trials_are_warned_of():
    fast = find_cycles(simulate(period_s=0.5, cycles=20).series)
    assert any("below 0.6 s" in warning for warning in fast.warnings)
    coarse = find_cycles(simulate(period_s=1.0, rate_hz=15.0, cycles=20).series)
    assert any("sampled coarsely" in warning for warning in coarse.warnings)
    noisy = find_cycles(simulate(swing_deg=5.0, noise_deg=0.5).series)
    assert any("noise of 0.5° per sample" in warning for warning in noisy.warnings)


def with_gaps(trial, *gaps):
    """Leave out the samples of each (middle, length), s."""
    t = trial.series.times_s
    keep = np.all([np.abs(t - middle) > length / 2.0 for middle, length in gaps], axis=0)
    return OrientationSeries(t[keep], trial.series.quats_wxyz[keep], trial.series.index[keep])


@pytest.mark.parametrize("gap_s", [0.3, 1.0])
def test_an_end_point_inside_a_gap_is_refused(gap_s):
    trial = simulate(cycles=10)
    upper, lower = trial.endpoint_s[4] + 0.02, trial.endpoint_s[5] + 2.02
    found = find_cycles(with_gaps(trial, (upper, gap_s), (lower, gap_s)))
    assert found.valid
    refused = [item.time_s for item in found.left_out if "gap" in item.reason]
    assert refused == pytest.approx([upper, lower], abs=0.4)
    assert all(abs(point.time_s - at) > 1.0 for at in refused for point in found.endpoints + found.other_endpoints)
    assert any("gaps in the data" in warning for warning in found.warnings)
    assert len(found.runs) == 2  # a step across the gap would be one of two cycles


def test_a_gap_at_one_extreme_leaves_the_other_whole():
    trial = simulate(cycles=10)
    found = find_cycles(with_gaps(trial, (trial.endpoint_s[4], 0.5)))
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s[:-1] + 2.0, abs=0.01)


def test_a_gap_away_from_end_points_changes_nothing():
    trial = simulate(cycles=10)
    found = find_cycles(with_gaps(trial, (trial.endpoint_s[4] + 1.0, 0.6)))
    assert len(found.endpoints) == 10
    assert theta(found) == pytest.approx(0.8, abs=0.002)


def test_double_deliveries_of_a_moment_change_nothing():
    series = simulate(cycles=5).series
    t = np.repeat(series.times_s, 2)
    t[1::2] += 2e-5
    found = find_cycles(OrientationSeries(t, np.repeat(series.quats_wxyz, 2, axis=0), np.repeat(series.index, 2)))
    plain = find_cycles(series)
    assert [point.time_s for point in found.endpoints] == [point.time_s for point in plain.endpoints]
    assert [point.index for point in found.endpoints] == [point.index for point in plain.endpoints]


def test_the_cost_of_forty_thousand_rows_does_not_grow_with_their_square():
    series = simulate(cycles=32, period_s=5.0, rate_hz=240.0).series
    assert len(series) > 39_000
    find_cycles(series)  # scipy is loaded at the first call
    started = time.process_time()
    assert find_cycles(series).valid
    assert time.process_time() - started < SLOW_S


def test_scipy_is_not_loaded_by_the_import():
    code = "import sys, analysis.cycles.search, analysis.cycles.online.detector; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=HANG_S).returncode == 0
