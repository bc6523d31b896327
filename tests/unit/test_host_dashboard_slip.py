"""A slip and an interval that touches 0, as the running score and the dashboard show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from scipy.spatial.transform import Rotation

from analysis.cycles.settings import Endpoint
from host.screen.dashboard.picture import picture
from host.screen.dashboard.theme import View
from host.trial.running_score import RunningScore
from host.trial.state import WindowView
from tests.unit.dashboard_states import RUNNING


def shown(state) -> str:
    console = Console(width=100, height=30, color_system=None)
    with console.capture() as drawn:
        for line in picture((state,), View(), 100, 30):
            console.print(line)
    return drawn.get()


@pytest.fixture
def score():
    """Nine steps of 0.4°, the fifth one of 8°."""
    running = RunningScore()
    angles = np.cumsum([0.0, 0.4, 0.5, 0.4, 0.45, 8.0, 0.4, 0.5, 0.4, 0.4])
    quats = Rotation.from_rotvec(np.radians(angles)[:, None] * [0.0, 0.6, 0.8]).as_quat(scalar_first=True)
    for k, quat in enumerate(quats):
        running.enter(Endpoint(4.0 * k, k, quat, 0.5, 40.0))
    return running


def test_a_slip_is_named_by_its_cycle(score):
    assert score.slip.startswith("slip: the step of cycle 5 is 8.00° where 0.40° is usual, and makes 70% of θ̄")
    score.leave_out(5, "bumped")
    assert score.slip == ""
    score.take_back(5)
    assert "cycle 5" in score.slip


def test_in_a_window_it_keeps_the_number_of_its_row(score):
    score.set_window(WindowView(8.0, None))
    assert "the step of cycle 5 is 8.00°" in score.slip
    score.set_window(WindowView(20.0, None))
    assert score.slip == ""


def test_the_dashboard_shows_it(score):
    text = shown(replace(RUNNING, score=replace(RUNNING.score, slip=score.slip)))
    assert "slip: the step of cycle 5 is 8.00°" in text
    assert "no steady creep" in " ".join(text.split())
    assert "slip" not in shown(RUNNING)


def test_the_dashboard_puts_an_interval_that_touches_zero_into_words():
    text = shown(replace(RUNNING, score=replace(RUNNING.score, interval_deg=(0.0, 1.01))))
    assert "cannot be distinguished from no drift: the interval touches 0" in text
    assert "distinguished" not in shown(RUNNING)
