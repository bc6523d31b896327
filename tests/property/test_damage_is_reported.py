"""Any damage to the recording of a trial: the same result, or a sentence on what is wrong with the file."""

import json
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings

from analysis.scoring.result import result_text
from host.cards.definitions import parse_cards
from host.errors import FileError, HostError
from host.links.transport import Chunk
from host.recording import format as fmt
from host.recording.load import RecordedTrial, load_trial
from host.results.result import score_trial
from host.submission.bundle import MANIFEST, check_manifest, manifest_text
from host.submission.contents import build_submission
from host.submission.source import TrialSource
from host.submission.verification import verify_files
from tests.command_line import rotdrift_here
from tests.damaged_files import DAMAGE, another_opcode, records_of, removed, write_trial


class Whole(NamedTuple):
    data: bytes
    records: list
    trial: RecordedTrial

    def __repr__(self):  # hypothesis prints it
        return "Whole"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording of a trial with commands, notes, a view and a window: its bytes, its records, its trial."""
    path = tmp_path_factory.mktemp("whole") / "trial.mcap"
    data = write_trial(path)
    return Whole(data, records_of(data), load_trial(path))


def same(one, other):
    """Whether two trials have the same result, but for the file's name."""
    return (
        np.array_equal(one.series.quats_wxyz, other.series.quats_wxyz)
        and np.array_equal(one.series.times_s, other.series.times_s)
        and (one.losses, one.counters, one.info, one.header) == (other.losses, other.counters, other.info, other.header)
        and repr(one.actions) == repr(other.actions)  # NaN is not equal to itself
    )


@settings(max_examples=600, deadline=None)
@given(damage=DAMAGE)
def test_any_damage_gives_the_same_trial_or_a_sentence(whole, tmp_path_factory, damage):
    data, records, expected = whole
    change, *how = damage
    path = tmp_path_factory.getbasetemp() / "trial.mcap"
    path.write_bytes(change(data, records, *how))
    try:
        trial = load_trial(path)
    except FileError:  # nothing of it can be read, and that is reported
        return
    assert trial.damage or same(trial, expected)
    losses = trial.losses  # the link lost nothing, so whatever is missing is the file's
    assert (losses.lost, losses.rejected, losses.dropped) == (0, 0, 0)
    assert losses.produced == losses.received + losses.damaged_in_file
    if not trial.damage:
        assert result_text(score_trial(trial)) == result_text(score_trial(expected))


def received(whole, number):
    """Index of the n-th record of received data."""
    data, records, _ = whole
    return [k for k, (at, _) in enumerate(records) if data[at] == 5 and data[at + 9 : at + 11] == b"\1\0"][number]


def hurt_at(whole, path, change, number, *more):
    data, records, _ = whole
    path.write_bytes(change(data, records, (received(whole, number) + 0.5) / len(records), *more))
    return load_trial(path)


@pytest.mark.parametrize("kind", [0, 2, 3, 7, 9, 11, 13, 14, 15, 16, 200])
def test_a_record_of_another_kind_is_missing_from_the_file_and_not_lost_on_the_link(whole, tmp_path, kind):
    trial = hurt_at(whole, tmp_path / "hurt.mcap", another_opcode, 100, kind)
    assert trial.losses.missing > 0
    missing = [sentence for sentence in trial.damage if sentence.startswith("1 record of /raw/received is missing")]
    assert len(missing) == 1
    assert "not lost on the link" in missing[0]


def test_the_last_record_is_missed_by_the_statistics(whole, tmp_path):
    trial = hurt_at(whole, tmp_path / "hurt.mcap", removed, -1)
    data, records, _ = whole
    n = sum(data[at] == 5 and data[at + 9] == 1 for at, _ in records)
    assert f"the file states {n} records of /raw/received and holds {n - 1}: damaged in the file" in trial.damage


def test_a_hole_of_zeros_is_counted(whole, tmp_path):
    data, records, _ = whole
    first, last = records[received(whole, 50)][0], records[received(whole, 80)][0]
    path = tmp_path / "hurt.mcap"
    path.write_bytes(data[:first] + bytes((last - first) // 9 * 9) + data[last - (last - first) % 9 :])
    damage = load_trial(path).damage
    assert any("of no kind that the format knows" in sentence for sentence in damage)


def test_what_no_result_rests_on_is_reported_by_the_checksum(whole, tmp_path):
    data, records, expected = whole
    view = next(at for at, _ in records if data[at] == 5 and data[at + 9] == 3)
    path = tmp_path / "hurt.mcap"
    path.write_bytes(data[: view + 80] + bytes([data[view + 80] ^ 1]) + data[view + 81 :])
    trial = load_trial(path)
    assert same(trial, expected)
    assert trial.damage == ("the file is not as it was written; what was read from it is whole",)


def test_numbers_that_another_tool_left_out_are_no_damage(tmp_path):
    import mcap.writer

    path = tmp_path / "rewritten.mcap"
    with path.open("wb") as file:
        out = mcap.writer.Writer(file, enable_data_crcs=True)
        out.start()
        channel = out.register_channel(fmt.RECEIVED, "cdr", 0)
        for number in range(30):
            out.add_message(channel, number, fmt.encode_raw(Chunk(b"data", number)), number)
        out.finish()
    trial = load_trial(path)
    assert trial.damage == ("the recording's own description is damaged: link, date and settings are not known",)


class Shown(dict):
    def __repr__(self):  # hypothesis prints it
        return "Shown"


def shown_by(command, path, folder):
    """What one command makes of a recording: its result as far as it is numbers, and all its words."""
    out = folder / "out.csv"
    out.unlink(missing_ok=True)
    more = ["--json"] if command in {"score", "replay"} else [out]
    done = rotdrift_here(command, path, *more)
    words = " ".join((done.stdout + done.stderr).split())
    if command == "convert":
        return out.read_bytes() if out.exists() else None, words
    result = json.loads(done.stdout) if done.stdout else None
    if result is not None:
        for key in ("recording", "capture"):  # the file's name
            result.pop(key, None)
    return result, words


@pytest.fixture(scope="module")
def shown(whole, tmp_path_factory):
    """What each command makes of the whole recording, and the submission of it."""
    folder = tmp_path_factory.mktemp("shown")
    (folder / "trial.mcap").write_bytes(whole.data)
    shown = {name: shown_by(name, folder / "trial.mcap", folder)[0] for name in ("score", "replay", "convert")}
    return Shown(shown | {"report": submission(whole.data)})


def submission(data):
    return build_submission([TrialSource({"trial.mcap": data}, parse_cards(""))], drawings=False)


@settings(max_examples=6, deadline=None)
@given(damage=DAMAGE)
def test_every_command_gives_the_same_or_reports_what_is_missing(whole, shown, tmp_path_factory, damage):
    change, *how = damage
    data = change(whole.data, whole.records, *how)
    folder = tmp_path_factory.getbasetemp()
    path = folder / "trial.mcap"
    path.write_bytes(data)
    try:
        sentences = load_trial(path).damage
    except FileError:
        sentences = None
    refused = sentences is None
    for command in ("score", "replay", "convert"):
        result, words = shown_by(command, path, folder)
        if result is None:  # it cannot be read or scored, and the reason is given
            assert words.startswith("rotdrift: ")
            assert all(sentence in words for sentence in (sentences or ())[:3])
            refused = True
        elif not sentences:
            assert result == shown[command], command
        elif command == "convert":
            assert all(sentence in words for sentence in sentences)
        else:
            assert set(sentences) <= set(result["warnings"]), command
    if refused:
        with pytest.raises(HostError):
            submission(data)
        return
    built = submission(data)
    found = verify_files({**built.files, MANIFEST: manifest_text(built.files).encode()}, drawings=False)
    assert found.equal
    for sentence in sentences:
        assert any(sentence in warning for warning in built.submission.trials[0].warnings)  # in report and files
        assert any("is damaged" in note and sentence in note for note in found.notes)
    if not sentences:
        without = {name for name in built.files if "/raw/" not in name} - {"submission.json"}
        assert all(built.files[name] == shown["report"].files[name] for name in without)
    claimed = {**shown["report"].files, f"trials/{built.submission.trials[0].id}/raw/trial.mcap": data}
    manifest = manifest_text(shown["report"].files).encode()
    altered = check_manifest({**claimed, MANIFEST: manifest})  # damaged after it was submitted
    assert bool(altered) == (data != whole.data)


@pytest.mark.parametrize("command", ["score", "replay", "convert"])
def test_commands_report_what_is_damaged(whole, tmp_path, command):
    path = tmp_path / "hurt.mcap"
    hurt_at(whole, path, removed, 100)
    done = rotdrift_here(command, path, *([tmp_path / "out.csv"] if command == "convert" else []))
    assert "1 record of /raw/received is missing from the file" in " ".join((done.stdout + done.stderr).split())


@pytest.mark.parametrize("command", ["score", "replay"])
def test_a_recording_with_too_little_left_to_score_is_refused_with_what_is_wrong_with_the_file(
    whole, tmp_path, command
):
    data, records, _ = whole
    path = tmp_path / "cut.mcap"
    path.write_bytes(data[: records[received(whole, 3)][0]])
    done = rotdrift_here(command, path)
    words = " ".join((done.stdout + done.stderr).split())
    assert "the recording was not closed" in words
    assert "θ̄ =" not in words
