"""Faults on purpose: what the truth says was done is what a decoder finds."""

import json
from collections import Counter
from dataclasses import replace
from queue import SimpleQueue

import numpy as np
import pytest

from emulator import ScenarioError
from emulator.faults.definitions import FaultSettings, TimedFault, parse_fault_command
from emulator.injection import FaultInjector
from emulator.runner import run
from emulator.scenario import load_scenario
from emulator.virtual_object import VirtualObject
from firmware_protocol import packets as p
from firmware_protocol.serial.decoder import StreamDecoder
from tests.memory_link import MemoryLink
from tests.sequence_oracle import counted

IDEAL = load_scenario("ideal")


START = (p.Start(1),)


def run_with(faults, duration_s=None, commands=START, scenario=IDEAL, seed=3):
    link = MemoryLink()
    link.put(*commands)
    result = run(replace(scenario, faults=faults), link, duration_s, seed=seed)
    decoder = StreamDecoder()
    items = decoder.feed(link.take())
    return result, decoder.counters, items


def samples(items):
    return [int(s) for item in items if isinstance(item, p.OrientationBatch) for s in item.sequence]


def entries(truth, kind):
    return [entry for entry in truth["faults"] if entry["kind"] == kind]


def test_without_faults_everything_sent_arrives():
    truth, counters, _ = run_with(FaultSettings())
    assert truth["fault_counts"] == {} == truth["frames_damaged"]
    assert truth["sent"] == {packet_type.name: count for packet_type, count in counters.packets.items()}


def test_dropped_frames_are_exactly_the_missing_ones():
    truth, _, items = run_with(FaultSettings(drop_probability=0.05))
    dropped = {entry["sequence"] for entry in entries(truth, "drop")}
    assert len(dropped) == truth["fault_counts"]["drop"] == pytest.approx(260, rel=0.25)
    assert set(range(truth["device"]["samples_produced"])) - set(samples(items)) == dropped
    assert counted(items)["samples_lost"] == len([s for s in dropped if s < max(samples(items))])


def test_duplicates_and_reordering_are_counted_as_such():
    truth, _, items = run_with(FaultSettings(duplicate_probability=0.02, reorder_probability=0.02))
    twice = [sequence for sequence, n in Counter(samples(items)).items() if n == 2]
    assert sorted(twice) == sorted(entry["sequence"] for entry in entries(truth, "duplicate"))
    assert counted(items)["duplicates"] == truth["fault_counts"]["duplicate"] > 50
    assert counted(items)["reordered"] == truth["fault_counts"]["reorder"] > 50
    assert set(samples(items)) == set(range(truth["device"]["samples_produced"]))


def test_wrong_quaternions_are_rejected_and_changed_signs_are_not():
    faults = FaultSettings(zero_quaternion_probability=0.02, wrong_norm_probability=0.02, sign_flip_probability=0.3)
    truth, counters, items = run_with(faults)
    counts = truth["fault_counts"]
    assert min(counts.values()) > 50
    assert counters.malformed == counts["zero-quaternion"] + counts["wrong-norm"]
    clean = {s: q for i in run_with(FaultSettings())[2] if isinstance(i, p.OrientationBatch) for s, q in rows(i)}
    flipped = {entry["sequence"] for entry in entries(truth, "sign-flip")}
    for item in items:
        if isinstance(item, p.OrientationBatch):
            for sequence, quat in rows(item):
                np.testing.assert_allclose(quat, clean[sequence] * (-1.0 if sequence in flipped else 1.0), atol=1e-15)


def rows(batch):
    return zip(batch.sequence.tolist(), batch.quats_wxyz, strict=True)


@pytest.mark.parametrize(
    "faults",
    [
        FaultSettings(bit_error_rate=1e-3),
        FaultSettings(burst_probability=0.1, burst_bits=20),
        FaultSettings(truncate_probability=0.1),
        FaultSettings(bit_error_rate=3e-4, burst_probability=0.02, truncate_probability=0.02, garbage_probability=0.1),
    ],
)
def test_every_damaged_frame_is_lost_and_no_other(faults):
    truth, counters, items = run_with(faults)
    assert sum(truth["frames_damaged"].values()) > 200
    for packet_type, count in truth["sent"].items():
        damaged = truth["frames_damaged"].get(packet_type, 0)
        assert counters.packets[p.PacketType[packet_type]] == count - damaged
    kinds = ("bit-flips", "burst", "truncate")
    hit = {entry["sequence"] for kind in kinds for entry in entries(truth, kind) if "sequence" in entry}
    assert set(range(truth["device"]["samples_produced"])) - set(samples(items)) == hit


def test_the_rate_of_bit_errors_is_the_asked_one():
    truth, counters, _ = run_with(FaultSettings(bit_error_rate=1e-3))
    flipped = sum(entry["count"] for entry in entries(truth, "bit-flips"))
    assert flipped / (8 * counters.bytes) == pytest.approx(1e-3, rel=0.1)


def test_garbage_damages_nothing():
    truth, counters, items = run_with(FaultSettings(garbage_probability=0.2, garbage_before_bytes=500))
    assert samples(items) == list(range(truth["device"]["samples_produced"]))
    injected = sum(entry["count"] for entry in entries(truth, "garbage"))
    assert injected > 5000
    # Zeros within the noise are delimiters to a decoder, everything else of it is skipped.
    assert counters.skipped_bytes <= injected
    assert counters.skipped_bytes == pytest.approx(injected * 255 / 256, rel=0.01)


def test_rates_act_between_their_times_only():
    truth, _, _ = run_with(FaultSettings(drop_probability=0.5, rates_from_s=10.0, rates_until_s=12.0))
    sequences = [entry["sequence"] for entry in entries(truth, "drop")]
    assert min(sequences) >= 999
    assert max(sequences) <= 1200
    assert 60 < len(sequences) < 140


def test_a_stall_lets_the_object_drop_and_count():
    truth, _, items = run_with(FaultSettings(at=(TimedFault("stall", at_s=10.0, for_s=10.0),)))
    assert entries(truth, "stall") == [{"kind": "stall", "time_s": 10.0, "count": 1, "for_s": 10.0}]
    statuses = [item for item in items if isinstance(item, p.Status)]
    assert statuses[-1].samples_dropped == truth["device"]["samples_dropped"] == counted(items)["samples_lost"]
    assert 600 < counted(items)["samples_lost"] < 1000


def test_unplugging_loses_what_was_sent_meanwhile():
    truth, _, items = run_with(FaultSettings(at=(TimedFault("unplug", at_s=10.0, for_s=2.0),)))
    missing = sorted(set(range(truth["device"]["samples_produced"])) - set(samples(items)))
    assert missing == list(range(1000, 1200))
    assert counted(items)["samples_lost"] == 200


def test_overlapping_unplugs_count_as_one_until_the_last_ends():
    faults = FaultSettings(at=(TimedFault("unplug", at_s=10.0, for_s=2.0), TimedFault("unplug", at_s=11.0, for_s=3.0)))
    _, _, items = run_with(faults)
    assert counted(items)["samples_lost"] == 400


def test_a_reset_starts_again_from_nothing():
    mute = replace(load_scenario("mute"), imu=IDEAL.imu, clock=IDEAL.clock)
    truth, _, items = run_with(FaultSettings(at=(TimedFault("reset", at_s=20.0, for_s=0.5),)), scenario=mute)
    infos = [item for item in items if isinstance(item, p.Info)]
    assert [info.boot_id for info in infos] == truth["device"]["boot_ids"]
    assert len(set(truth["device"]["boot_ids"])) == 2
    numbers = samples(items)
    again = numbers.index(0, 1)
    assert again == 2000
    assert numbers[again:] == list(range(len(numbers) - again))
    boots = [endpoint["boot"] for endpoint in truth["endpoints"]]
    assert boots == sorted(boots)
    assert set(boots) == {0, 1}


def test_another_object_may_come_back():
    truth, _, items = run_with(
        FaultSettings(at=(TimedFault("swap", at_s=20.0, for_s=0.5),)), scenario=load_scenario("mute")
    )
    first_id = load_scenario("mute").device.device_id
    assert truth["device"]["device_id"] == first_id
    assert entries(truth, "swap")[0]["device_id"] != first_id
    assert samples(items).count(0) == 2


def test_a_clock_step_shows_once_in_the_device_times():
    truth, _, items = run_with(FaultSettings(at=(TimedFault("clock-step", at_s=10.0, by_s=-4.0),)))
    times_us = np.concatenate([i.device_time_us for i in items if isinstance(i, p.OrientationBatch)]).astype(np.int64)
    steps = np.diff(times_us)
    assert Counter(steps.tolist()) == {10_000: len(steps) - 1, -3_990_000: 1}
    assert [e["device_time_us"] for e in truth["endpoints"]][:3] == pytest.approx([4e6, 8e6, 8e6], abs=2)


def test_a_flood_is_ten_times_the_rate_for_its_time():
    truth, _, items = run_with(FaultSettings(at=(TimedFault("flood", at_s=10.0, for_s=2.0, factor=10.0),)))
    assert truth["device"]["samples_produced"] == 5200 + 2 * 900
    assert counted(items)["samples_lost"] == 0
    assert [item.rate_hz for item in items if isinstance(item, p.Info)] == [100]


def test_commands_may_get_lost():
    commands = [p.Identify(k) for k in range(200)]
    truth, counters, _ = run_with(FaultSettings(command_loss_probability=0.3), 1.0, commands)
    assert truth["fault_counts"]["command-loss"] == pytest.approx(60, abs=20)
    assert counters.packets[p.PacketType.ACK] == 200 - truth["fault_counts"]["command-loss"]


@pytest.mark.parametrize("interval_ms", [0.0, 30.0])
def test_late_delivery_changes_neither_bytes_nor_order(interval_ms):
    late = FaultSettings(delivery_interval_ms=interval_ms, delivery_jitter_ms=15.0)
    _, _, items = run_with(late, 20.0)
    assert samples(items) == list(range(len(samples(items))))
    assert len(samples(items)) > 1980


def test_faults_depend_on_the_seed_alone():
    faults = FaultSettings(bit_error_rate=1e-4, drop_probability=0.01, garbage_probability=0.01)
    first, again, other = (run_with(faults, 20.0, seed=seed)[0] for seed in (1, 1, 2))
    assert first["faults"] == again["faults"] != other["faults"]


def test_live_faults():
    link, live = MemoryLink(), SimpleQueue()
    link.put(p.Start(1))
    live.put(parse_fault_command("stall for_s=2"))
    result = run(IDEAL, link, 10.0, live_faults=live)
    assert entries(result, "stall")[0]["for_s"] == 2.0
    for text, says in [
        ("", "a fault command is one of stall"),
        ("explode", "kind must be one of stall"),
        ("stall 3", "unknown setting '3'"),
        ("stall at_s=3", "unknown setting"),
        ("stall for_s=x", "for_s must be a number"),
        ("stall for_s=-1", "for_s must be a number from 0"),
        ("garbage count=1.5", "count must be a number"),
    ]:
        with pytest.raises(ScenarioError, match=says):
            parse_fault_command(text)


def test_probabilities_that_exclude_each_other():
    with pytest.raises(ScenarioError, match="must not sum to more than 1"):
        FaultSettings(drop_probability=0.6, reorder_probability=0.6)


@pytest.mark.parametrize("name", ["bad-cable", "lossy", "bad-filter", "troubled", "unplugged", "reset"])
def test_truth_of_the_shipped_fault_scenarios_is_json(name):
    truth, counters, _ = run_with(load_scenario(name).faults, scenario=load_scenario(name))
    assert truth["fault_counts"]
    assert json.loads(json.dumps(truth)) == truth
    assert counters.packets[p.PacketType.ORIENTATION] > 1000


def test_rates_can_be_changed_while_it_runs_and_come_back():
    injector, link = stepped(FaultSettings())
    injector.step(1.0)
    injector.inject(parse_fault_command("rates drop_probability=0.5 for_s=2"))
    for number in range(100, 600):
        injector.step(number / 100)
    truth = injector.truth()
    times_s = [entry["time_s"] for entry in entries(truth, "drop")]
    assert len(times_s) == pytest.approx(100, abs=40)  # of 200 samples
    assert 1.0 <= min(times_s) <= max(times_s) <= 3.0 + 0.011
    assert [entry["drop_probability"] for entry in entries(truth, "rates")] == [0.5]
    numbers = samples(StreamDecoder().feed(link.take()))
    assert len(numbers) + truth["fault_counts"]["drop"] == numbers[-1] + 1


def test_a_later_change_of_rates_is_not_undone_by_the_end_of_an_earlier_one():
    injector, _ = stepped(FaultSettings())
    injector.inject(parse_fault_command("rates drop_probability=1 for_s=1"))
    injector.step(0.5)
    injector.inject(parse_fault_command("rates drop_probability=0.5"))
    for number in range(50, 500):
        injector.step(number / 100)
    assert max(entry["time_s"] for entry in entries(injector.truth(), "drop")) > 4.5


@pytest.mark.parametrize("step_s", [0.001, 0.01, 0.13])
def test_a_second_object_shares_the_line_in_order_of_time_however_it_is_stepped(step_s):
    injector, link = stepped(FaultSettings(at=(TimedFault("second-object", at_s=0.5, for_s=1.0),)))
    for number in range(1, round(2.6 / step_s)):
        injector.step(number * step_s)
    items = StreamDecoder().feed(link.take())
    infos = [item.device_id for item in items if isinstance(item, p.Info)]
    (fault,) = injector.truth()["faults"]
    assert infos[-1] == fault["device_id"] != infos[0]
    clock_us = np.concatenate([item.device_time_us for item in items if isinstance(item, p.OrientationBatch)])
    other = clock_us > 10**9
    assert other.sum() == pytest.approx(100, abs=1)
    assert (np.diff(clock_us[other]) > 0).all()
    assert (np.diff(clock_us[~other].astype(np.int64)) > 0).all()
    first, last = np.flatnonzero(other)[[0, -1]]
    assert np.abs(np.diff(other[first:last].astype(int))).mean() > 0.9  # they take turns
    assert injector.truth()["sent"]["ORIENTATION"] == (~other).sum()


def stepped(faults):
    """An injector whose object streams from 0 s on."""
    virtual, link = VirtualObject(replace(IDEAL, faults=faults), 3), MemoryLink()
    link.open()
    injector = FaultInjector(virtual, link)
    link.put(*START)
    injector.receive(0.0)
    return injector, link
