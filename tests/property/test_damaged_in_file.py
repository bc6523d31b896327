"""What a damaged file lacks is a column of its own, never the link's: in score, replay and a recovered recording."""

import json
import struct
import threading
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.can.frames import pack_frames
from firmware_protocol.packets import OrientationBatch
from host.capture.playback import play, recorded_actions, recorded_commands
from host.links.transport import FrameChunk, GapChunk
from host.recording.completeness import NumberedRecords
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.recording.recovery import recover
from host.recording.replay_link import ReplayTransport
from host.recording.writer import RecordingWriter
from host.screen.dashboard.picture import View, picture
from host.screen.screens import QuietScreen
from host.stream.decoding import Link
from host.stream.samples import SampleAssembler
from host.trial.live import Trial
from tests.can_traffic import object_at
from tests.command_line import rotdrift_here
from tests.emulated_packets import trial_packets
from tests.faulty_trials import faulty_chunks
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks

HEAD = struct.Struct("<BQ")
NAMES = ("lossy", "bad-cable", "troubled", "unplugged")


def written(path, chunks):
    writer = RecordingWriter(path, "serial:/dev/x", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    writer.close()
    return path.read_bytes()


def received_records(data):
    """Start and end of each record of received data."""
    found, at = [], 8
    while at < len(data) - 8:
        end = at + HEAD.size + HEAD.unpack_from(data, at)[1]
        if data[at] == 5 and data[at + 9 : at + 11] == b"\1\0":
            found.append((at, end))
        at = end
    return found


@pytest.fixture(scope="module")
def ideal(tmp_path_factory):
    """Chunks of a trial whose link lost nothing, and its recording."""
    chunks, _ = virtual_chunks(scenario("ideal", motion={"cycles": 5, "period_s": 1.0}), chunk_s=0.02)
    return chunks, written(tmp_path_factory.mktemp("ideal") / "trial.mcap", chunks)


def n_samples(chunks):
    return sum(len(item) for chunk in chunks for item in Link().feed(chunk) if isinstance(item, OrientationBatch))


def replayed(path):
    return play(
        ReplayTransport(path), Trial(), QuietScreen(), threading.Event(),
        actions=recorded_actions(path), commands=recorded_commands(path),
    )  # fmt: skip


def one_by_one(path):
    """The account that a replay keeps, chunk by chunk."""
    link, assembler = Link(), SampleAssembler()
    for chunk in RecordingReader(path).delivered():
        items = link.feed(chunk)
        assembler.damaged(link.take_damage())
        assembler.feed(items, chunk.host_time_ns)
        if isinstance(chunk, GapChunk):
            assembler.add_gap()
        elif chunk.reopened:
            assembler.reopened()
    assembler.release()
    return assembler.losses()


def remove(data, number, records):
    first, last = received_records(data)[number][0], received_records(data)[number + records - 1][1]
    return data[:first] + data[last:]


def another_opcode(data, number, records):
    hurt = bytearray(data)
    for start, _ in received_records(data)[number : number + records]:
        hurt[start] = 0
    return bytes(hurt)


def another_byte_inside(data, number, records):
    hurt = bytearray(data)
    for _, end in received_records(data)[number : number + records]:
        hurt[end - 5] ^= 0x20
    return bytes(hurt)


def zeros(data, number, records):
    """A hole of zeros; its length is one that brings the walk of records back in step, as one in nine does."""
    first, end = received_records(data)[number][0], received_records(data)[number + records - 1][1]
    return data[:first] + bytes((end - first) // 9 * 9) + data[end:]


@pytest.mark.parametrize("damage", [remove, another_opcode, another_byte_inside, zeros])
@pytest.mark.parametrize("records", [1, 12])
def test_samples_in_missing_records_are_the_files_to_the_sample(ideal, damage, records, tmp_path):
    chunks, data = ideal
    path = tmp_path / "hurt.mcap"
    path.write_bytes(damage(data, 250, records))  # within the cycles
    trial, gone = load_trial(path), n_samples(chunks[250 : 250 + records])
    assert gone >= records
    losses = trial.losses
    assert (losses.damaged_in_file, losses.missing, losses.lost, losses.rejected) == (gone, gone, 0, 0)
    assert any("the file" in sentence or "damaged" in sentence for sentence in trial.damage)
    shown = replayed(path)
    assert shown.stream.losses == losses
    assert f"{gone} damaged in the file, 0 lost" in "".join(line.plain for line in picture((shown,), View(), 140, 40))

    result = json.loads(rotdrift_here("score", path, "--json").stdout)
    account = result["losses"]
    parts = ("received", "lost", "rejected", "dropped_by_device", "damaged_in_file")
    assert account["produced"] == sum(account[part] for part in parts)
    assert account["damaged_in_file"] == gone
    assert sum(cycle.get("damaged_in_file", 0) for cycle in result["losses_per_cycle"]) == gone
    assert all(cycle["lost"] == 0 for cycle in result["losses_per_cycle"])
    words = " ".join(rotdrift_here("score", path).stdout.split())
    assert f"0 dropped by the object, {gone} damaged in the file" in words


def test_one_changed_byte_does_not_change_the_account_of_the_link(ideal, tmp_path):
    """The opcode of one record: its sample is missing from the file, and θ̄ is of one sample fewer with a warning."""
    chunks, data = ideal
    (tmp_path / "whole.mcap").write_bytes(data)
    (tmp_path / "hurt.mcap").write_bytes(another_opcode(data, 150, 1))
    whole, hurt = (
        json.loads(rotdrift_here("score", tmp_path / name, "--json").stdout) for name in ("whole.mcap", "hurt.mcap")
    )
    assert "damaged_in_file" not in whole["losses"]
    assert hurt["losses"]["damaged_in_file"] == n_samples(chunks[150:151])
    assert {**hurt["losses"], "received": 0, "missing": 0, "share": 0, "damaged_in_file": 0} == {
        **whole["losses"], "received": 0, "missing": 0, "share": 0, "damaged_in_file": 0
    }  # fmt: skip
    assert any("1 record of /raw/received is missing from the file" in warning for warning in hurt["warnings"])


def test_a_hole_of_zeros_over_most_of_the_file_is_the_files(ideal, tmp_path):
    chunks, data = ideal
    n = len(received_records(data)) * 6 // 10
    path = tmp_path / "hurt.mcap"
    path.write_bytes(zeros(data, 60, n))
    trial = load_trial(path)
    assert trial.losses.damaged_in_file == trial.losses.missing == n_samples(chunks[60 : 60 + n])
    assert (
        f"{n} records of /raw/received are missing from the file: damaged there, not lost on the link" in trial.damage
    )


@pytest.mark.parametrize("fd", [False, True], ids=["classic", "fd"])
@pytest.mark.parametrize("damage", [remove, another_byte_inside])
def test_of_a_can_recording_too(fd, damage, tmp_path):
    frames = object_at(fd=fd).encode(trial_packets("fast", 8.0))
    timed = [replace(frame, host_time_ns=MONOTONIC_NS + k * 5_000_000) for k, frame in enumerate(frames)]
    reads = [timed[start : start + 4] for start in range(0, len(timed), 4)]
    data = written(tmp_path / "whole.mcap", [FrameChunk(pack_frames(read), read[-1].host_time_ns) for read in reads])
    path = tmp_path / "hurt.mcap"
    path.write_bytes(damage(data, 200, 10))
    whole, hurt = load_trial(tmp_path / "whole.mcap").losses, load_trial(path).losses
    assert (whole.missing, hurt.lost, hurt.rejected) == (0, 0, 0)
    assert hurt.damaged_in_file == whole.received - hurt.received > 10
    assert one_by_one(path) == hurt


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    """Recordings whose links did lose, damage and repeat samples, by scenario."""
    folder, found = tmp_path_factory.mktemp("faulty"), {}
    for name in NAMES:
        chunks = faulty_chunks(scenario(name, motion={"cycles": 5}), seed=7)[0]
        found[name] = written(folder / f"{name}.mcap", chunks), load_trial(folder / f"{name}.mcap").losses
    return found


@settings(max_examples=15, deadline=None)
@given(
    name=st.sampled_from(NAMES),
    places=st.lists(st.tuples(st.floats(0.02, 0.97), st.integers(1, 12)), min_size=1, max_size=6),
    damage=st.sampled_from([remove, another_opcode, another_byte_inside]),
)
def test_a_link_with_losses_is_blamed_for_none_of_the_files(faulty, tmp_path_factory, name, places, damage):
    data, whole = faulty[name]
    n = len(received_records(data))
    hurt = data
    for number, records in sorted({int(share * n): count for share, count in places}.items(), reverse=True):
        if number + records < len(received_records(hurt)):
            hurt = damage(hurt, number, records)
    path = tmp_path_factory.getbasetemp() / "hurt.mcap"
    path.write_bytes(hurt)
    losses = load_trial(path).losses
    kinds = losses.received, losses.lost, losses.rejected, losses.dropped, losses.damaged_in_file
    assert losses.produced == sum(kinds)
    if losses.segments == whole.segments and losses.produced == whole.produced:
        assert losses.damaged_in_file >= whole.received - losses.received
        assert losses.lost + losses.rejected + losses.dropped <= whole.lost + whole.rejected + whole.dropped
    assert one_by_one(path) == losses


def test_a_recovered_recording_keeps_what_its_source_lacked(ideal, tmp_path):
    chunks, data = ideal
    (tmp_path / "hurt.mcap").write_bytes(another_byte_inside(data, 100, 7))
    recover(tmp_path / "hurt.mcap", tmp_path / "clean.mcap")
    hurt, clean = load_trial(tmp_path / "hurt.mcap"), load_trial(tmp_path / "clean.mcap")
    assert clean.losses == hurt.losses
    assert clean.losses.damaged_in_file == n_samples(chunks[100:107])
    np.testing.assert_array_equal(clean.series.quats_wxyz, hurt.series.quats_wxyz)
    sentence = "7 records of /raw/received are missing from the file that this one was recovered from"
    assert [sentence in warning for warning in clean.damage] == [True]
    for command in (["score"], ["replay"]):
        assert sentence in " ".join(rotdrift_here(*command, tmp_path / "clean.mcap").stdout.split())


def test_recovery_counts_what_is_missing_at_the_end_of_a_closed_file(ideal, tmp_path):
    _, data = ideal
    n = len(received_records(data))
    (tmp_path / "hurt.mcap").write_bytes(another_byte_inside(data, n - 3, 3))
    report = recover(tmp_path / "hurt.mcap", tmp_path / "clean.mcap")
    assert (report.chunks, report.missing_chunks) == (n - 3, 3)
    assert any("3 records of /raw/received are missing" in text for text in load_trial(tmp_path / "clean.mcap").damage)


def gaps_one_by_one(numbers):
    """Where records are missing, and how many, by the plain rule: what a number leaves out in front of it."""
    found, expected = [], 0
    for place, number in enumerate(numbers):
        if number != expected:
            found.append((place, number - expected if 0 < number - expected < 10**6 else 0))
        expected = number + 1
    return found


@settings(max_examples=200, deadline=None)
@given(
    parts=st.lists(st.tuples(st.integers(0, 40), st.integers(1, 30)), min_size=1, max_size=8),
    cuts=st.lists(st.integers(1, 200), max_size=6),
)
def test_gaps_in_numbers_are_found_however_the_records_come(parts, cuts):
    numbers = np.concatenate([np.arange(first, first + n) for first, n in parts])
    if any(
        numbers[k + 1] == numbers[k - 1] + 2 and numbers[k] != numbers[k - 1] + 1 for k in range(1, len(numbers) - 1)
    ):
        return  # one number alone is damaged: the next test
    if not numbers[:2].any():  # not numbered at all
        return
    whole, pieces, found, start = NumberedRecords(), NumberedRecords(), [], 0
    if numbers[0] and len(numbers) > 1 and numbers[1] == 1:
        return  # the very first number alone is damaged
    for stop in sorted({min(cut, len(numbers)) for cut in cuts} | {len(numbers)}):
        if stop > start:
            found += [(start + place, n) for place, n in pieces.add(numbers[start:stop])]
        start = max(start, stop)
    assert whole.add(numbers) == gaps_one_by_one(numbers.tolist()) == found
    assert (whole.missing, whole.disordered) == (pieces.missing, pieces.disordered)


def test_a_damaged_number_alone_is_no_gap():
    records = NumberedRecords()
    assert records.add(np.array([0, 1, 2**31, 3, 4])) == []
    assert (records.missing, records.disordered) == (0, 1)
