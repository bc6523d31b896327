"""Where the operator's keys meet the capture: each is recorded as an event, and some change the running score."""

from __future__ import annotations

from collections.abc import Callable

from host.screen.keys import ScreenAction
from host.trial import operator as did
from host.trial.live import Trial
from host.trial.operator import OperatorAction
from host.trial.running_score import RunningScore
from host.trial.state import OperatorMark, WindowView

MAX_MARKS = 20
"""Markers and notes kept for the screen."""


class OperatorDesk:
    """Carries out the operator's actions in one capture: edits its running score, records them, has markers sent."""

    def __init__(
        self,
        trial: Trial,
        record: Callable[[OperatorAction], None] = lambda _: None,
        send_marker: Callable[[int], None] = lambda _: None,
    ) -> None:
        self._trial = trial
        self._record = record
        self._send_marker = send_marker
        self._n_markers = 0
        self._window_open = False  # known here: the recorded window must not depend on the running score
        self.marks: tuple[OperatorMark, ...] = ()
        """The last markers and notes."""

    def process(self, action: ScreenAction) -> None:
        """Do what was asked for; an action that makes no sense now does nothing."""
        score, now_s = self._trial.score, self._trial.newest_s
        cycle = action.cycle
        if action.kind == "marker":
            self._n_markers += 1
            self._do(OperatorAction(did.MARKER, now_s, f"marker {self._n_markers}"))
            self._send_marker(self._n_markers)
        elif action.kind == "note":
            self._do(OperatorAction(did.NOTE, now_s, action.text))
        elif action.kind == "window":
            kind, self._window_open = did.WINDOW_STOP if self._window_open else did.WINDOW_START, not self._window_open
            self._do(OperatorAction(kind, now_s))
        elif action.kind == "exclude" and cycle is not None:
            times_s = score.ask(lambda running: running.leave_out(cycle, action.text), None)
            self._record_cycle(did.EXCLUDE, times_s, action.text)
        elif action.kind == "include" and cycle is not None:
            self._record_cycle(did.INCLUDE, score.ask(lambda running: running.take_back(cycle), None))
        else:
            self._record(OperatorAction(action.kind, now_s, action.text))

    def repeat(self, action: OperatorAction) -> None:
        """Do again what a recorded capture's operator did: for the replay."""
        if action.kind in {did.MARKER, did.NOTE}:
            self.marks = (*self.marks, OperatorMark(action.time_s, action.text))[-MAX_MARKS:]
        else:
            self._trial.score.ask(lambda score: _edit(score, action), None)

    def _do(self, action: OperatorAction) -> None:
        self.repeat(action)
        self._record(action)

    def _record_cycle(self, kind: str, times_s: tuple[float, float] | None, text: str = "") -> None:
        if times_s is not None:
            self._record(OperatorAction(kind, self._trial.newest_s, text, *times_s))


def _edit(score: RunningScore, action: OperatorAction) -> None:
    """Change a running score as a recorded action states; actions that are no edits change nothing."""
    if action.kind == did.WINDOW_START:
        score.set_window(WindowView(action.time_s, None))
    elif action.kind == did.WINDOW_STOP:
        score.set_window(WindowView(None if score.window is None else score.window.from_s, action.time_s))
    elif action.kind in {did.EXCLUDE, did.INCLUDE}:
        number = score.number_at(action.from_s, action.to_s)
        if number is not None and action.kind == did.EXCLUDE:
            score.leave_out(number, action.text)
        elif number is not None:
            score.take_back(number)
