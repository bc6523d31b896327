"""Static baselines of simulated resting sensors with known heading drift, noise and random walk."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.sensor.baseline import _walk_error, baseline_from_holds, measure_baseline
from analysis.sensor.baseline_file import load_baseline, save_baseline
from analysis.sensor.still_holds import block_orientations, measure_creep, still_holds
from analysis.series import BaselineError, OrientationSeries
from tests.simulated_motion import cosine, simulate

BODY = Rotation.from_rotvec([0.4, -1.2, 2.0])


def resting(
    duration_s=120.0,
    rate=(0.0, 0.0, 1.0),
    noise_deg=0.05,
    walk=0.0,
    rate_hz=100.0,
    bump_deg=0.0,
    bump_s=0.2,
    seed=1,
):
    """A resting object: heading drift in deg/min, noise per sample (rms angle), random walk in deg/√s (rms)."""
    rng = np.random.default_rng(seed)
    times = np.arange(int(duration_s * rate_hz) + 1) / rate_hz
    drift = np.radians(np.outer(times / 60.0, rate))
    steps = rng.normal(scale=walk / np.sqrt(3.0 * rate_hz), size=(len(times), 3))
    wander = np.radians(np.cumsum(steps, axis=0))
    noise = np.radians(rng.normal(scale=noise_deg / np.sqrt(3.0), size=(len(times), 3)))
    bump = np.radians(bump_deg) * np.clip((times - 0.4 * duration_s) / bump_s, 0.0, 1.0)
    poses = (
        Rotation.from_rotvec(noise)
        * Rotation.from_rotvec(wander + drift)
        * Rotation.from_rotvec(np.outer(bump, [0.0, 1.0, 0.0]))
        * BODY
    )
    return OrientationSeries(times, poses.as_quat(scalar_first=True), np.arange(len(times)), source="rest.csv")


@pytest.mark.parametrize("rate", [(0.0, 0.0, 1.0), (0.0, 0.0, -5.5), (0.1, -0.2, 0.4), (0.0, 0.0, 0.0)])
def test_heading_drift_is_found_about_each_axis(rate):
    baseline = measure_baseline(resting(rate=rate))
    np.testing.assert_allclose(baseline.rate_deg_per_min, rate, atol=0.01)
    assert max(baseline.rate_error_deg_per_min) < 0.005
    assert baseline.total_rate_deg_per_min == pytest.approx(np.linalg.norm(rate), abs=0.01)
    assert baseline.per_cycle_deg(6.0) == pytest.approx(np.linalg.norm(rate) / 10.0, abs=0.002)


@pytest.mark.parametrize("noise_deg", [0.002, 0.05, 0.5])
def test_noise_per_sample_is_found(noise_deg):
    assert measure_baseline(resting(noise_deg=noise_deg)).noise_deg == pytest.approx(noise_deg, rel=0.03)


@pytest.mark.parametrize("walk", [0.02, 0.1])
def test_random_walk_is_found(walk):
    measured = [measure_baseline(resting(300.0, walk=walk, noise_deg=0.01, seed=seed)) for seed in range(6)]
    assert np.mean([baseline.walk_deg_per_sqrt_s for baseline in measured]) == pytest.approx(walk, rel=0.2)
    assert measured[0].allan[0].tau_s == 1.0
    # IEEE 952: the Allan deviation of a rate with white noise N falls as N/√τ.
    at_sixteen = np.mean([baseline.allan[4].deviation_deg_per_min for baseline in measured])
    assert at_sixteen == pytest.approx(walk * 60.0 / 4.0, rel=0.2)


def test_the_rate_error_is_that_of_repeated_rests():
    measured = [measure_baseline(resting(20.0, noise_deg=0.3, seed=seed)) for seed in range(60)]
    spread = np.std([baseline.rate_deg_per_min for baseline in measured], axis=0)
    claimed = np.mean([baseline.rate_error_deg_per_min for baseline in measured], axis=0)
    np.testing.assert_allclose(claimed, spread, rtol=0.35)


def test_a_random_walk_counts_in_the_rate_error():
    measured = [measure_baseline(resting(90.0, walk=0.05, rate_hz=20.0, seed=seed)) for seed in range(60)]
    spread = np.sqrt(np.mean(np.var([baseline.rate_deg_per_min for baseline in measured], axis=0)))
    claimed = np.sqrt(np.mean(np.square([baseline.rate_error_deg_per_min for baseline in measured])))
    assert claimed == pytest.approx(spread, rel=0.25)


def test_the_error_of_a_line_through_a_random_walk():
    walk, duration_s = 0.05, 90.0
    times = np.arange(0.0, duration_s, 0.5)
    steps = np.random.default_rng(3).normal(scale=walk * np.sqrt(0.5 / 3.0), size=(4000, len(times)))
    slopes = np.polyfit(times, np.cumsum(steps, axis=1).T, 1)[0] * 60.0
    assert _walk_error(walk, duration_s) == pytest.approx(np.std(slopes), rel=0.05)


def test_an_hour_of_strong_drift_does_not_fold_back():
    baseline = measure_baseline(resting(3600.0, rate=(0.0, 0.0, 12.0), rate_hz=10.0))  # 720 degrees
    np.testing.assert_allclose(baseline.rate_deg_per_min, [0, 0, 12.0], atol=0.01)


def test_short_rests_say_so_and_make_no_allan_figure():
    baseline = measure_baseline(resting(20.0))
    assert baseline.allan == ()
    assert baseline.walk_deg_per_sqrt_s == 0.0
    assert "60 s or more" in baseline.notes[0]
    assert measure_baseline(resting(120.0)).notes == ()


def test_temperature_is_kept():
    assert measure_baseline(resting(20.0), [float("nan"), 31.5, 30.25]).temperature_c == (30.25, 31.5)
    assert measure_baseline(resting(20.0), [float("nan")]).temperature_c is None


def test_too_short_is_refused():
    with pytest.raises(BaselineError, match=r"at least 10 s at rest .* got 5\.0 s"):
        measure_baseline(resting(5.0))


def test_a_clock_that_was_set_is_refused():
    series = resting(20.0)
    times = series.times_s + np.where(series.index >= 100, 1.7e9, 0.0)
    with pytest.raises(BaselineError, match=r"nothing is known of 1\.7e\+09 of"):
        measure_baseline(replace(series, times_s=times))


@pytest.mark.parametrize(("bump_deg", "bump_s"), [(0.3, 0.1), (1.0, 0.2), (20.0, 1.0), (3.0, 10.0)])
def test_a_touch_is_refused(bump_deg, bump_s):
    with pytest.raises(BaselineError, match="moved by"):
        measure_baseline(resting(bump_deg=bump_deg, bump_s=bump_s))


def test_turning_is_refused():
    with pytest.raises(BaselineError, match="turns at 90°/min"):
        measure_baseline(resting(rate=(0.0, 0.0, 90.0)))
    with pytest.raises(BaselineError):
        measure_baseline(simulate(cosine).series)


@pytest.mark.parametrize(("swing_deg", "period_s"), [(40.0, 4.0), (2.0, 4.0), (10.0, 15.0), (40.0, 0.8)])
def test_turning_to_and_fro_is_refused(swing_deg, period_s):
    times = np.arange(4600) / 100.0
    angle = 0.5 * np.radians(swing_deg) * np.cos(2.0 * np.pi * times / period_s)
    poses = Rotation.from_rotvec(np.outer(angle, [1.0, 0.0, 0.0])) * BODY
    with pytest.raises(BaselineError, match=r"move|turn"):
        measure_baseline(OrientationSeries(times, poses.as_quat(scalar_first=True), np.arange(len(times))))


def test_detectable_drift_equals_what_resting_objects_score():
    # The same model, played through the real score: a resting object cut every 4 s.
    from analysis.scoring.card import rotation_drift

    period, n = 4.0, 8
    baseline = measure_baseline(resting(600.0, walk=0.02, noise_deg=0.1))
    series = resting(3600.0, walk=0.02, noise_deg=0.1, rate_hz=2.0, seed=9)
    every = round(period * 2)
    starts = range(0, len(series) - n * every, every)
    thetas = [rotation_drift(series.quats_wxyz[s : s + n * every : every]).theta_bar_deg for s in starts]
    assert baseline.detectable_deg(period, n) == pytest.approx(np.percentile(thetas, 95), rel=0.1)


def test_file_round_trip(tmp_path):
    baseline = measure_baseline(resting(120.0), [30.0, 31.0])
    baseline = replace(baseline, source='a "quoted" \\ path\x1b[31m', notes=("ünïcode",))
    save_baseline(baseline, tmp_path / "b.toml")
    loaded = load_baseline(tmp_path / "b.toml")
    assert replace(loaded, source="") == replace(baseline, source="")
    assert loaded.source == 'a "quoted" \\ path?[31m'
    with pytest.raises(FileExistsError):
        save_baseline(baseline, tmp_path / "b.toml")


def whole(**changed):
    """Return a baseline file with some values replaced."""
    triples = dict.fromkeys(("rate_deg_per_min", "rate_error_deg_per_min"), "[0.1, 0.2, 0.3]")
    amounts = dict.fromkeys(("noise_deg", "walk_deg_per_sqrt_s", "duration_s"), "1.5") | {"n_samples": "100"}
    lists = {"allan_tau_s": "[]", "allan_deg_per_min": "[]"}
    return "".join(f"{key} = {value}\n" for key, value in ({"format": 1} | triples | amounts | lists | changed).items())


def test_a_baseline_file_of_before_is_read(tmp_path):
    (tmp_path / "b.toml").write_text(whole())  # without source, notes and temperature
    assert load_baseline(tmp_path / "b.toml").n_samples == 100


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a baseline file of format 1"),
        ("format = 2", "not a baseline file of format 1"),
        ("format = [", "not a baseline file"),
        ("format = 1", "allan_tau_s"),
        ("format = 1\nallan_tau_s = []\nallan_deg_per_min = []\nrate_deg_per_min = [1, 2]", "rate_deg_per_min"),
        ("format = 1\nallan_tau_s = []\nallan_deg_per_min = []\nrate_deg_per_min = [1, 2, 'x']", "rate_deg_per_min"),
        (
            "format = 1\nallan_tau_s = []\nallan_deg_per_min = []\nrate_deg_per_min = [1, 2, 3]\n"
            "rate_error_deg_per_min = [1, 2, 3]\nnoise_deg = 'x'",
            "noise_deg",
        ),
        (whole(rate_deg_per_min="[1, 2, inf]"), "a number that is negative or not finite"),
        (whole(noise_deg="-0.1"), "a number that is negative or not finite"),
        (whole(walk_deg_per_sqrt_s="true"), "walk_deg_per_sqrt_s"),
        (whole(allan_tau_s="[1.0]"), "shorter"),
    ],
)
def test_files_that_are_no_baseline(tmp_path, text, message):
    path = tmp_path / "b.toml"
    path.write_text(text)
    with pytest.raises(BaselineError, match=message):
        load_baseline(path)


def test_binary_is_no_baseline(tmp_path):
    path = tmp_path / "b.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BaselineError, match="not a baseline file"):
        load_baseline(path)


def test_rests_before_and_after_the_motion_are_found():
    trial = simulate(cosine, lead_s=8.0, noise_deg=0.02, period_s=3.0, cycles=5)
    holds = still_holds(trial.series, (8.0, 23.0))
    assert [(round(hold.from_s), round(hold.to_s)) for hold in holds] == [(0, 8), (23, 31)]
    everywhere = still_holds(trial.series)
    assert len(everywhere) == 2
    assert everywhere[0].to_s < 9.0
    assert everywhere[1].from_s > 22.0


def test_short_rests_are_none():
    assert still_holds(simulate(cosine, lead_s=2.0).series) == ()
    assert baseline_from_holds(()) is None


def test_rests_make_a_baseline():
    before, after = resting(8.0, rate=(0, 0, 3.0), seed=2), resting(16.0, rate=(0, 0, 3.0), seed=3)
    holds = (*still_holds(before), *still_holds(after))
    baseline = baseline_from_holds(holds)
    np.testing.assert_allclose(baseline.rate_deg_per_min, [0, 0, 3.0], atol=0.3)
    assert baseline.noise_deg == pytest.approx(0.05, rel=0.05)
    assert baseline.duration_s == pytest.approx(24.0, abs=0.1)
    assert "8.0 s, 16.0 s" in baseline.source


def test_the_longer_rest_counts_by_the_cube_of_its_length():
    holds = (
        *still_holds(resting(8.0, rate=(0, 0, 1.0), noise_deg=0.0)),
        *still_holds(resting(16.0, rate=(0, 0, 2.0), noise_deg=0.0)),
    )
    assert baseline_from_holds(holds).rate_deg_per_min[2] == pytest.approx((1.0 + 8.0 * 2.0) / 9.0, rel=1e-3)


def test_a_noisy_sensor_rests_too():
    holds = still_holds(resting(10.0, noise_deg=1.0))
    assert len(holds) == 1
    assert holds[0].duration_s == pytest.approx(10.0)


def test_creep_on_an_uneven_grid():
    series = resting(30.0, rate=(0, 0, 4.0), noise_deg=0.01)
    keep = np.sort(np.random.default_rng(6).choice(len(series), 700, replace=False))
    creep = measure_creep(series.times_s[keep], series.quats_wxyz[keep])
    np.testing.assert_allclose(creep.rate_deg_per_min, [0, 0, 4.0], atol=0.02)
    blocks = block_orientations(series.times_s[keep], series.quats_wxyz[keep])
    assert 55 <= len(blocks.starts) <= 60
