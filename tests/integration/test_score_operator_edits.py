"""What the operator did during a capture counts in later scorings; ``--ignore-actions`` shows the untouched score."""

import json

import pytest

from host.errors import UsageError
from host.recording import format as fmt
from host.recording.writer import RecordingWriter
from host.submission.source import sources_in
from host.trial.operator import EXCLUDE, WINDOW_START, WINDOW_STOP, OperatorAction
from tests.command_line import rotdrift_here
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks, write_recording

ACTIONS = (
    OperatorAction(WINDOW_START, 4.0),
    OperatorAction(EXCLUDE, 11.0, "the cable pulled", 8.0, 10.0),
    OperatorAction(WINDOW_STOP, 17.0),
)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """The same trial without and with an operator's edits."""
    folder = tmp_path_factory.mktemp("edits")
    chunks, _ = virtual_chunks(scenario("random-walk", motion={"cycles": 10, "period_s": 2.0}))
    path = folder / "edited.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    for action in ACTIONS:
        writer.add_values(fmt.ACTION, action.values(), chunks[-1].host_time_ns)
    writer.close()
    return write_recording(folder / "plain.mcap", chunks), path


def test_edits_are_honoured_by_default_and_can_be_looked_behind(recordings):
    plain, edited = (json.loads(rotdrift_here("score", path, "--json").stdout) for path in recordings)
    untouched = json.loads(rotdrift_here("score", recordings[1], "--ignore-actions", "--json").stdout)
    assert [item["reason"] for item in edited["excluded_cycles"]] == ["the cable pulled"]
    assert (edited["window"]["from_s"], edited["window"]["to_s"]) == (4.0, 17.0)
    assert edited["theta_bar_deg"] != plain["theta_bar_deg"]
    assert untouched["theta_bar_deg"] == plain["theta_bar_deg"]
    assert untouched["endpoints"] == plain["endpoints"]
    assert "excluded_cycles" not in untouched
    assert [action["kind"] for action in untouched["operator"]] == [action.kind for action in ACTIONS]
    assert any("do not count here, as asked" in warning for warning in untouched["warnings"])
    assert not any("as asked" in warning for warning in [*edited["warnings"], *plain["warnings"]])


def test_ignoring_what_was_not_done_says_nothing(recordings):
    result = json.loads(rotdrift_here("score", recordings[0], "--ignore-actions", "--json").stdout)
    assert not any("as asked" in warning for warning in result["warnings"])


def test_a_window_stays_at_the_extreme_that_the_operator_saw_counted(tmp_path):
    """It holds one end point more of the other extreme, which ``--from`` and ``--to`` alone would take."""
    chunks, _ = virtual_chunks(scenario("default", motion={"cycles": 10, "period_s": 2.0}))
    plain = json.loads(rotdrift_here("score", write_recording(tmp_path / "plain.mcap", chunks), "--json").stdout)
    counted = [point["time_s"] for point in plain["endpoints"]]
    start, stop = counted[2] - 1.2, counted[6] + 1.2  # half a period on either side lies the other extreme
    path = tmp_path / "edited.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    cycle = (counted[3], counted[4])
    for action in (
        OperatorAction(WINDOW_START, start),
        OperatorAction(EXCLUDE, counted[4], "slipped", *cycle),
        OperatorAction(WINDOW_STOP, stop),
    ):
        writer.add_values(fmt.ACTION, action.values(), chunks[-1].host_time_ns)
    writer.close()
    edited = json.loads(rotdrift_here("score", path, "--json").stdout)
    assert [point["time_s"] for point in edited["endpoints"]] == pytest.approx(counted[2:7], abs=0.05)
    assert [item["step"] for item in edited["excluded_cycles"]] == [1]
    given = json.loads(rotdrift_here("score", path, "--from", start, "--to", stop, "--json").stdout)
    assert len(given["endpoints"]) == 6


def test_cycles_left_out_after_the_fact_count_as_those_left_out_live(recordings):
    plain, edited = recordings
    scored = json.loads(rotdrift_here("score", plain, "--json").stdout)
    ends = [point["time_s"] for point in scored["endpoints"]]
    done = rotdrift_here(
        "score", plain, "--exclude", "3,5", "--exclude", "3", "--because", "the cable pulled", "--json"
    )
    result = json.loads(done.stdout)
    assert [item["step"] for item in result["excluded_cycles"]] == [2, 4]
    assert [item["reason"] for item in result["excluded_cycles"]] == ["the cable pulled"] * 2
    assert [item["from_s"] for item in result["excluded_cycles"]] == [ends[2], ends[4]]
    assert len(result["endpoints"]) == len(ends)
    assert "left out" in result["flags"][3]
    assert result["theta_bar_deg"] != scored["theta_bar_deg"]
    assert any("2 of 9 cycles are left out by the operator" in warning for warning in result["warnings"])
    # It joins what the operator did: the cycle that was left out live, and one more.
    both = json.loads(rotdrift_here("score", edited, "--exclude", "1", "--because", "late", "--json").stdout)
    assert [item["reason"] for item in both["excluded_cycles"]] == ["late", "the cable pulled"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--exclude", "3"), "left-out cycles need a reason"),
        (("--because", "late"), "--because needs cycles"),
        (("--exclude", "0", "--because", "late"), "which count from 1"),
        (("--exclude", "12", "--because", "late"), "there is no cycle 12 to leave out"),
        (("--exclude", "1,2,3,4,5,6,7", "--because", "late"), "fewer than 3 cycles"),
    ],
)
def test_what_cannot_be_left_out(recordings, options, message):
    done = rotdrift_here("score", recordings[0], *options)
    assert done.returncode != 0
    assert message in done.stdout + done.stderr


def test_a_report_leaves_out_the_same(recordings, tmp_path, monkeypatch):
    """The choice goes into the submission, and comes out of it: what ``verify`` makes again leaves out the same."""
    made = []

    def stop_before_drawing(sources, title):
        made.extend(sources)
        raise UsageError("far enough", title)

    monkeypatch.setattr("host.submission.contents.build_submission", stop_before_drawing)
    options = ("--exclude", "3,2", "--because", "the cable pulled", "--out", tmp_path / "submission.zip")
    assert "far enough" in rotdrift_here("report", recordings[0], *options).stderr
    (source,) = made
    files = {f"trials/a/{name}": content for name, content in source.files().items()}
    (again,) = sources_in(files).values()
    left_out = again.choices.options(None).excluded
    assert [(item.step, item.reason) for item in left_out] == [(1, "the cable pulled"), (2, "the cable pulled")]
    with pytest.raises(ValueError, match="excluded_cycles"):
        sources_in(files | {"trials/a/choices.json": b'{"excluded_cycles": [0]}'})


def test_a_report_of_several_trials_leaves_nothing_out(recordings, tmp_path):
    done = rotdrift_here(
        "report", *recordings, "--exclude", "3", "--because", "late", "--out", tmp_path / "submission.zip"
    )
    assert "--exclude is for one trial" in done.stderr
