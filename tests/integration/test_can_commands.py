"""The commands over CAN as a user types them: a static baseline, two objects of one bus at once, score, replay."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from host.cli import main
from host.recording.reader import RecordingReader
from tests.can_link_run import object_on
from tests.waiting import HANG_S


def test_two_objects_of_one_bus_are_captured_at_once_and_each_recording_scores_alone(
    tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture
) -> None:
    bus = f"can:virtual:{request.node.name}"
    links = [f"{bus}?node=4", f"{bus}?node=9&bitrate=500k"]
    with object_on(f"{bus}?node=4", "fast"), object_on(f"{bus}?node=9", "fast"):
        code = main(["capture", *links, "--cycles", "4", "--out", str(tmp_path / "both"), "--json"])
    results = json.loads(capsys.readouterr().out)["results"]
    assert code == 0, results
    assert [each["link"] for each in results] == links
    for number, node in ((1, 4), (2, 9)):
        captured = results[number - 1]["result"]
        assert captured["valid"], captured["reasons"]
        assert captured["losses"]["lost"] == 0
        recording = tmp_path / f"both-{number}.mcap"
        reader = RecordingReader(recording)
        assert "Virtual bus channel" in reader.header.settings["interface"]
        frames = [frame for chunk in reader.chunks() for frame in chunk.frames]
        assert {frame.arbitration_id & 31 for frame in frames} == {node}
        assert main(["score", str(recording), "--json"]) == 0
        scored = json.loads(capsys.readouterr().out)
        assert scored["theta_bar_deg"] == captured["theta_bar_deg"]
        assert scored["endpoints"] == captured["endpoints"]
    assert main(["replay", str(tmp_path / "both-1.mcap"), "--speed", "100"]) == 0
    assert "rotation drift" in capsys.readouterr().out


def test_two_objects_with_one_node_id_end_the_capture_and_the_recording_says_so_too(
    tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture
) -> None:
    link, recording = f"can:virtual:{request.node.name}?node=4", tmp_path / "both.mcap"
    with object_on(link, "fast", seed=1), object_on(link, "fast", seed=2):
        assert main(["capture", link, "--duration", "60", "--out", str(recording)]) == 3
    said = capsys.readouterr()
    sentence = "two objects on the bus have node id 4"
    assert f"rotdrift: {sentence}" in said.err
    assert "give each a node id of its own" in said.err
    assert main(["score", str(recording), "--json"]) == 1
    scored = json.loads(capsys.readouterr().out)
    assert any(sentence in warning for warning in scored["warnings"])
    # What was received before they were told apart is of both, so nobody can say what is missing of either; it sums up.
    losses = scored["losses"]
    parts = [losses[name] for name in ("received", "lost", "rejected", "dropped_by_device")]
    assert losses["produced"] == sum(parts)
    assert scored["theta_bar_deg"] is None


def test_an_object_at_rest_on_can_gives_a_static_baseline(
    tmp_path: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("analysis.sensor.baseline.MIN_DURATION_S", 2.0)  # what it needs is not what is tried here
    link = f"can:virtual:{request.node.name}?node=4&fd=1"
    with object_on(link, "static"):
        assert main(["baseline", link, "--duration", "3", "--out", str(tmp_path / "imu.toml")]) == 0
    assert "heading drift" in capsys.readouterr().out
    assert "rate_deg_per_min" in tomllib.loads((tmp_path / "imu.toml").read_text())


def test_damage_to_bytes_is_said_to_have_no_effect_on_can(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    truth = tmp_path / "truth.json"
    link = f"can:slcan:pty:{tmp_path / 'object'}"
    assert main(["emulate", "--scenario", "bad-cable", "--link", link, "--duration", "0.2", "--truth", str(truth)]) == 0
    said = capsys.readouterr().err
    assert said.startswith("note: bit_error_rate, burst_probability, truncate_probability, garbage_probability")
    assert "no effect on CAN" in said
    assert json.loads(truth.read_text())["frames_damaged"] == {}
    serial = f"pty:{tmp_path / 'object'}"
    assert main(["emulate", "--scenario", "bad-cable", "--link", serial, "--duration", "0.2"]) == 0
    assert capsys.readouterr().err == ""


NAMESPACE = """
set -e
ip link set lo up
ip route add 239.0.0.0/8 dev lo
mkfifo "$1/ready"
"$2" -m rotdrift emulate --scenario fast --link "$3" --duration 60 > "$1/ready" &
object=$!
read -r said < "$1/ready"
"$2" -m rotdrift doctor "$3" --seconds 1 --json || [ $? = 1 ]
kill $object
"""


def test_a_multicast_bus_works_in_a_network_namespace_of_its_own(tmp_path: Path) -> None:
    pytest.importorskip("msgpack", reason="udp_multicast needs the extra rotdrift[multicast]")
    script = tmp_path / "namespace.sh"
    script.write_text(NAMESPACE)
    link = "can:udp_multicast:239.74.163.2?node=6&fd=1"
    try:
        subprocess.run(
            ["unshare", "-rn", "ip", "link", "set", "lo", "up"], check=True, capture_output=True, timeout=HANG_S
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this system lets nobody make a network namespace")
    words = ["unshare", "-rn", "sh", str(script), str(tmp_path), sys.executable, link]
    done = subprocess.run(words, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stderr
    findings = {finding["topic"]: finding for finding in json.loads(done.stdout)}
    assert findings["link"]["verdict"] == findings["object"]["verdict"] == "ok"
    assert findings["losses"]["text"].startswith("0 of ")
