"""Every shipped scenario with faults: what the host counts is what the emulator did, to the sample."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from analysis.cycles.search import find_cycles
from emulator.faults.definitions import FaultSettings, TimedFault
from emulator.scenario import load_scenario, scenario_names
from host.recording.load import assemble, load_trial
from host.results.result import score_trial
from tests.faulty_trials import faulty_chunks
from tests.recorded_trials import scenario, write_recording

FAULTY = [name for name in scenario_names() if load_scenario(name).faults != FaultSettings()]


def injected(truth):
    """Faults that hit samples, by kind."""
    return Counter(fault["kind"] for fault in truth["faults"] if fault.get("packet") == "ORIENTATION")


def test_the_list_of_scenarios_with_faults_is_the_expected_one():
    assert set(FAULTY) == {
        "bad-cable",
        "bad-filter",
        "bluetooth",
        "ftdi",
        "lossy",
        "reset",
        "troubled",
        "unplugged",
    }


@pytest.mark.parametrize("name", FAULTY)
def test_counted_is_injected(name):
    chunks, truth = faulty_chunks(load_scenario(name))
    trial = assemble(chunks, name)
    losses, faults, device, sent = trial.losses, injected(truth), truth["device"], truth["sent"]
    spoiled = faults["zero-quaternion"] + faults["wrong-norm"]
    damaged = truth["frames_damaged"].get("ORIENTATION", 0) + spoiled
    repeated = faults["duplicate"]
    # What is still on its way when the link is closed cannot be known of by the host: it was never handed over.
    on_the_wire = sent["ORIENTATION"] - repeated + faults["drop"] + device["samples_dropped"]
    assert device["samples_produced"] - on_the_wire in range(5)
    assert losses.produced == on_the_wire
    assert losses.received == sent["ORIENTATION"] - repeated - damaged
    assert losses.dropped == device["samples_dropped"]
    assert losses.lost == faults["drop"]
    assert losses.rejected == damaged
    assert losses.duplicates == repeated
    assert losses.reordered == faults["reorder"]
    assert losses.produced == losses.received + losses.lost + losses.rejected + losses.dropped
    assert len(trial.series) == losses.received
    assert losses.segments == len(device["boot_ids"])
    assert trial.counters.malformed == spoiled
    assert trial.reconnects == Counter(fault["kind"] for fault in truth["faults"])["unplug"]
    # Every sample stands once, in the order in which the object took it.
    assert (np.diff(trial.series.index) > 0).all()
    assert (np.diff(trial.series.times_s) > 0).all()


@pytest.mark.parametrize("name", ["lossy", "unplugged", "troubled"])
def test_a_recording_gives_the_same_account_as_its_capture(name, tmp_path):
    chunks, _ = faulty_chunks(load_scenario(name))
    live = assemble(chunks, name)
    again = load_trial(write_recording(tmp_path / "trial.mcap", chunks))
    assert again.losses == live.losses
    assert again.counters == live.counters
    assert again.reconnects == live.reconnects
    np.testing.assert_array_equal(again.series.quats_wxyz, live.series.quats_wxyz)


def test_damaged_frames_of_every_kind_count_as_rejected():
    faults = FaultSettings(bit_error_rate=3e-4)
    chunks, truth = faulty_chunks(replace(scenario("ideal", motion={"cycles": 4}), faults=faults))
    trial = assemble(chunks, "x")
    assert trial.counters.cobs_errors > 0
    assert trial.counters.crc_errors > 0
    assert trial.losses.rejected == truth["frames_damaged"]["ORIENTATION"]
    assert trial.losses.lost == 0


def test_an_object_whose_link_is_full_says_how_many_samples_it_dropped():
    faults = FaultSettings(at=(TimedFault("stall", at_s=5.0, for_s=4.0), TimedFault("stall", at_s=12.0, for_s=6.0)))
    chunks, truth = faulty_chunks(replace(scenario("ideal", motion={"cycles": 6}), faults=faults))
    losses = assemble(chunks, "x").losses
    assert losses.dropped == truth["device"]["samples_dropped"] > 300
    assert (losses.lost, losses.rejected, losses.exact) == (0, 0, True)


# ---- what losses do to a score --------------------------------------------------------------------------------------


def recorded(faults, cycles=10):
    chunks, truth = faulty_chunks(replace(scenario("ideal", motion={"cycles": cycles}), faults=faults))
    return assemble(chunks, "x"), truth


def scored(faults):
    trial, truth = recorded(faults)
    return score_trial(trial), truth


def test_an_end_point_inside_a_gap_is_refused_and_the_score_degraded():
    clean, truth = scored(FaultSettings())
    at_s = clean.endpoints[4].time_s  # on the time axis of the samples, which begin with the hand's
    # The link is away around one end point: the others stay.
    trial, _ = recorded(FaultSettings(at=(TimedFault("unplug", at_s=at_s - 0.3, for_s=0.6),)))
    gap = score_trial(trial)
    times = np.array([point.time_s for point in gap.endpoints])
    assert np.abs(times - at_s).min() > 1.0
    assert any("inside a gap" in item.reason for item in find_cycles(trial.series).left_out)
    quality = gap.to_json()["quality"]
    assert quality["degraded"]
    assert any("samples are missing" in warning for warning in gap.warnings)
    assert truth["theta_bar_deg"] == pytest.approx(0.8)


def test_a_cycle_with_a_gap_is_named():
    at_s = 2.0 + 4.0 * 4 + 1.2  # in mid-stroke, where nothing is at rest
    score, _ = scored(FaultSettings(at=(TimedFault("unplug", at_s=at_s, for_s=0.3),)))
    result = score.to_json()
    assert score.valid
    (cycle,) = result["quality"]["cycles_with_gaps"]
    missing = result["missing_per_cycle"]
    assert missing[cycle - 1] == sum(missing) == score.losses.missing > 0
    assert score.endpoints[cycle - 1].time_s < at_s < score.endpoints[cycle].time_s
    assert not result["quality"]["degraded"]


def test_a_good_trial_is_not_degraded():
    score, _ = scored(FaultSettings())
    assert score.to_json()["quality"] | {"limits": []} == {
        "degraded": False,
        "reasons": [],
        "cycles_with_gaps": [],
        "limits": [],
    }


def test_repeated_and_late_samples_change_nothing_in_the_score():
    clean, _ = scored(FaultSettings())
    messy, _ = scored(FaultSettings(duplicate_probability=0.05, reorder_probability=0.05))
    assert messy.losses.duplicates > 50
    assert messy.losses.missing == 0
    assert messy.theta_bar_deg == pytest.approx(clean.theta_bar_deg, abs=1e-12)
