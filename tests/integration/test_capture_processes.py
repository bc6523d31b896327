"""Captures between real processes: a virtual object on a pty or a TCP port, and the command beside it."""

import json
import os
import re
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from analysis.scoring.card import rotation_drift
from host.commands.demo import true_drift_deg
from host.recording.load import load_trial
from host.results.result import score_trial
from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import (
    PERFECT_IMU,
    one_sentence,
    quick_scenario,
    rotdrift,
    rotdrift_here,
    started,
    wait_for_line,
)
from tests.waiting import wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs ptys and POSIX signals")

ENDPOINT_BOUND_DEG = 0.0035
"""Angle error of one int16 quaternion, as the protocol states it."""


def truth_of(result, truth):
    """True θ̄ of the end points in a result."""
    first, last = result["endpoints"][0]["sequence"], result["endpoints"][-1]["sequence"]
    quats = [
        point["quat_wxyz"]
        for point in truth["endpoints"]
        if point["sequence"] is not None and first - 40 <= point["sequence"] <= last + 40
    ]
    assert len(quats) == result["n_endpoints"]
    return rotation_drift(quats).theta_bar_deg


def assert_same(one, other, where="result"):
    """Compare two results; numbers may differ in the last digit, for sums depend on where arrays lie in memory."""
    assert type(one) is type(other), where
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key, value in one.items():
            assert_same(value, other[key], f"{where}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), where
        for k, (mine, yours) in enumerate(zip(one, other, strict=True)):
            assert_same(mine, yours, f"{where}[{k}]")
    elif isinstance(one, float):
        assert one == pytest.approx(other, rel=1e-12, abs=1e-14), where
    else:
        assert one == other, where


def test_a_noiseless_trial_over_a_pty_is_measured_within_the_quantisation_and_replays_the_same(tmp_path):
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        captured = rotdrift("capture", virtual.link, "--cycles", 5, "--out", recording, "--json")
        truth = virtual.stop()
    assert captured.returncode == 0, captured.stderr
    result = json.loads(captured.stdout)
    assert result["valid"]
    assert result["n_endpoints"] >= 6  # a busy machine is late to end it
    # Only the first and the last end point count, each with its own rounding.
    bound = 2 * ENDPOINT_BOUND_DEG / (result["n_endpoints"] - 1)
    assert result["theta_bar_deg"] == pytest.approx(truth_of(result, truth), abs=bound)
    assert truth["theta_bar_deg"] == pytest.approx(0.4, abs=1e-9)
    assert result["period_s"] == pytest.approx(0.5, abs=0.002)
    assert result["losses"]["missing"] == 0
    assert result["losses"]["exact"]
    assert result["object"]["name"] == "virtual cube"
    assert result["capture"]["ended"] == "5 cycles are done"
    live = result["capture"]["clock"]
    assert live["round_trips"] >= 2
    assert live["consistent"]  # nothing is received before it is sent
    assert live["offset_uncertainty_ms"] > 0
    assert result["clock"]["round_trips"] == live["round_trips"]
    assert result["clock"]["consistent"]
    low_ms, high_ms = result["clock"]["mapped_time_error_ms"]
    assert low_ms < high_ms
    assert 0 <= live["jitter_p50_ms"] <= live["jitter_p99_ms"]
    assert result["clock"]["jitter_p99_ms"] >= 0
    assert len(result["clock"]["segments"]) == 1
    assert all(abs(np.linalg.norm(point["quat_wxyz"]) - 1) < 1e-12 for point in result["endpoints"])
    assert len(captured.stderr.splitlines()) >= 6  # one line per cycle
    assert json.loads(recording.with_suffix(".json").read_text()) == result

    del result["capture"]
    for command in ("replay", "score"):
        again = rotdrift_here(command, recording, "--json")
        assert again.returncode == 0, again.stderr
        assert_same(json.loads(again.stdout), result)
    refused = rotdrift_here("capture", virtual.link, "--out", recording)
    assert "exists already" in one_sentence(refused, 4)


def captured_over_tcp(folder, wrap_s):
    clock = f"start_us = {2**32 - wrap_s * 1_000_000}\nskew_ppm = 80.0"
    scenario = quick_scenario(folder, imu="", clock=clock, period_s=0.7, cycles=200)
    with started("emulate", "--scenario", scenario, "--link", "tcp:0", "--truth", folder / "truth.json") as virtual:
        link = wait_for_line(virtual, "ready: ")[-1].split("ready: ")[1].strip()
        captured = rotdrift("capture", link, "--duration", wrap_s + 4, "--json", cwd=folder)
        virtual.send_signal(signal.SIGTERM)
        assert virtual.exit_code() == 0
    assert captured.returncode == 0, captured.stderr
    return json.loads(captured.stdout), json.loads((folder / "truth.json").read_text())


def test_a_noisy_trial_over_tcp_with_a_wrapping_clock_is_within_its_interval(tmp_path):
    # The clock wraps so long after power-up; a busy machine may take longer even to begin.
    for wrap_s in (6, 20, 60):
        folder = tmp_path / str(wrap_s)
        folder.mkdir()
        result, truth = captured_over_tcp(folder, wrap_s)
        if truth["hand_start_s"] < wrap_s - 2:
            break
    ticks = [point["device_time_us"] for point in truth["endpoints"][: result["n_endpoints"]]]
    assert min(ticks) < 2**31 < max(ticks)  # the clock wrapped between end points
    low, high = result["interval_deg"]
    # One interval of twenty misses the truth, and how many cycles there are depends on the machine: twice the width.
    assert low - (high - low) / 2 <= truth_of(result, truth) <= high + (high - low) / 2
    assert abs(result["theta_bar_deg"] - truth_of(result, truth)) < 0.1
    assert result["link"]["resets"] == 0
    assert list((folder / "rotdrift-trials").glob("*.mcap"))
    assert list((folder / "rotdrift-trials").glob("*.json"))


def test_ctrl_c_ends_in_order_and_a_second_capture_is_refused_meanwhile(tmp_path):
    recording = tmp_path / "trial.mcap"
    scenario = quick_scenario(
        tmp_path,
        begins="at-power-up",
        lead_in_s=1.0,
        device="answers = false\nstreams_from_power_up = true",
    )
    with VirtualObjectProcess(scenario) as virtual, started("capture", virtual.link, "--out", recording) as capture:
        wait_for_line(capture, "cycle   1")
        second = rotdrift_here("capture", virtual.link, "--out", tmp_path / "second.mcap")
        assert f"(process {capture.pid})" in one_sentence(second, 3)
        assert not (tmp_path / "second.mcap").exists()
        wait_for_line(capture, "cycle   4")
        capture.send_signal(signal.SIGINT)
        done = capture.finish()
    assert done.returncode == 0, done.stderr
    assert "rotation drift θ̄ = " in done.stdout
    assert "does not answer" in done.stdout
    result = json.loads(recording.with_suffix(".json").read_text())
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.005)
    assert result["capture"]["ended"] == "stopped by the operator"
    assert result["object"] is None
    assert load_trial(recording).damage == ()


def test_an_object_that_vanishes_leaves_a_scored_recording(tmp_path):
    recording = tmp_path / "trial.mcap"
    with (
        VirtualObjectProcess(quick_scenario(tmp_path)) as virtual,
        started("capture", virtual.link, "--cycles", 1000, "--reconnect", 1, "--out", recording) as capture,
    ):
        wait_for_line(capture, "cycle   5")
        virtual.stop()
        done = capture.finish()
    assert done.returncode == 3
    assert "is gone" in done.stderr
    assert "did not come back within 1 s" in done.stderr
    assert "Traceback" not in done.stderr
    assert "rotation drift θ̄ = " in done.stdout
    result = json.loads(recording.with_suffix(".json").read_text())
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.005)
    assert result["capture"]["ended"] == "the link was lost"
    assert result["losses"]["missing"] == 0


def test_a_killed_capture_leaves_a_recording_that_scores_as_it_is(tmp_path):
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(quick_scenario(tmp_path, imu=PERFECT_IMU)) as virtual:
        with started("capture", virtual.link, "--out", recording) as capture:
            wait_for_line(capture, "cycle   4")
            killed_ns = time.monotonic_ns()
            os.kill(capture.pid, signal.SIGKILL)
            capture.exit_code()
        truth = virtual.stop()
    trial = load_trial(recording)
    assert "was not closed" in trial.damage[0]
    assert last_chunk_ns(recording) > killed_ns - 2_000_000_000  # how little is lost: test_capture_disk.py
    score = score_trial(trial)
    assert score.valid
    assert score.theta_bar_deg == pytest.approx(true_drift_deg(score, truth), abs=0.01)
    scored = rotdrift_here("score", recording)
    assert scored.returncode == 0
    assert "was not closed" in " ".join(scored.stdout.split())


def last_chunk_ns(recording):
    from host.recording.reader import RecordingReader

    return [chunk.host_time_ns for chunk in RecordingReader(Path(recording)).chunks()][-1]


def test_the_demonstration_compares_with_the_truth(tmp_path):
    done = rotdrift("demo", "--scenario", quick_scenario(tmp_path), "--cycles", 4, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    words = " ".join(done.stdout.split())
    assert re.search(r"measured θ̄ = 0\.(39|40)\d° ± ", words)
    assert "true θ̄ = 0.400°" in words
    recording, result = (words.split(f"{name} ")[-1].split()[0] for name in ("recording", "result"))
    assert (tmp_path / recording).exists()
    assert json.loads((tmp_path / result).read_text())["valid"]


def test_a_demonstration_that_is_killed_leaves_no_object_behind(tmp_path):
    with started("demo", "--scenario", quick_scenario(tmp_path), cwd=tmp_path) as demo:
        line = wait_for_line(demo, "capturing 10 cycles from serial:")[-1]
        device = Path(line.split("serial:")[1].split(";")[0])
        assert device.is_symlink()
        demo.send_signal(signal.SIGKILL)
        wait_for(lambda: not device.is_symlink(), "the end of the object")


def test_a_scenario_that_does_not_exist_stops_the_demonstration_with_a_sentence(tmp_path):
    failed = rotdrift_here("demo", "--scenario", "nonsense", cwd=tmp_path)
    assert "unknown scenario 'nonsense'" in failed.stderr
    assert "Traceback" not in failed.stderr
    assert failed.returncode in {2, 3}
    assert not list(tmp_path.glob("rotdrift-trials/*"))
