"""Every fault there is, typed in while a real capture runs: told in the truth, and by the host as what it is."""

import json
import sys

import pytest

from emulator.faults.definitions import KINDS, RATES
from host.recording.load import load_trial
from tests.command_line import quick_scenario, rotdrift_here, started, wait_for_line
from tests.live_objects import live_object

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs ptys")

GROUPS = (
    ("stall for_s=0.2", "flood for_s=0.2", "clock-step by_s=40", "garbage count=300"),
    ("rates command_loss_probability=1 for_s=3", "unplug for_s=0.1", "reset for_s=0.1"),
    ("second-object for_s=0.1", "wrong-version for_s=0.1", "swap for_s=0.1"),
)
MUTE = "streams_from_power_up = true\nanswers = false"


def captured(tmp_path, command, device="", answers=True):
    """Capture, type a fault in, and let the capture end by itself; return its end and the truth."""
    recording = tmp_path / "trial.mcap"
    scenario = quick_scenario(tmp_path, device=device, begins="on-start" if answers else "at-power-up", cycles=500)
    with (
        live_object(tmp_path, scenario, f"pty:{tmp_path / 'object'}") as virtual,
        started("capture", virtual.link, "--cycles", 1000, "--out", recording) as capture,
    ):
        wait_for_line(capture, "cycle   5")
        virtual.fault(command)
        done = capture.finish()
        truth = virtual.stop()
    return done.returncode, done.stderr, json.loads(recording.with_suffix(".json").read_text()), truth


def test_a_second_object_on_the_line_ends_the_capture_and_gets_no_sample_into_it(tmp_path):
    code, stderr, result, truth = captured(tmp_path, "second-object for_s=60")
    (fault,) = truth["faults"]
    assert code == 3
    assert "a second object answers on this line" in stderr
    assert f"{fault['device_id']:016x}" in stderr
    assert result["object"]["device_id"] == f"{truth['device']['device_id']:016x}"
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)
    assert result["capture"]["ended"] == "another object answers"
    trial = load_trial(tmp_path / "trial.mcap")
    assert len(trial.segments) == 1
    # The second one lies at (0.5, 0.5, 0.5, 0.5), far from where the first is turned.
    assert abs(trial.series.quats_wxyz @ [0.5, 0.5, 0.5, 0.5]).max() < 0.8


def test_two_objects_that_never_say_who_they_are_are_found_out_by_their_clocks(tmp_path):
    code, stderr, _, truth = captured(tmp_path, "second-object for_s=60", device=MUTE, answers=False)
    assert truth["fault_counts"] == {"second-object": 1}
    assert code == 3
    assert "two objects send on this line at once" in stderr
    assert len(load_trial(tmp_path / "trial.mcap").segments) < 10


def test_a_firmware_of_another_major_version_is_refused_in_mid_capture(tmp_path):
    code, stderr, result, truth = captured(tmp_path, "wrong-version for_s=0.1 major=9")
    assert truth["fault_counts"] == {"wrong-version": 1}
    assert code == 3
    assert "speaks protocol version 9.0, this program version" in stderr
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)


def test_every_fault_can_be_typed_and_the_truth_has_each(tmp_path):
    recording = tmp_path / "trial.mcap"
    byte_rates = {"bit_error_rate": 1e-3, "burst_probability": 0.1, "truncate_probability": 0.1}
    rates = byte_rates | {"garbage_probability": 0.2, "drop_probability": 0.1, "duplicate_probability": 0.1}
    rates |= {"reorder_probability": 0.1, "zero_quaternion_probability": 0.1, "wrong_norm_probability": 0.1}
    rates |= {"sign_flip_probability": 0.1, "delivery_interval_ms": 5, "delivery_jitter_ms": 2}
    assert set(RATES) - set(rates) == {"burst_bits", "command_loss_probability"}
    whole = ["drop", "duplicate", "reorder", "zero-quaternion", "wrong-norm", "sign-flip"]
    bytewise = ["bit-flips", "burst", "truncate", "garbage"]
    scenario = quick_scenario(tmp_path, cycles=500)
    with (
        live_object(tmp_path, scenario, f"pty:{tmp_path / 'object'}") as virtual,
        started("capture", virtual.link, "--cycles", 1000, "--out", recording) as capture,
    ):
        wait_for_line(capture, "cycle   3")
        virtual.fault("rates for_s=1.5 " + " ".join(f"{name}={value}" for name, value in rates.items()))
        for kind in whole + bytewise:
            virtual.wait_for_fault(kind)
        for group in GROUPS:
            for command in group:
                virtual.fault(command)
            for command in group:
                virtual.wait_for_fault(command.split()[0])
        virtual.wait_for_fault("command-loss")
        capture.finish()
        counts = virtual.stop()["fault_counts"]
    assert set(counts) - {"lost-in-flight"} == {*KINDS, "rates", "command-loss", *whole, *bytewise}
    trial = load_trial(recording)
    losses = trial.losses
    assert losses.produced == losses.received + losses.lost + losses.rejected + losses.dropped
    assert losses.missing > 0
    assert rotdrift_here("score", recording).returncode in {0, 1}
