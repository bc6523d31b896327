"""Cables pulled, objects reset and exchanged, between real processes over ptys and TCP."""

import json
import sys

import numpy as np
import pytest

from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from tests.command_line import quick_scenario, rotdrift, rotdrift_here, started, wait_for_line
from tests.live_objects import live_object

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs ptys")


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_a_cable_pulled_out_and_put_in_again_is_a_gap_in_one_trial(tmp_path, kind):
    recording = tmp_path / "trial.mcap"
    address = f"pty:{tmp_path / 'object'}" if kind == "pty" else "tcp:0"
    with (
        live_object(tmp_path, quick_scenario(tmp_path), address) as virtual,
        started("capture", virtual.link, "--cycles", 9, "--out", recording, "--json") as capture,
    ):
        wait_for_cycle(capture, 4)
        virtual.fault("unplug for_s=0.4")
        done = capture.finish()
        truth = virtual.stop()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert truth["fault_counts"] == {"unplug": 1}
    assert result["capture"]["ended"] == "9 cycles are done"
    assert result["link"]["reconnects"] == 1
    assert result["link"]["resets"] == 0  # the clock of the object never stopped
    assert any("open again" in warning for warning in result["capture"]["warnings"])
    losses = result["losses"]
    assert losses["exact"]
    assert losses["produced"] == losses["received"] + losses["lost"] + losses["rejected"] + losses["dropped_by_device"]
    assert losses["missing"] >= 80  # 0.4 s at 200 Hz, and the way back
    ends = result["endpoints"]
    steps = [
        step
        for step, begin, end in zip(result["steps_deg"], ends, ends[1:], strict=False)
        if not begin["flags"] and not end["flags"]  # one at the edge of the gap is told as such, and may be off
    ]
    assert len(steps) >= 2
    assert steps == pytest.approx([0.4] * len(steps), abs=0.01)
    # How soon: benchmarks.reaction_times.
    chunks = list(RecordingReader(recording).chunks())
    mark = next(i for i, chunk in enumerate(chunks) if not chunk.data)
    assert any(chunk.data for chunk in chunks[mark + 1 :])
    assert load_trial(recording).damage == ()
    again = json.loads(rotdrift_here("score", recording, "--json").stdout)
    assert again["losses"] == losses
    assert again["link"] == result["link"]


def test_a_reset_object_is_started_again_and_the_trial_goes_on(tmp_path):
    recording = tmp_path / "trial.mcap"
    with (
        live_object(tmp_path, quick_scenario(tmp_path), f"pty:{tmp_path / 'object'}") as virtual,
        started("capture", virtual.link, "--cycles", 10, "--out", recording, "--json") as capture,
    ):
        wait_for_cycle(capture, 5)
        virtual.fault("reset for_s=0.2")
        done = capture.finish()
        truth = virtual.stop()
    assert done.returncode in {0, 1}, done.stderr
    result = json.loads(done.stdout)
    assert len(truth["device"]["boot_ids"]) == 2
    assert result["link"]["resets"] == 1
    assert result["link"]["reconnects"] == 0
    assert "the object was reset during the capture" in result["capture"]["warnings"]
    assert any("may not have the same origin" in warning for warning in result["warnings"])
    assert result["losses"]["segments"] == 2
    trial = load_trial(recording)
    assert [segment.reason for segment in trial.segments] == ["the capture began", "the object was reset"]
    # Nothing of the reset object was counted twice or got lost but for what it says itself.
    assert trial.losses.missing == 0
    assert (np.diff(trial.series.times_s) > 0).all()


def test_another_object_at_the_same_port_is_refused(tmp_path):
    recording = tmp_path / "trial.mcap"
    with (
        live_object(tmp_path, quick_scenario(tmp_path), f"pty:{tmp_path / 'object'}") as virtual,
        started("capture", virtual.link, "--cycles", 1000, "--out", recording) as capture,
    ):
        wait_for_line(capture, "cycle   5")
        virtual.fault("swap for_s=0.2")
        done = capture.finish()
        truth = virtual.stop()
    assert done.returncode == 3
    assert "another object answers now" in done.stderr
    other = next(fault["device_id"] for fault in truth["faults"] if fault["kind"] == "swap")
    assert f"{other:016x}" in done.stderr
    result = json.loads(recording.with_suffix(".json").read_text())
    assert result["object"]["device_id"] != f"{other:016x}"
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)


def test_a_wrong_fault_command_is_told_and_passed_over(tmp_path):
    with live_object(tmp_path, "static", f"pty:{tmp_path / 'object'}") as virtual:
        virtual.fault("explode")
        assert "rotdrift: " in virtual.program.stderr.up_to("\n")[0]
        virtual.stop()


def test_the_log_of_a_link_holds_every_byte_with_its_time(tmp_path):
    recording, log = tmp_path / "trial.mcap", tmp_path / "link.txt"
    with live_object(tmp_path, quick_scenario(tmp_path), f"pty:{tmp_path / 'object'}") as virtual:
        arguments = ("capture", virtual.link, "--duration", 1.5, "--out", recording, "--debug-link", log)
        rotdrift(*arguments)
        refused = rotdrift_here(*arguments[:-3], tmp_path / "other.mcap", *arguments[-2:])
        virtual.stop()
    lines = [line.split() for line in log.read_text().splitlines() if not line.startswith("#")]
    for sign, topic in (("<", "/raw/received"), (">", "/raw/sent")):
        logged = bytes.fromhex("".join("".join(line[3:]) for line in lines if line[1] == sign))
        recorded = b"".join(chunk.data for chunk in RecordingReader(recording).chunks(topic))
        assert logged == recorded
        assert len(logged) > 10
    times = [float(line[0]) for line in lines if line[1] == "<"]
    assert times == sorted(times)
    assert refused.returncode == 4
    assert "exists already" in refused.stderr


def wait_for_cycle(capture, number):
    """Wait for a cycle of a capture that prints JSON: its lines are on standard error."""
    capture.stderr.up_to(f"cycle {number:3d}")
