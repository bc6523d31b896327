"""A slice of the structure-aware fuzzing; and that it finds what it looks for: faults are planted, one at a time."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from random import Random

import mcap.reader
import pytest
from msgspec import structs

import host.results.result
import host.submission.differences
from firmware_protocol.packets import PacketType
from firmware_protocol.schema import PACKET_BYTES
from host.losses.runs import MissingRuns
from host.recording.assembly import TrialAssembly
from host.recording.load import load_trial
from host.trial.turning import Turning
from tests.waiting import HANG_S

pytest.importorskip("resource", reason="limits of processor time and memory are those of POSIX")

from tests.fuzz.result import campaign, frames, packets, recorded, records, road
from tests.fuzz.result.bounds import TooSlowError, limited_time
from tests.fuzz.result.layouts import frame_fields, packet_fields
from tests.fuzz.result.mcap_file import numbered, whole
from tests.fuzz.result.members import recording_of, submissions
from tests.fuzz.result.sessions import sessions
from tests.fuzz.result.targets import TARGETS

ROOT = Path(__file__).parents[2]
INPUTS = {"serial": 25, "can": 20, "recording": 20, "submission": 15}


def run_of(target, n, seed=1):
    run = campaign.Run(target, seed, "here")
    run.try_inputs(TARGETS[target], n)
    return run


@pytest.mark.parametrize("target", TARGETS)
def test_a_slice_finds_nothing_and_most_of_it_gets_far(target):
    run = run_of(target, INPUTS[target])
    assert run.finds == {}
    far = ("equal", "not equal") if target == "submission" else ("scored, valid", "scored, not valid")
    assert sum(run.outcomes.get(name, 0) for name in far) > 0.7 * run.inputs
    assert run.outcomes[far[0]] > 0.3 * run.inputs


def is_found(target, check, n=60, seed=1):
    """Whether a check finds something within so many inputs."""
    run = campaign.Run(target, seed, "here")
    while not any(check in key for key in run.finds) and run.inputs < n:
        run.try_inputs(TARGETS[target], 1)
    return run.inputs < n


def test_a_late_sample_that_is_not_taken_out_of_what_is_missing_is_found(monkeypatch):
    monkeypatch.setattr(MissingRuns, "fill", lambda *_: True)
    assert is_found("serial", "check_ledger") or is_found("serial", "runs make up what is missing")


def test_a_part_of_the_live_view_that_fails_is_found(monkeypatch):
    def fails(self, *pose):
        raise ZeroDivisionError

    monkeypatch.setattr(Turning, "feed", fails)
    assert is_found("serial", "no part of the live view fails")


def test_samples_that_only_one_of_the_paths_counts_are_found(monkeypatch):
    monkeypatch.setattr(TrialAssembly, "finish", lambda _: None)
    assert is_found("can", "live and offline ledger")


def test_a_score_that_is_off_is_found(monkeypatch):
    score = host.results.result.score_series

    def off(*args, **options):
        result = score(*args, **options)
        theta_deg = result.theta_bar_deg
        return result if theta_deg is None else structs.replace(result, theta_bar_deg=theta_deg + 0.01)

    monkeypatch.setattr(host.results.result, "score_series", off)
    assert is_found("serial", "θ̄ is that of the end points")


def test_a_result_that_is_not_read_as_it_was_written_is_found(monkeypatch):
    parse = road.parse_result
    monkeypatch.setattr(road, "parse_result", lambda data: structs.replace(parse(data), warnings=("?",)))
    assert is_found("can", "a result file is read as it was written")


def test_altered_numbers_that_verifying_calls_equal_are_found(monkeypatch):
    monkeypatch.setattr(host.submission.differences, "numbers_equal", lambda *_: True)
    assert is_found("submission", "an altered file is found", seed=4)


def test_a_cut_recording_that_is_not_reported_is_found(monkeypatch):
    load = recorded.load_trial
    monkeypatch.setattr(recorded, "load_trial", lambda path: replace(load(path), damage=()))
    assert is_found("recording", "a recording without its end is reported")


def test_an_input_that_does_not_end_is_a_find():
    def spins(rng):
        while True:
            pass

    with pytest.raises(TooSlowError), limited_time(0.05):
        spins(None)


def test_the_command_keeps_its_state_and_its_memory(tmp_path):
    state = tmp_path / "state.json"
    line = [sys.executable, "-m", "tests.fuzz.result", "submission", "--state", state, "--slice", "2", "--slices", "2"]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    kept = campaign.load(state)
    assert (kept.inputs, kept.seed, kept.finds) == (4, 1, {})
    kept.try_inputs(TARGETS["submission"], 4)  # goes on where the file says
    kept.save(state)
    assert campaign.load(state).outcomes == run_of("submission", 8).outcomes
    code = "from tests.fuzz.result import bounds; bounds.limit_memory(); bytearray(2**30)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=HANG_S, check=False
    )
    assert "MemoryError" in done.stderr


def test_the_fields_are_all_of_the_schema():
    for kind in PacketType:
        fields = packet_fields(kind)
        assert [field.offset for field in fields] == [1 + sum(f.size for f in fields[:n]) for n in range(len(fields))]
        assert 1 + sum(field.size for field in fields) == PACKET_BYTES[kind]
    assert {field.name for field in packet_fields(PacketType.STATUS)} >= {"samples_produced", "gyro_bias_dps[2]"}


def test_the_signals_of_a_frame_do_not_overlap():
    for fields in frame_fields().values():
        for selected in {field.selector for field in fields}:
            bits = [bit for f in fields if f.selector == selected for bit in range(f.start, f.start + f.length)]
            assert len(bits) == len(set(bits))


@pytest.mark.parametrize("kind", PacketType)
def test_edge_values_are_in_the_field_and_nowhere_else(kind):
    rng = Random(1)
    for field in packet_fields(kind):
        before = bytes([kind]) + rng.randbytes(PACKET_BYTES[kind] - 1)
        seen = set()
        for _ in range(200):
            packet = bytearray(before)
            field.edge(packet, rng)
            end = field.offset + field.size
            assert packet[: field.offset] == before[: field.offset]
            assert packet[end:] == before[end:]
            seen.add(bytes(packet[field.offset : end]))
        assert len(seen) > 3
        if field.code and field.code[-1] not in "fd":
            assert seen >= {edge.to_bytes(field.size, "little", signed=edge < 0) for edge in field.limits}


def test_every_mutation_can_be_met_alone():
    """None fails on what another one left, down to a single packet."""
    for module, line_of in (
        (packets, packets.delivered),
        (frames, lambda s: [frames.Heard(f) for f in frames.heard(s, False, 3)]),
    ):
        for mutation in module.MUTATIONS:
            for n in (1, 2, 30):
                for seed in range(3):
                    mutation(line_of(sessions()[0])[:n], Random(seed))
    for mutation in records.MUTATIONS:
        for n in (1, 2, 30):
            mutation(records.records_in(recording_of(sessions()[0]))[:n], Random(n))


def test_a_recording_that_is_put_together_again_is_whole(tmp_path):
    path = tmp_path / "whole.mcap"
    line = numbered(
        [*records.beginning(), *records.records_in(recording_of(sessions()[0]))[len(records.beginning()) :]]
    )
    path.write_bytes(whole([record for record in line if record.kind != 15][:60])[0])
    assert load_trial(path).damage == ()
    with path.open("rb") as file:
        found = mcap.reader.make_reader(file, validate_crcs=True)
        summary = found.get_summary()
        assert summary.statistics.message_count == len(list(found.iter_messages()))
        assert {channel.topic for channel in summary.channels.values()} >= {"/raw/received", "/trial/action"}


def test_the_submissions_of_the_fuzzer_are_of_several_kinds():
    counts = [sum(name.endswith("result.json") for name in files) for files in submissions()]
    assert counts == [1, 2, 2]
