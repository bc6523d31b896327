"""What the operator did during a capture counts in later scorings; ``--ignore-actions`` shows the untouched score."""

import json

import pytest

from host.recording import format as fmt
from host.recording.writer import RecordingWriter
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
