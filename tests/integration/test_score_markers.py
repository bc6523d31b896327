"""``rotdrift score --from m1 --to m2``: the window between markers that were set during the capture."""

import json

import pytest

from host.recording import format as fmt
from host.recording.writer import RecordingWriter
from host.trial.operator import MARKER, OperatorAction
from tests.command_line import one_sentence, rotdrift_here
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks, write_recording


@pytest.fixture(scope="module")
def chunks():
    return virtual_chunks(scenario(motion={"cycles": 8, "period_s": 2.0}))[0]


@pytest.fixture
def marked(tmp_path, chunks):
    path = tmp_path / "marked.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    for number, time_s in enumerate((5.1, 13.9), 1):
        action = OperatorAction(MARKER, time_s, f"marker {number}")
        writer.add_values(fmt.ACTION, action.values(), chunks[-1].host_time_ns)
    writer.close()
    return path


def test_the_window_between_markers_is_that_of_their_times(marked):
    by_marker = json.loads(rotdrift_here("score", marked, "--from", "m1", "--to", "m2", "--json").stdout)
    by_time = json.loads(rotdrift_here("score", marked, "--from", "5.1", "--to", "13.9", "--json").stdout)
    whole = json.loads(rotdrift_here("score", marked, "--json").stdout)
    assert by_marker["valid"]
    assert by_marker["endpoints"] == by_time["endpoints"]
    assert by_marker["n_endpoints"] < whole["n_endpoints"]


def test_a_marker_that_is_not_there_is_named_with_those_that_are(marked):
    said = one_sentence(rotdrift_here("score", marked, "--from", "m3"), 2)
    assert "no marker m3" in said
    assert "m1 at 5.10 s" in said


def test_a_recording_without_markers_says_so(tmp_path, chunks):
    plain = write_recording(tmp_path / "plain.mcap", chunks)
    assert "no marker m1" in one_sentence(rotdrift_here("score", plain, "--to", "m1"), 2)
    assert "neither seconds" in one_sentence(rotdrift_here("score", plain, "--to", "soon"), 2)


def test_a_submission_of_the_window_between_markers_holds_their_times(marked, tmp_path):
    done = rotdrift_here("report", marked, "--from", "m1", "--to", "m2", "--out", tmp_path / "sub")
    assert done.returncode == 0, done.stderr
    (choices,) = (tmp_path / "sub").glob("trials/*/choices.json")
    assert json.loads(choices.read_text()) == {"from_s": 5.1, "to_s": 13.9}
    assert rotdrift_here("verify", tmp_path / "sub", "--no-drawings").returncode == 0
    assert "no marker m7" in one_sentence(
        rotdrift_here("report", marked, "--from", "m7", "--out", tmp_path / "x.zip"), 2
    )
