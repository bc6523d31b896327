"""The truth: θ̄ by the card, checked with scipy, and the samples that belong to the end points."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emulator.runner import run
from emulator.scenario import load_scenario, scenario_names
from emulator.truth import mean_drift, step_angles_deg, write_truth
from emulator.virtual_object import VirtualObject
from firmware_protocol.packets import Start
from firmware_protocol.serial.decoder import OrientationBatch, StreamDecoder
from tests.memory_link import MemoryLink


def as_rotation(quats_wxyz):
    return Rotation.from_quat(np.asarray(quats_wxyz)[..., [1, 2, 3, 0]])


@pytest.mark.parametrize("name", scenario_names())
def test_theta_bar_is_the_mean_that_scipy_finds(name):
    truth = VirtualObject(load_scenario(name)).truth()
    if not truth["endpoints"]:
        assert truth["theta_bar_deg"] is None
        return
    for part in (truth, truth["other_extreme"]):
        rotations = as_rotation([endpoint["quat_wxyz"] for endpoint in part["endpoints"]])
        mean = (rotations[1:] * rotations[:-1].inv()).mean()  # the same eigenvector, by another hand
        assert part["theta_bar_deg"] == pytest.approx(np.degrees(mean.magnitude()), abs=1e-7)
        if part["axis"] is not None:
            np.testing.assert_allclose(part["axis"], mean.as_rotvec() / mean.magnitude(), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "theta_bar_deg"),
    [("default", 0.8), ("ideal", 0.8), ("trapezoid", 0.6), ("no-drift", 0.0), ("alternating", 0.0), ("fast", 0.25)],
)
def test_theta_bar_in_closed_form(name, theta_bar_deg):
    assert VirtualObject(load_scenario(name)).truth()["theta_bar_deg"] == pytest.approx(theta_bar_deg, abs=1e-9)


def test_a_slip_counts_once_in_the_mean():
    truth = VirtualObject(load_scenario("slip")).truth()
    assert truth["theta_bar_deg"] == pytest.approx((12 * 0.4 + 8.0) / 13, rel=2e-3)  # to first order
    assert truth["steps_deg"][5] == pytest.approx(8.0)
    assert truth["steps_deg"][4] == pytest.approx(0.4)


def test_mean_drift_of_little():
    assert mean_drift(np.empty((0, 4))) == (None, None)
    assert mean_drift(np.array([[1.0, 0.0, 0.0, 0.0]])) == (None, None)
    assert mean_drift(np.tile([0.5, 0.5, 0.5, 0.5], (3, 1))) == (0.0, None)
    half_turn = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    assert mean_drift(half_turn)[0] == pytest.approx(180.0)
    assert step_angles_deg(-half_turn) == pytest.approx([180.0])


def run_in_memory(scenario, seed=None):
    link = MemoryLink()
    link.put(Start(1))
    result = run(scenario, link, seed=seed)
    batches = [item for item in StreamDecoder().feed(link.take()) if isinstance(item, OrientationBatch)]
    return result, batches


@pytest.mark.parametrize("name", ["ideal", "start-midway", "two-hump", "trapezoid", "clock-wrap"])
def test_the_samples_named_by_the_truth_show_the_end_points(name):
    scenario = load_scenario(name)
    perfect = load_scenario("ideal")
    truth, batches = run_in_memory(
        replace(scenario, imu=perfect.imu, clock=replace(perfect.clock, start_us=scenario.clock.start_us))
    )
    sequence = np.concatenate([batch.sequence for batch in batches])
    quats = np.concatenate([batch.quats_wxyz for batch in batches])
    device_time_us = np.concatenate([batch.device_time_us for batch in batches])
    for part in (truth, truth["other_extreme"]):
        for endpoint in part["endpoints"]:
            row = int(np.flatnonzero(sequence == endpoint["sequence"])[0])
            assert abs(endpoint["sample_dt_s"]) <= 0.5 / scenario.device.rate_hz + 1e-6
            behind_us = (int(device_time_us[row]) - endpoint["device_time_us"] + 2**31) % 2**32 - 2**31
            assert behind_us == pytest.approx(endpoint["sample_dt_s"] * 1e6, abs=2.0)
            error = as_rotation(quats[row]) * as_rotation(endpoint["quat_wxyz"]).inv()
            # Quantisation, and the turn within half a sample of an extreme, which is at rest there.
            assert np.degrees(error.magnitude()) < 0.01


def test_times_of_end_points_count_from_power_up(tmp_path):
    truth, _ = run_in_memory(load_scenario("ideal"))
    assert truth["hand_start_s"] == 0.0
    assert [endpoint["time_s"] for endpoint in truth["endpoints"]] == pytest.approx(np.arange(4.0, 50.0, 4.0))
    assert truth["complete"] is True


def test_before_the_hand_starts_the_truth_knows_no_times():
    truth = VirtualObject(load_scenario("default")).truth()
    assert truth["hand_start_s"] is None
    assert truth["endpoints"][0]["time_s"] is None
    assert truth["endpoints"][0]["motion_time_s"] == 4.0
    assert truth["endpoints"][0]["sequence"] is None


def test_written_truth_is_json_and_replaces_the_old_one(tmp_path):
    path = tmp_path / "truth.json"
    path.write_text("old")
    write_truth(path, VirtualObject(load_scenario("static")).truth())
    assert json.loads(path.read_text())["theta_bar_deg"] is None
    assert [each.name for each in tmp_path.iterdir()] == ["truth.json"]


def test_seed_changes_what_is_random_and_only_that():
    scenario = load_scenario("random-walk")
    first, again, other = (VirtualObject(scenario, seed).truth() for seed in (1, 1, 2))
    assert first == again
    assert first["theta_bar_deg"] != other["theta_bar_deg"]
