"""The sensor model: what it adds to the true motion, and that it adds nothing when told so."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emulator.device.imu_model import ImuModel, ImuSettings
from firmware_protocol.packets import OrientationFlag

PERFECT = ImuSettings(
    noise_deg=0.0,
    correlated_noise_deg=0.0,
    heading_drift_deg_per_min=0.0,
    gyro_bias_dps=(0.0, 0.0, 0.0),
    gyro_noise_dps=0.0,
    acceleration_noise_g=0.0,
)
LEVEL = (1.0, 0.0, 0.0, 0.0)


def as_rotation(quats_wxyz):
    return Rotation.from_quat(np.asarray(quats_wxyz)[..., [1, 2, 3, 0]])


def turning(rate_rad_s, initial=LEVEL):
    """Steady turn about a world axis: times -> orientation, rate."""
    rate = np.asarray(rate_rad_s, dtype=float)

    def motion(times_s):
        turned = Rotation.from_rotvec(times_s[:, None] * rate) * as_rotation(initial)
        return turned.as_quat()[:, [3, 0, 1, 2]], np.tile(rate, (len(times_s), 1))

    return motion


AT_REST = turning((0.0, 0.0, 0.0))
TIMES_S = np.arange(20_000) * 0.01


def test_a_perfect_sensor_reads_the_truth():
    readings = ImuModel(PERFECT, LEVEL, seed=1).read(TIMES_S, turning((0.3, 0.1, -0.2)), 0, 0)
    np.testing.assert_allclose(readings.quats_wxyz, turning((0.3, 0.1, -0.2))(TIMES_S)[0], atol=1e-12)


def test_heading_drift_turns_about_the_world_vertical_at_its_rate():
    settings = replace(PERFECT, heading_drift_deg_per_min=6.0)
    tilted = turning((0.0, 0.0, 0.0), initial=(0.5, 0.5, 0.5, -0.5))
    readings = ImuModel(settings, LEVEL, seed=1).read(TIMES_S, tilted, 0, 0)
    turned = as_rotation(readings.quats_wxyz) * as_rotation(tilted(TIMES_S)[0]).inv()
    expected_deg = np.outer(TIMES_S / 60.0 * 6.0, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(turned.as_rotvec(degrees=True), expected_deg, atol=1e-9)


def test_white_noise_has_its_standard_deviation_and_no_memory():
    readings = ImuModel(replace(PERFECT, noise_deg=0.2), LEVEL, seed=1).read(TIMES_S, AT_REST, 0, 0)
    noise_deg = as_rotation(readings.quats_wxyz).as_rotvec(degrees=True)
    assert noise_deg.std(axis=0) == pytest.approx([0.2] * 3, rel=0.03)
    assert abs(np.corrcoef(noise_deg[1:, 0], noise_deg[:-1, 0])[0, 1]) < 0.03


def test_correlated_noise_has_the_autocorrelation_of_its_process():
    tau_s, sigma_deg = 0.5, 0.3
    settings = replace(PERFECT, correlated_noise_deg=sigma_deg, correlation_s=tau_s)
    lags = np.array([0, 10, 25, 50, 100])
    sums = np.zeros(len(lags))
    for seed in range(40):
        noise = np.degrees(ImuModel(settings, LEVEL, seed).correlated_noise_rad(TIMES_S))
        sums += [(noise[: len(noise) - lag] * noise[lag:]).mean() for lag in lags]
    np.testing.assert_allclose(sums / 40, sigma_deg**2 * np.exp(-lags * 0.01 / tau_s), atol=0.05 * sigma_deg**2)


def test_gyro_and_accelerometer_read_in_sensor_axes():
    mounting = (np.cos(0.4), np.sin(0.4), 0.0, 0.0)  # sensor turned about the body's x
    motion = turning((0.0, 0.0, 0.5), initial=(np.cos(0.3), 0.0, np.sin(0.3), 0.0))
    readings = ImuModel(PERFECT, mounting, seed=1).read(TIMES_S, motion, 0, 0)
    world_from_sensor = as_rotation(motion(TIMES_S)[0]) * as_rotation(mounting)
    np.testing.assert_allclose(readings.gyro_dps, world_from_sensor.inv().apply([0.0, 0.0, np.degrees(0.5)]), atol=1e-9)
    np.testing.assert_allclose(readings.acceleration_g, world_from_sensor.inv().apply([0.0, 0.0, 1.0]), atol=1e-9)


def test_bias_and_noise_of_the_gyro():
    settings = replace(PERFECT, gyro_bias_dps=(1.0, -2.0, 3.0), gyro_noise_dps=0.4)
    gyro = ImuModel(settings, LEVEL, seed=1).read(TIMES_S, AT_REST, 0, 0).gyro_dps
    assert gyro.mean(axis=0) == pytest.approx([1.0, -2.0, 3.0], abs=0.02)
    assert gyro.std(axis=0) == pytest.approx([0.4] * 3, rel=0.03)


@pytest.mark.parametrize(
    ("rate_dps", "flag"),
    [
        (0.1, OrientationFlag.STILL),
        (5.0, OrientationFlag(0)),
        (600.0, OrientationFlag.OVERRANGE),
        (2100.0, OrientationFlag.OVERRANGE | OrientationFlag.SATURATED),
    ],
)
def test_flags_follow_the_true_rate_of_turn(rate_dps, flag):
    readings = ImuModel(PERFECT, LEVEL, seed=1).read(TIMES_S, turning((np.radians(rate_dps), 0.0, 0.0)), 0, 0)
    assert set(readings.flags.tolist()) == {int(flag)}
    assert np.abs(readings.gyro_dps).max() <= 2000.0


def test_still_comes_only_after_a_while_at_rest():
    def stops_at_10s(times_s):
        rates = np.where(times_s[:, None] < 10.0, [[1.0, 0.0, 0.0]], 0.0)
        return AT_REST(times_s)[0], rates

    flags = ImuModel(PERFECT, LEVEL, seed=1).read(TIMES_S, stops_at_10s, 0, 0).flags
    assert TIMES_S[np.argmax(flags == OrientationFlag.STILL)] == pytest.approx(10.0 + PERFECT.still_after_s, abs=0.011)


def test_noise_belongs_to_the_sample_however_reading_is_divided():
    model = ImuModel(ImuSettings(), LEVEL, seed=9)
    whole = model.read(TIMES_S[:3000], AT_REST, 0, 0)
    pieces = [model.read(TIMES_S[a:b], AT_REST, a, 0) for a, b in [(0, 1), (1, 1023), (1023, 1025), (1025, 3000)]]
    for name in ("quats_wxyz", "gyro_dps", "acceleration_g"):
        np.testing.assert_allclose(np.concatenate([getattr(p, name) for p in pieces]), getattr(whole, name), atol=1e-13)
    assert not np.array_equal(model.read(TIMES_S[:10], AT_REST, 0, 1).gyro_dps, whole.gyro_dps[:10])  # another boot
