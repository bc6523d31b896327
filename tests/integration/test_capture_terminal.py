"""The live screen in a real terminal of 80 x 24: what is seen while it runs, keys, and what is left when it ends."""

import json
import re
import signal
import sys

import pytest

from tests.command_line import quick_scenario, rotdrift_here

pytest.importorskip("pexpect")
pytest.importorskip("pyte")
if sys.platform == "win32":
    pytest.skip("needs a pseudo-terminal", allow_module_level=True)

from host.capture.playback import recorded_actions
from host.virtual_object_process import VirtualObjectProcess
from tests.terminal_run import Terminal
from tests.waiting import wait_for


@pytest.fixture
def virtual(tmp_path):
    with VirtualObjectProcess(quick_scenario(tmp_path)) as process:
        yield process


def result_of(recording):
    return json.loads(recording.with_suffix(".json").read_text())


def test_the_demonstration_shows_the_drift_grow_and_gives_the_terminal_back(tmp_path):
    terminal = Terminal(["demo", "--scenario", quick_scenario(tmp_path), "--cycles", 8], tmp_path)
    terminal.wait_for_cycles(2)
    for part in ("rotation drift θ̄ per cycle, so far", "virtual cube", "✓ connected", "Hz of 200", "none of"):
        terminal.wait_for(part)
    assert "\x1b[?1049h" in terminal.raw
    assert terminal.finish() == 0
    assert "true θ̄ = 0.400°" in terminal.after
    assert "rotdrift-trials/" in terminal.after
    assert terminal.raw.rindex("\x1b[?25h") > terminal.raw.rindex("\x1b[?25l")


def test_ctrl_c_in_the_terminal_ends_the_demonstration_in_order_without_colour(tmp_path):
    terminal = Terminal(["demo", "--scenario", quick_scenario(tmp_path)], tmp_path, NO_COLOR="1")
    terminal.wait_for_cycles(4)
    terminal.process.sendintr()
    assert terminal.finish() == 0
    assert "true θ̄ = 0.400°" in terminal.raw
    assert not re.search(r"\x1b\[(\d+;)*(3[0-8]|4[0-8]|9[0-7])(;\d+)*m", terminal.raw)
    assert [path.suffix for path in sorted((tmp_path / "rotdrift-trials").iterdir())] == [".json", ".mcap"]


def test_every_key_does_its_work_is_recorded_and_scoring_honours_it(tmp_path, virtual):
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
    before = terminal.modes_before
    terminal.wait_for_cycles(2)
    assert terminal.modes() != before  # keys come one by one now
    terminal.press("m")
    terminal.wait_for("marker 1")
    terminal.press("nthe hand squeaks\r")
    terminal.wait_for("the hand squeaks")
    terminal.press("?")
    terminal.wait_for("Every key is an event")
    terminal.press("?")
    terminal.press("s")
    terminal.wait_for("trial window: from")
    terminal.wait_for_cycles(4)
    terminal.press("x")
    asked = terminal.wait_for("because:")
    cycle = int(re.search(r"leave out cycle (\d+)", asked)[1])
    terminal.press("slipped\r")
    terminal.wait_for("left out:")
    terminal.press("p")
    terminal.wait_for("PAUSED")
    terminal.press("p")
    terminal.wait_for_cycles(6)
    terminal.press("q")
    assert terminal.finish() == 0
    assert terminal.modes() == before
    assert "live " in terminal.after
    assert "differs by" in terminal.after
    kinds = [action.kind for action in recorded_actions(recording)]
    assert kinds == ["marker", "note", "help", "window-start", "exclude", "pause", "resume", "finish"]
    result = result_of(recording)
    assert [item["text"] for item in result["operator"] if item["kind"] == "note"] == ["the hand squeaks"]
    assert [item["reason"] for item in result["excluded_cycles"]] == ["slipped"]
    assert result["window"]["source"] == "the operator, during the capture"
    first = result["endpoints"][0]
    assert first["time_s"] + 0.5 * first["dwell_s"] >= result["window"]["from_s"] > 0  # its dwell touches the window
    assert cycle > 2
    assert any(event["kind"] == "MARKER" for event in result["events"])  # the object was told as well
    again = json.loads(rotdrift_here("score", recording, "--json").stdout)
    assert again["theta_bar_deg"] == result["theta_bar_deg"]
    assert again["excluded_cycles"] == result["excluded_cycles"]


def test_a_terminal_that_takes_nothing_stops_nobody(tmp_path, virtual):
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording, "--duration", 5], tmp_path, 200, 60)
    terminal.wait_for_raw("\x1b[?1049h", 1)
    # Nothing is read from here on, and the terminal's own buffer holds a few KiB: less than a picture or two.
    written = recording.with_suffix(".json")
    wait_for(lambda: written.exists() and written.read_text().endswith("}\n"), "the result of a stalled capture")
    result = result_of(recording)
    assert result["losses"]["missing"] == 0
    assert result["capture"]["ended"] == "5 s are over"
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.005)
    assert terminal.finish() == 0
    assert terminal.modes() == terminal.modes_before


def test_ctrl_z_steps_aside_and_the_capture_goes_on(tmp_path, virtual):
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
    terminal.wait_for_cycles(2)
    terminal.press("\x1a")
    terminal.wait_for("The capture goes on")
    terminal.process.kill(signal.SIGTSTP)  # and from outside: not followed while it captures
    size = recording.stat().st_size
    wait_for(lambda: recording.stat().st_size > size + 20_000, "a growing recording")
    terminal.press(" ")
    terminal.wait_for_raw("\x1b[?1049h", 2)
    terminal.wait_for_cycles(3)
    terminal.process.kill(signal.SIGTERM)
    assert terminal.finish() == 0
    assert terminal.modes() == terminal.modes_before
    assert result_of(recording)["losses"]["missing"] == 0


def test_a_guided_trial_up_to_an_interval_then_a_key(tmp_path):
    # More cycles than the interval needs: on a busy machine the guide may see late that the hand turns.
    scenario = quick_scenario(tmp_path, cycles=16, lead_in_s=4.0)
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(scenario) as virtual:
        terminal = Terminal(
            ["capture", virtual.link, "--out", recording, "--guide", "--rest", 0.8, "--until", "ci=0.5deg", "--bell"],
            tmp_path,
        )
        terminal.wait_for("any key ends")  # the steps before it may pass between two pictures
        assert "the result" in terminal.text
        assert "\a" in terminal.raw
        terminal.press("k")
        assert terminal.finish() == 0
    steps = [action.text for action in recorded_actions(recording) if action.kind == "guide"]
    assert steps == ["start the hand", "let it turn", "stop the hand, hold still", "done"]
    assert result_of(recording)["capture"]["ended"] == "the guided trial is complete"
    terminal = Terminal(["replay", recording, "--speed", 20, "--ascii"], tmp_path, 120, 36)
    assert terminal.finish() == 0
    assert "rotdrift replay" in terminal.raw
    assert "theta" in terminal.raw
    assert "offset +-" in terminal.raw  # bounded by the round trips of then
    assert "differs by" in terminal.after


def test_two_objects_on_one_screen(tmp_path, virtual):
    with VirtualObjectProcess(quick_scenario(tmp_path, "other", seed=7)) as other:
        terminal = Terminal(["capture", virtual.link, other.link, "--out", tmp_path / "trial.mcap"], tmp_path, 120, 36)
        seen = terminal.wait_for("▶  1")
        terminal.wait_for_cycles(4)
        assert "▶  1" in seen
        terminal.press("f")
        terminal.wait_for("▶  2")
        terminal.press("m")
        terminal.wait_for("marker 1")
        terminal.press("q")
        assert terminal.finish() == 0
    first, second = (tmp_path / f"trial-{number}.mcap" for number in (1, 2))
    assert result_of(first)["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)
    assert result_of(second)["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)
    assert "marker" not in [action.kind for action in recorded_actions(first)]
    assert "marker" in [action.kind for action in recorded_actions(second)]
