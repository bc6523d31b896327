"""Keys to actions, actions to edits, edits to the score: live, from the recording, and again."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from analysis.cycles.settings import Endpoint
from analysis.geometry import averages, rotations
from analysis.scoring.card import rotation_drift
from analysis.scoring.interval import drift_interval, steps_needed
from analysis.scoring.result_parts import ExcludedCycle
from analysis.series import SeriesError
from host.capture.operator_desk import OperatorDesk
from host.screen.dashboard.picture import View
from host.screen.keys import KeyReader, ScreenAction
from host.trial import operator as did
from host.trial.live import Trial
from host.trial.operator import OperatorAction, action_of, edits_of
from host.trial.running_score import RunningScore
from host.trial.state import OUTSIDE, CycleRow, RecordingView, ScoreView, TrialState, WindowView

ROW = CycleRow(4, 20.0, 4.0, 0.8, None, 0.8)
RUNNING = (TrialState(score=ScoreView(n_endpoints=5, cycles=(ROW,))),)


def press(keys, states=RUNNING, reader=None):
    reader = reader or KeyReader(View())
    actions = []
    for key in keys:
        actions += reader.press(key, states)
    return reader, actions


def poses(n, step_deg=0.8, wild=None):
    rng = np.random.default_rng(5)
    quats = [np.array([1.0, 0.0, 0.0, 0.0])]
    for k in range(1, n):
        angle = math.radians(8.0 if k == wild else step_deg)
        step = angle * np.array([0.0, 0.6, 0.8]) + rng.normal(0, 0.001, 3)
        quats.append(rotations.multiply(rotations.exp(step), quats[-1]))
    return np.array(quats)


def filled(quats):
    score = RunningScore(0.05)
    for k, quat in enumerate(quats):
        score.enter(Endpoint(4.0 * k, k, quat, 0.1, 30.0))
    return score


def test_a_note_is_typed_corrected_and_sent():
    reader, actions = press(["n", "h", "e", "x", "\x7f", "y", "ä", "\r"])
    assert actions == [ScreenAction("note", 0, "heyä")]
    assert reader.view.prompt == ""
    assert press(["n", "\r"])[1] == []
    assert press(["n", "a", "\x1b", "m"])[1] == [ScreenAction("marker")]
    assert press(["nhello\r"])[1] == [ScreenAction("note", 0, "hello")]


def test_keys_typed_into_a_note_do_nothing_else():
    reader, actions = press(["n", "q", "x", "s"])
    assert actions == []
    assert reader.view.typed == "qxs"


def test_excluding_names_the_cycle_on_the_screen_when_the_key_was_pressed():
    reader = KeyReader(View())
    reader.press("x", RUNNING)
    later = (TrialState(score=ScoreView(n_endpoints=6, cycles=(ROW, replace(ROW, number=5)))),)
    actions = [action for key in "oops\r" for action in reader.press(key, later)]
    assert actions == [ScreenAction("exclude", 0, "oops", 4)]
    left_out = (TrialState(score=ScoreView(n_endpoints=5, cycles=(replace(ROW, excluded="oops"),))),)
    assert press(["x"], left_out)[1] == [ScreenAction("include", 0, "", 4)]
    reader, actions = press(["x"], (TrialState(),))
    assert actions == []
    assert reader.view.message == "no cycle yet"


def test_focus_pause_help_and_finish():
    reader, actions = press(["f", "p", "?", "p", "f", "q"], RUNNING * 2)
    assert [action.kind for action in actions] == ["focus", "pause", "help", "resume", "focus", "finish"]
    assert [action.index for action in actions] == [1, 1, 1, 1, 0, 0]
    assert reader.view.help_open
    assert press(["f"])[1] == []
    assert press(["\x1b[A", "\x1bOP"])[1] == []
    reader, actions = press(["\x1a"])
    assert reader.aside
    assert [action.kind for action in actions] == ["aside"]
    press(["q"], reader=reader)
    assert not reader.aside
    assert press(["a"], (TrialState(score=ScoreView(finished=True)),))[1] == [ScreenAction("close")]


def test_a_replay_is_only_shown():
    replayed = (replace(RUNNING[0], recording=RecordingView(replayed=True)),)
    reader, actions = press("mnsx", replayed)
    assert actions == []
    assert (reader.view.prompt, reader.view.message) == ("", "a recording is only shown")
    assert [action.kind for action in press("p?q", replayed)[1]] == ["pause", "help", "finish"]


def test_while_one_of_several_goes_on_the_keys_work():
    states = (TrialState(score=ScoreView(finished=True)), RUNNING[0])
    assert [action.kind for action in press("fq", states)[1]] == ["focus", "finish"]
    assert [action.kind for action in press("q", (states[0], states[0]))[1]] == ["close"]


def test_special_keys_and_pastes_are_no_keys():
    paste = "\x1b[200~quit, now\r\nor x\x1b[201~"
    junk = (
        "\x1b[A",
        "\x1bOP",
        "\x1b[<0;12;7M",
        "\x1b[1;5C",
        "\x1bq",
        "\x1b[",
        "1;2q",
        "\x1bO",
        "q",
        "\x00\x07\x9b\ufffd",
    )
    reader, actions = press([paste, *junk])
    assert actions == []
    assert reader.view.prompt == ""
    # A key before and one after in the same reading count.
    assert [action.kind for action in press([f"m{paste}m\x1b[Am"])[1]] == ["marker"] * 3
    # Into a note a paste goes as one line, in whatever pieces it comes, and an arrow key does not end the typing.
    reader, actions = press(["n", "a ", "\x1b[D", paste[:9], paste[9:-2], paste[-2:], "!\r"])
    assert actions == [ScreenAction("note", 0, "a quit, now or x!")]
    assert press(["n", "\x1b[200~" + "x" * 500 + "\x1b[201~", "\r"])[1][0].text == "x" * 200
    assert press(["\x1b[" + "1" * 100, "m"])[1] == [ScreenAction("marker")]


def test_an_action_survives_its_message():
    from host.recording import format as fmt

    for action in (OperatorAction(did.EXCLUDE, 9.0, "slipped, “hard”", 4.0, 8.0), OperatorAction("finish", 3.5)):
        again = action_of(fmt.TYPES[fmt.ACTION].decode(fmt.TYPES[fmt.ACTION].encode(action.values())))
        assert repr(again) == repr(action)


def test_the_last_word_counts():
    actions = [
        OperatorAction(did.WINDOW_START, 3.0),
        OperatorAction(did.EXCLUDE, 9.0, "a", 4.0, 8.0),
        OperatorAction(did.EXCLUDE, 13.0, "b", 8.0, 12.0),
        OperatorAction(did.INCLUDE, 14.0, "", 4.0, 8.0),
        OperatorAction(did.WINDOW_STOP, 50.0),
        OperatorAction(did.NOTE, 51.0, "x"),
    ]
    edits = edits_of(actions)
    assert edits.window == (3.0, 50.0)
    assert edits.excluded == (ExcludedCycle(8.0, 12.0, "b"),)
    assert edits_of([*actions, OperatorAction(did.WINDOW_START, 60.0)]).window == (60.0, None)
    assert edits_of([OperatorAction(did.EXCLUDE, 1.0), OperatorAction(did.WINDOW_STOP, 5.0)]).window == (None, 5.0)


def test_a_left_out_step_does_not_count_but_stays():
    quats = poses(9, wild=5)
    whole, without = rotation_drift(quats), rotation_drift(quats, [4])
    assert len(without.steps_deg) == 8
    assert len(without.counted_step_rotations_wxyz) == 7
    kept = np.delete(whole.step_rotations_wxyz, 4, axis=0)
    assert without.theta_bar_rad == pytest.approx(float(rotations.angle(averages.average(kept))))
    assert without.theta_bar_deg == pytest.approx(0.8, abs=0.1)
    assert whole.theta_bar_deg > 1.5
    with pytest.raises(SeriesError, match="cannot be left out"):
        rotation_drift(quats, [8])
    with pytest.raises(SeriesError, match="every step"):
        rotation_drift(quats[:2], [0])


def test_the_running_score_honours_exclusion_and_window():
    quats = poses(9, wild=5)
    score = filled(quats)
    assert score.theta_bar_deg == rotation_drift(quats).theta_bar_deg
    assert score.leave_out(5, "slipped") == (16.0, 20.0)
    assert score.theta_bar_deg == rotation_drift(quats, [4]).theta_bar_deg
    assert score.n_endpoints == 8
    assert score.rows[5].excluded == "slipped"
    assert score.leave_out(99, "") is None
    assert score.take_back(5) == (16.0, 20.0)
    assert score.take_back(5) is None
    assert score.theta_bar_deg == rotation_drift(quats).theta_bar_deg
    score.set_window(WindowView(7.0, 21.0))
    assert score.theta_bar_deg == rotation_drift(quats[2:6]).theta_bar_deg
    assert [bool(row.excluded) for row in score.rows] == [True, True, True, False, False, False, True, True, True]
    assert score.rows[0].excluded == OUTSIDE
    assert score.n_endpoints == 4


def test_steps_needed_follow_the_interval_s_own_formula():
    interval = drift_interval(rotation_drift(poses(12)).step_rotations_wxyz)
    needed = steps_needed(interval, interval.half_width_deg / 2)
    assert 12 < needed < 60
    assert steps_needed(interval, interval.half_width_deg * 1.0001) <= 11
    assert steps_needed(interval, 1e-9) is None
    from scipy import stats

    scale = interval.standard_error_deg * math.sqrt(11)

    def half(m):
        return stats.t.ppf(0.975, m - 1) * scale / math.sqrt(m)

    assert half(needed) <= interval.half_width_deg / 2 < half(needed - 1)


def test_the_desk_records_every_action():
    recorded, marked = [], []
    trial = Trial()
    for k, quat in enumerate(poses(6)):
        trial.score.subject.enter(Endpoint(4.0 * k, k, quat, 0.1, 30.0))
    desk = OperatorDesk(trial, recorded.append, marked.append)
    kinds = ("marker", "pause", "resume", "focus", "help", "window", "window", "marker")
    for kind in kinds:
        desk.process(ScreenAction(kind))
    desk.process(ScreenAction("note", 0, "hello"))
    desk.process(ScreenAction("exclude", 0, "bad", 3))
    desk.process(ScreenAction("include", 0, "", 3))
    desk.process(ScreenAction("exclude", 0, "none such", 77))
    desk.process(ScreenAction("finish"))
    assert marked == [1, 2]
    assert [action.kind for action in recorded] == [
        *("marker", "pause", "resume", "focus", "help", "window-start", "window-stop", "marker"),
        *("note", "exclude", "include", "finish"),
    ]
    assert (recorded[9].from_s, recorded[9].to_s) == (8.0, 12.0)
    assert [mark.text for mark in desk.marks] == ["marker 1", "marker 2", "hello"]


def test_actions_come_back_only_once_and_only_to_their_object():
    from host.capture.several import _ObjectScreen, _SharedScreen
    from host.screen.screens import QuietScreen

    class Pressed(QuietScreen):
        waiting = (ScreenAction("marker", 1), ScreenAction("marker", 0), ScreenAction("finish", 1))

        def actions(self):
            taken, self.waiting = list(self.waiting), ()
            return taken

    stop = threading.Event()
    shared = _SharedScreen(Pressed(), stop)
    first, second = _ObjectScreen(shared, 0), _ObjectScreen(shared, 1)
    assert [action.kind for action in first.actions()] == ["marker"]
    assert [action.kind for action in second.actions()] == ["marker", "finish"]
    assert first.actions() == second.actions() == []
    assert stop.is_set()
