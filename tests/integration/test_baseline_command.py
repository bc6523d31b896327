"""``rotdrift baseline`` against a virtual object at rest: measured from a link and from a file, taken by a score."""

import json
import sys
import tomllib

import numpy as np
import pytest

from tests.command_line import one_sentence, quick_scenario, rotdrift_here, started, wait_for_line

WARM = """
noise_deg = 0.02
correlated_noise_deg = 0.0
heading_drift_deg_per_min = 3.0
"""


@pytest.mark.skipif(sys.platform == "win32", reason="a pty needs a POSIX system")
def test_a_link_at_rest_gives_the_heading_drift(tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.sensor.baseline.MIN_DURATION_S", 2.0)  # what it needs is not what is tried here
    scenario = quick_scenario(tmp_path, imu=WARM, lead_in_s=60.0, cycles=3)
    with started("emulate", "--scenario", scenario, "--link", f"pty:{tmp_path / 'object'}") as emulator:
        wait_for_line(emulator, str(tmp_path / "object"))
        out = tmp_path / "imu.toml"
        result = rotdrift_here("baseline", f"serial:{tmp_path / 'object'}", "--duration", "3", "--out", out)
    assert result.returncode == 0, result.stderr
    assert "heading drift" in result.stdout
    written = tomllib.loads(out.read_text(encoding="utf-8"))
    assert written["rate_deg_per_min"][2] == pytest.approx(3.0, abs=4.0 * written["rate_error_deg_per_min"][2] + 0.02)
    assert written["temperature_c"][0] > 0.0


def orientation_file(path, angles_deg):
    """A CSV at 100 Hz of an object turned about the vertical."""
    half = np.radians(angles_deg) / 2.0
    rows = [f"{k / 100:.2f},{np.cos(a):.12f},0,0,{np.sin(a):.12f}" for k, a in enumerate(half)]
    path.write_text("t,qw,qx,qy,qz\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def test_a_file_and_the_score_that_takes_it(tmp_path):
    times_s = np.arange(6000) / 100.0
    rest = orientation_file(tmp_path / "rest.csv", 2.0 * times_s / 60.0)  # 2 degrees a minute
    result = rotdrift_here("baseline", rest, "--json", "--out", tmp_path / "imu.toml")
    assert result.returncode == 0, result.stderr
    measured = json.loads(result.stdout)
    assert measured["rate_deg_per_min"][2] == pytest.approx(2.0, abs=1e-6)
    trial = orientation_file(tmp_path / "trial.csv", 20.0 * np.cos(2.0 * np.pi * times_s / 5.0) + 0.1 * times_s)
    scored = json.loads(rotdrift_here("score", trial, "--baseline", tmp_path / "imu.toml", "--json").stdout)
    sensor = scored["sensor"]
    assert sensor["per_cycle_deg"] == pytest.approx(2.0 / 60.0 * 5.0, rel=1e-3)
    assert "exists already" in one_sentence(rotdrift_here("baseline", rest, "--out", tmp_path / "imu.toml"), 4)


def test_a_moving_object_is_refused(tmp_path):
    times_s = np.arange(3000) / 100.0
    moving = orientation_file(tmp_path / "moving.csv", 20.0 * np.cos(2.0 * np.pi * times_s / 5.0))
    assert "moved" in one_sentence(rotdrift_here("baseline", moving), 1)


def test_neither_a_file_nor_a_port(tmp_path):
    assert "there is no port" in one_sentence(rotdrift_here("baseline", tmp_path / "nothing"), 3)
