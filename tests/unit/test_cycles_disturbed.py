"""What happens around and within real trials: the object dropped, put in place, short strokes of uneven tempo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.cycles.motion import Motion
from analysis.cycles.search import find_cycles
from analysis.series import OrientationSeries
from tests.simulated_motion import Trial, cosine, simulate, theta_bar_deg, trapezoid, triangle, two_humps


def with_stroke(series: OrientationSeries, at_s: float, angle_deg: float, length_s: float = 0.4) -> OrientationSeries:
    """Everything from ``at_s`` on is turned by an angle about an odd axis, within ``length_s``."""
    ramp = np.clip((series.times_s - at_s) / length_s, 0.0, 1.0)
    turned = Rotation.from_rotvec(np.radians(angle_deg) * (ramp * ramp * (3.0 - 2.0 * ramp))[:, None] * [0.6, 0.0, 0.8])
    poses = turned * Rotation.from_quat(series.quats_wxyz, scalar_first=True)
    return OrientationSeries(series.times_s, poses.as_quat(scalar_first=True), series.index)


def assert_finds(trial: Trial, series: OrientationSeries) -> None:
    found = find_cycles(series)
    assert found.valid, found.reasons
    period_s = float(np.median(np.diff(trial.endpoint_s)))
    assert found.period_s == pytest.approx(period_s, rel=0.02)
    extremes = [np.array([point.time_s for point in points]) for points in (found.endpoints, found.other_endpoints)]
    inner = trial.endpoint_s[1:-1]
    away = min(np.abs(inner[:, None] - times_s).min(axis=1).max() for times_s in extremes if len(times_s))
    assert away < 0.06 * period_s


@pytest.mark.parametrize("shape_swing", [("cosine", 4.0), ("two humps", 6.0)])
@pytest.mark.parametrize("period_s", [2.0, 14.0])
@pytest.mark.parametrize("drop_deg", [60.0, 170.0])
def test_an_object_dropped_at_the_end_does_not_hide_a_small_slow_trial(shape_swing, period_s, drop_deg):
    """The drop turns faster and further than all cycles together."""
    name, swing_deg = shape_swing
    shape = {"shape": two_humps} if name == "two humps" else {}
    trial = simulate(cycles=8, period_s=period_s, swing_deg=swing_deg, drift_deg=0.1, noise_deg=0.01, **shape)
    end_s = float(trial.series.times_s[-1])
    assert_finds(trial, with_stroke(trial.series, end_s - 1.0, drop_deg))
    assert_finds(trial, with_stroke(with_stroke(trial.series, end_s - 1.0, drop_deg), 0.3, -drop_deg, 1.0))


def test_the_score_is_that_of_the_cycles_before_the_drop():
    trial = simulate(cycles=8, period_s=9.0, swing_deg=5.0, drift_deg=0.3)
    found = find_cycles(with_stroke(trial.series, float(trial.series.times_s[-1]) - 1.0, 90.0))
    assert len(found.endpoints) == 8
    quats = np.array([point.quat_wxyz for point in found.endpoints])
    assert theta_bar_deg(quats) == pytest.approx(0.3, abs=0.002)


def stepped(phase):
    """Two short strokes a cycle with long rests between."""
    part = phase % 1.0
    return np.clip((part - 0.2) / 0.06, 0.0, 1.0) - np.clip((part - 0.7) / 0.06, 0.0, 1.0)


@pytest.mark.parametrize("seed", range(6))
def test_short_strokes_of_uneven_tempo_keep_their_own_period(seed):
    """Strokes of 6 % of a cycle overlap little where tempo varies by 5 %: three cycles on may overlap by luck."""
    tempo = 1.0 + 0.05 * np.random.default_rng(seed).standard_normal(6).clip(-2.0, 2.0)
    trial = simulate(stepped, cycles=6, period_s=4.5, tempo=tempo, swing_deg=18.0)
    found = find_cycles(trial.series)
    assert found.period_s == pytest.approx(4.5, rel=0.06)
    assert len(found.endpoints) >= 5


def test_limited_speed_keeps_directions_and_slow_motion():
    rng = np.random.default_rng(3)
    omega = rng.normal(size=(500, 3))
    omega[100:110] *= 50.0
    motion = Motion(0.0, 100.0, omega, np.linalg.norm(omega, axis=1), 1e-3)
    limited = motion.limited(3.0).omega
    speed, before = np.linalg.norm(limited, axis=1), np.linalg.norm(omega, axis=1)
    limit = 3.0 * np.median(before)
    assert speed.max() == pytest.approx(limit)
    assert np.array_equal(limited[before <= limit], omega[before <= limit])
    assert np.allclose(limited / speed[:, None], omega / before[:, None])
    assert motion.limited(1e9) is motion
    still = Motion(0.0, 100.0, np.zeros((50, 3)), np.zeros(50), 1e-3)
    assert still.limited(3.0) is still


@pytest.mark.parametrize("shape", [cosine, trapezoid, triangle])
@pytest.mark.parametrize("tempo", [(0.5, 1.5), (1.5, 0.5)])
@pytest.mark.parametrize("cycles", [6, 14])
def test_a_tempo_that_changes_threefold_is_warned_of_and_every_cycle_found(shape, tempo, cycles):
    """The autocorrelation has no peak of 0.3, but every swing is of one size and shape."""
    trial = simulate(shape, cycles=cycles, tempo=np.linspace(*tempo, cycles), noise_deg=0.02)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_confidence < 0.3
    assert [point.time_s for point in found.endpoints] == pytest.approx(trial.endpoint_s, abs=0.03)
    assert theta_bar_deg(np.array([point.quat_wxyz for point in found.endpoints])) == pytest.approx(0.8, abs=0.05)
    assert any("tempo changes" in warning for warning in found.warnings)
    assert any("cycles differ much" in warning for warning in found.warnings)
