"""Two objects on one CAN bus, captured at once: each has its own recording and result, one screen shows both."""

import threading

import pytest

from host.capture.settings import CaptureSettings
from host.capture.several import capture_several
from host.recording.load import load_trial
from host.screen.dashboard.picture import View, picture
from host.screen.keys import ScreenAction
from host.screen.screens import QuietScreen
from tests.can_link_run import object_on
from tests.command_line import quick_scenario

pytest.importorskip("can")

DRIFT_DEG = {"cube": 0.4, "ball": 2.0}


class BothScreen(QuietScreen):
    """Keeps the last state of each object, and presses one key for the second."""

    def __init__(self):
        super().__init__()
        self.states = {}
        self._pressed = False

    def update(self, state, index=0):
        self.states[index] = state

    def actions(self):
        second = self.states.get(1)
        if self._pressed or second is None or second.score.n_cycles < 1:
            return []
        self._pressed = True
        return [ScreenAction("note", 1, "only the ball")]


def scenario_of(folder, name, number):
    path = quick_scenario(folder, name, device=f'name = "{name}"\ndevice_id = {number}')
    text = (folder / f"{name}.toml").read_text().replace("angle_deg = 0.4", f"angle_deg = {DRIFT_DEG[name]}")
    (folder / f"{name}.toml").write_text(text)
    return path


def test_two_nodes_of_one_bus_are_two_objects(tmp_path, request):
    bus = f"can:virtual:{request.node.name}"
    paths = [tmp_path / "trial-1.mcap", tmp_path / "trial-2.mcap"]
    screen = BothScreen()
    with (
        object_on(f"{bus}?node=3", scenario_of(tmp_path, "cube", 1)) as (first, _),
        object_on(f"{bus}?node=9", scenario_of(tmp_path, "ball", 2)) as (second, _),
    ):
        outcomes = capture_several([first, second], paths, CaptureSettings(cycles=4), screen, threading.Event())
    for outcome, (name, drift_deg) in zip(outcomes, DRIFT_DEG.items(), strict=True):
        assert outcome.error is None
        assert outcome.exit_code == 0
        assert outcome.result.object.name == name
        assert outcome.result.theta_bar_deg == pytest.approx(drift_deg, abs=0.01)
        losses = outcome.result.losses
        assert losses.produced == losses.received + losses.missing
    # Each recording holds the whole bus; scoring it again finds its own object by the node of its link.
    for path, outcome in zip(paths, outcomes, strict=True):
        assert load_trial(path).info.name == outcome.result.object.name
    assert [[action.kind for action in load_trial(path).actions] for path in paths] == [[], ["note"]]
    lines = [line.plain for line in picture((screen.states[0], screen.states[1]), View(focus=1), 80, 24)]
    cube, ball = (next(line for line in lines if line[5:9] == name) for name in DRIFT_DEG)
    assert "0.40°" in cube
    assert "2.00°" in ball
    assert ball.startswith("▶  2 ")
    assert "rotdrift capture · ball" in lines[0]
