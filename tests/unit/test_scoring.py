"""A whole trial: simulated motion of known drift through search, score, trust and JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from analysis.geometry import rotations
from analysis.scoring.card import rotation_drift
from analysis.scoring.choice import EndpointChoice
from analysis.scoring.trial import score_series
from analysis.sensor.baseline import StaticBaseline
from analysis.series import OrientationSeries, SeriesError, SetAside
from tests.simulated_motion import cosine, random_smooth, simulate, trapezoid

COMPANIONS = (
    "n_steps mean_step_deg median_step_deg dispersion_deg axis_share net_rotation_deg max_excursion_deg "
    "without_first_deg without_last_deg leave_one_out_deg slope_deg_per_cycle top_eigenvalue_share interval "
    "over_phase_deg step_axes"
)


@pytest.fixture(scope="module")
def trial():
    return simulate(trapezoid, noise_deg=0.02, lead_s=6.0)


@pytest.fixture(scope="module")
def score(trial):
    return score_series(trial.series)


def true_rows(trial):
    return [round(t * 100) for t in trial.endpoint_s]


def test_automatic_score_finds_the_true_drift(trial, score):
    assert score.valid
    assert score.reasons == ()
    assert score.theta_bar_deg == pytest.approx(trial.theta_bar_deg, abs=0.01)
    assert score.period_s == pytest.approx(4.0, rel=0.002)
    assert len(score.endpoints) == 10
    np.testing.assert_allclose(np.abs(np.array(score.axis) @ np.array([0.5, 0.5, 0.7])) / np.sqrt(0.99), 1.0, atol=0.01)
    low, high = score.interval_deg
    assert low <= trial.theta_bar_deg <= high
    assert score.window.kind == "automatic"
    assert score.window.automatic is None
    assert score.other_extreme.theta_bar_deg == pytest.approx(0.8, abs=0.05)
    assert score.companions.translation_drift_mm is None


def test_rests_around_the_motion_are_the_sensor_s_share(score):
    assert score.sensor.source == "rests"
    assert score.sensor.per_cycle_deg < 0.05
    assert score.sensor.below_floor is False


def test_json_has_every_field_and_only_finite_numbers(score):
    result = json.loads(json.dumps(score.to_json(), allow_nan=False))
    wanted = (
        "theta_bar_deg axis n_endpoints endpoints steps_deg period_s valid reasons warnings losses other_extreme "
        "companions interval_deg window flags sensor cycles recording settings format"
    )
    assert set(wanted.split()) == set(result)
    assert result["theta_bar_deg"] == score.theta_bar_deg
    assert len(result["endpoints"]) == result["n_endpoints"] == len(result["flags"]) == 10
    assert set(result["endpoints"][0]) >= {"row", "time_s", "quat_wxyz"}
    assert len(result["steps_deg"]) == 9
    assert result["losses"] is None
    assert set(result["other_extreme"]) >= {"theta_bar_deg", "endpoints"}
    companions = result["companions"]
    for name in COMPANIONS.split():
        assert companions[name] is not None, name
    assert companions["n_steps"] == 9
    assert result["window"]["kind"] == "automatic"
    assert result["recording"]["convention"]


def test_an_invalid_trial_claims_nothing_in_json():
    result = score_series(random_smooth(1)).to_json()
    assert result["valid"] is False
    assert result["reasons"]
    assert result["theta_bar_deg"] is None
    assert result["axis"] is None
    assert result["interval_deg"] is None
    assert result["companions"] is None
    assert result["steps_deg"] == []
    json.dumps(result, allow_nan=False)


def test_chosen_rows_are_scored_exactly(trial):
    rows = true_rows(trial)
    score = score_series(trial.series, endpoints=rows)
    assert score.theta_bar_deg == rotation_drift(trial.series.quats_wxyz[rows]).theta_bar_deg
    assert [point.index for point in score.endpoints] == rows
    assert score.window.kind == "endpoints"
    assert score.window.automatic.valid
    assert score.window.automatic.theta_bar_deg == score_series(trial.series).theta_bar_deg
    assert score.to_json()["window"]["automatic"]["n_endpoints"] == 10


def test_chosen_times_and_reasons(trial):
    choice = EndpointChoice("time_s", tuple(trial.endpoint_s[:5] + 0.003), ("", "late", "", "", ""), "ends.csv")
    score = score_series(trial.series, endpoints=choice)
    assert score.endpoints[1].reason == "late"
    assert score.to_json()["endpoints"][1]["reason"] == "late"
    assert score.window.source == "ends.csv"
    assert [point.index for point in score.endpoints] == true_rows(trial)[:5]


def test_bare_numbers_name_rows_or_sequence_numbers(trial):
    choice = EndpointChoice("index", tuple(float(row) for row in true_rows(trial)))
    for kind in ("row", "sequence"):
        series = replace(trial.series, index_kind=kind)
        for chosen in (choice, true_rows(trial)):
            found = score_series(series, endpoints=chosen).endpoints
            assert [getattr(point, kind) for point in found] == true_rows(trial)


def test_chosen_rows_may_be_set_aside_ones(trial):
    rows = true_rows(trial)
    full = trial.series
    gone = rows[3]
    keep = np.arange(len(full)) != gone
    aside = SetAside(full.times_s[~keep], full.quats_wxyz[~keep], full.index[~keep])
    cut = OrientationSeries(full.times_s[keep], full.quats_wxyz[keep], full.index[keep], set_aside=aside)
    assert score_series(cut, endpoints=rows).theta_bar_deg == score_series(full, endpoints=rows).theta_bar_deg


def test_chosen_times_inside_a_gap_are_refused(trial):
    times = tuple(trial.endpoint_s[:5])
    gone = np.abs(trial.series.times_s - times[2]) < 0.2
    cut = OrientationSeries(trial.series.times_s[~gone], trial.series.quats_wxyz[~gone], trial.series.index[~gone])
    with pytest.raises(SeriesError, match=r"end point 3 at .* lies in a gap of 0\.4"):
        score_series(cut, endpoints=EndpointChoice("time_s", times))


def test_every_run_is_reported():
    """A cycle and a half without samples: no step lies across them."""
    full = simulate(trapezoid, cycles=14, lead_s=6.0)
    seen = np.abs(full.series.times_s - full.endpoint_s[5]) > 3.0
    series = OrientationSeries(full.series.times_s[seen], full.series.quats_wxyz[seen], full.series.index[seen])
    score = score_series(series)
    runs = score.to_json()["cycles"]["runs"]
    assert [run["scored"] for run in runs] == [False, True]
    assert [run["theta_bar_deg"] for run in runs] == pytest.approx([0.8, 0.8], abs=0.02)
    assert runs[1]["theta_bar_deg"] == pytest.approx(score.theta_bar_deg, abs=1e-12)


def test_a_pause_between_cycles_is_no_part_of_the_period():
    score = score_series(simulate(trapezoid, cycles=8, pause_after=3, pause_s=9.0).series)
    assert score.n_endpoints == 8
    assert score.period_s == pytest.approx(4.0, abs=0.01)
    assert score.theta_bar_deg == pytest.approx(0.8, abs=0.02)
    assert [k for k, point in enumerate(score.endpoints) if "after a pause" in point.flags] == [3]


def test_chosen_end_points_outside_the_recording(trial):
    with pytest.raises(SeriesError, match="no row 999999"):
        score_series(trial.series, endpoints=[1, 2, 3, 999999])
    with pytest.raises(SeriesError, match="outside the recording"):
        score_series(trial.series, endpoints=EndpointChoice("time_s", (1.0, 2.0, 3.0, 1e6)))
    with pytest.raises(SeriesError, match="names its samples by row"):
        score_series(trial.series, endpoints=EndpointChoice("sequence", (1.0, 2.0, 3.0, 4.0)))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_fewer_than_three_cycles_are_refused(trial, n):
    score = score_series(trial.series, endpoints=true_rows(trial)[:n])
    assert not score.valid
    assert score.theta_bar_deg is None
    assert "fewer than 3 cycles" in score.reasons[0]
    assert len(score.endpoints) == n


def test_three_cycles_are_scored_without_an_interval(trial):
    score = score_series(trial.series, endpoints=true_rows(trial)[:4])
    assert score.valid
    assert score.interval_deg is None
    assert any("too few for a confidence interval" in warning for warning in score.warnings)
    json.dumps(score.to_json(), allow_nan=False)


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_short_trials_are_refused_automatically(cycles):
    score = score_series(simulate(cosine, cycles=cycles).series)
    assert not score.valid
    assert score.reasons


def test_window_in_seconds_since_the_start_or_in_the_recording_s_time(trial):
    shifted = replace(trial.series, times_s=trial.series.times_s + 1.5e9)
    begin, end = trial.endpoint_s[2] - 1.0, trial.endpoint_s[7] + 1.0
    relative = score_series(shifted, window=(begin, end))
    own = score_series(shifted, window=(1.5e9 + begin, 1.5e9 + end))
    with pytest.raises(SeriesError, match=r"from 1000\.000 s to .* holds nothing"):
        score_series(shifted, window=(1000.0, None))
    plain = score_series(trial.series, window=(begin, end))
    assert len(relative.endpoints) == len(own.endpoints) == len(plain.endpoints) == 6
    assert relative.theta_bar_deg == pytest.approx(plain.theta_bar_deg, abs=1e-4)
    assert relative.window.kind == "from-to"
    assert relative.window.from_s == 1.5e9 + begin
    assert len(relative.window.automatic.indices) == 10
    assert plain.theta_bar_deg == pytest.approx(0.8, abs=0.02)


def test_seconds_are_since_the_first_sample_also_where_its_own_time_is_small(trial):
    begin, end = trial.endpoint_s[3] - 1.0, trial.endpoint_s[6] + 1.0
    plain = score_series(trial.series, window=(begin, end))
    since_boot = replace(trial.series, times_s=trial.series.times_s + 7.0)  # a device that ran for 7 s before
    score = score_series(since_boot, window=(begin, end))
    assert [point.index for point in score.endpoints] == [point.index for point in plain.endpoints]
    assert score.window.from_s == begin + 7.0


def test_end_points_by_time_as_the_result_names_them(trial):
    shifted = replace(trial.series, times_s=trial.series.times_s + 1.5e9)
    found = score_series(shifted)
    times = tuple(point.time_s for point in found.endpoints)
    again = score_series(shifted, endpoints=EndpointChoice("time_s", times))
    assert [point.index for point in again.endpoints] == [point.index for point in found.endpoints]
    assert again.theta_bar_deg == pytest.approx(found.theta_bar_deg, abs=0.01)
    since = EndpointChoice("time_s", tuple(time - 1.5e9 for time in times))
    assert score_series(shifted, endpoints=since).theta_bar_deg == pytest.approx(again.theta_bar_deg, abs=1e-6)


def test_half_open_windows(trial):
    late = score_series(trial.series, window=(trial.endpoint_s[3] - 1.0, None))
    assert late.endpoints[0].time_s == pytest.approx(trial.endpoint_s[3], abs=0.1)
    early = score_series(trial.series, window=(None, trial.endpoint_s[6] + 1.0))
    assert early.endpoints[-1].time_s == pytest.approx(trial.endpoint_s[6], abs=0.1)


@pytest.mark.parametrize("window", [(5.0, 4.0), (1e4, 2e4), (3.0, 3.0)])
def test_windows_that_hold_nothing(trial, window):
    with pytest.raises(SeriesError, match="holds nothing"):
        score_series(trial.series, window=window)


def test_translation_drift_of_the_end_points(trial):
    creep = np.outer(trial.series.times_s, [0.003, 0.0, 0.004]) / 4.0  # 5 mm per cycle
    score = score_series(replace(trial.series, positions_m=creep))
    assert score.companions.translation_drift_mm == pytest.approx(5.0, rel=0.01)


def baseline(rate, noise=0.01):
    return StaticBaseline((0.0, 0.0, rate), (0.0, 0.0, 0.0), noise, 0.0, 60.0, 6000)


def test_a_baseline_gives_the_share_and_the_floor(trial):
    score = score_series(trial.series, baseline=baseline(3.0))
    assert score.sensor.source == "baseline"
    assert score.sensor.per_cycle_deg == pytest.approx(0.2, rel=0.01)
    assert score.sensor.below_floor is False
    low = score_series(trial.series, baseline=baseline(30.0))
    assert low.sensor.below_floor is True
    assert any("below the sensor's floor" in warning for warning in low.warnings)
    assert low.to_json()["sensor"]["below_floor"] is True
    assert low.theta_bar_deg == score.theta_bar_deg  # the baseline never changes the score


def test_without_baseline_or_rests_an_imu_s_usual_share_is_named():
    series = replace(simulate(cosine, lead_s=1.0).series, index_kind="sequence")
    score = score_series(series)
    assert score.sensor.source == "unknown"
    assert any("6-axis IMU would add" in warning for warning in score.warnings)
    assert "sequence" in score.to_json()["endpoints"][0]


@pytest.mark.parametrize(("lead_s", "floor"), [(3.5, False), (7.0, True)])
def test_rests_inside_the_trial_set_a_floor_only_from_ten_seconds_on(lead_s, floor):
    series = simulate(cosine, lead_s=lead_s, drift_deg=0.0).series
    heading = rotations.exp(np.outer(series.times_s, [0.0, 0.0, np.radians(2.0) / 60.0]))
    score = score_series(replace(series, quats_wxyz=rotations.multiply(heading, series.quats_wxyz)))
    assert score.sensor.source == "rests"
    assert score.sensor.per_cycle_deg == pytest.approx(score.period_s * 2.0 / 60.0, rel=0.3)
    assert (score.sensor.detectable_deg is not None) == floor
    assert (score.sensor.below_floor is not None) == floor
    assert "upper bound" in score.sensor.note


def test_grasp_and_release_by_name_is_not_claimed(trial):
    named = replace(trial.series, source="somewhere/HAND_cube_power_GR_1.csv")
    score = score_series(named)
    assert not score.valid
    assert any("grasp-and-release" in warning for warning in score.warnings)
    assert any("grasp-and-release" in reason for reason in score.reasons)
    by_hand = score_series(named, endpoints=true_rows(trial))
    assert by_hand.valid
    assert any("grasp-and-release" in warning for warning in by_hand.warnings)
    assert not by_hand.window.automatic.valid
    assert score_series(replace(trial.series, source="GRASP_cube_1.csv")).valid


def test_scatter_and_fragile_ends_are_warned_of():
    rng = np.random.default_rng(3)
    series = simulate(trapezoid, cycles=8, drift_deg=0.0).series
    rows = [round(100 * t) for t in simulate(trapezoid, cycles=8).endpoint_s]
    quats = series.quats_wxyz.copy()
    for row in rows[1:]:  # scatter inside, and a last end point far off
        push = np.array([4.0 if row == rows[-1] else 0.0, 0.0, 0.0])
        wobble = rotations.exp(np.radians(rng.normal(scale=2.0, size=3) + push))
        quats[row] = rotations.multiply(wobble, quats[row])
    score = score_series(replace(series, quats_wxyz=quats), endpoints=rows)
    assert any("hides scatter" in warning for warning in score.warnings)
    assert any("without the last end point" in warning for warning in score.warnings)


def test_slip_inside_counts_in_full():
    steady = score_series(simulate(trapezoid, noise_deg=0.01).series)
    slipped = score_series(simulate(trapezoid, noise_deg=0.01, slip_deg=8.0, slip_cycle=4).series)
    assert slipped.theta_bar_deg - steady.theta_bar_deg == pytest.approx(8.0 / 9, rel=0.1)


def test_notes_and_warnings_of_the_series_reach_the_result(trial):
    result = score_series(replace(trial.series, warnings=("odd axis",), notes=("240 Hz assumed",))).to_json()
    assert "odd axis" in result["warnings"]
    assert result["recording"]["notes"] == ["240 Hz assumed"]


def test_empty_and_tiny_series_are_refused():
    for n in (0, 1, 5):
        series = OrientationSeries(np.arange(n) / 100, np.tile([1.0, 0, 0, 0], (n, 1)), np.arange(n))
        score = score_series(series)
        assert not score.valid
        json.dumps(score.to_json(), allow_nan=False)


def test_a_wrong_unit_of_time_is_a_reason_and_fills_no_memory():
    series = simulate(cycles=9).series
    score = score_series(replace(series, times_s=series.times_s * 1e6))  # microseconds read as seconds
    assert score.reasons == ("samples are 1e+04 s apart, too far for any cycle: is the unit of time right?",)
    chosen = score_series(replace(series, times_s=series.times_s * 1e6), endpoints=[100, 500, 900, 1300])
    assert chosen.valid


def test_a_clock_that_was_set_is_a_reason_and_fills_no_memory():
    series = simulate(cycles=9).series
    times = series.times_s + np.where(series.index >= 5, 1.7e9, 0.0)
    (reason,) = score_series(replace(series, times_s=times)).reasons
    assert reason.startswith("a gap of 1.7e+09 s, 0.040 s after the first sample: was the clock set there?")
