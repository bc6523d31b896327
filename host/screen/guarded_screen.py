"""A screen that may fail: the terminal is released, and lines go on."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TypeVar

from host.output.lines import error_stream
from host.screen.keys import ScreenAction
from host.screen.screens import LineScreen, Screen
from host.trial.guarded import Guarded
from host.trial.state import CycleRow, TrialState

R = TypeVar("R")


class GuardedScreen(Screen):
    """Hands everything to a screen until that fails, from then on to plain lines on standard error.

    What the failed call was to show is shown in lines as well, so nothing is missing. If lines fail too, nothing is
    shown any more.
    """

    def __init__(self, screen: Screen) -> None:
        self._failures: list[str] = []
        self._screen = Guarded("the screen", screen, self._failures, "lines on standard error take its place")
        self._lines = Guarded("standard error", LineScreen(error_stream()), self._failures, "nothing is shown any more")

    @property
    def problems(self) -> tuple[str, ...]:
        """What failed of this screen, and of the one behind it."""
        nothing: tuple[str, ...] = ()
        behind = self._screen.ask(lambda screen: screen.problems, nothing)
        return (*behind, *self._failures)

    def start(self) -> None:
        """Start the screen."""
        self._show(lambda screen: screen.start())

    def update(self, state: TrialState, index: int = 0) -> None:
        """Show the present state."""
        self._show(lambda screen: screen.update(state, index))

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Show a cycle."""
        self._show(lambda screen: screen.cycle(row, index))

    def report(self, sentence: str) -> None:
        """Show a sentence."""
        self._show(lambda screen: screen.report(sentence))

    def actions(self) -> list[ScreenAction]:
        """Return what a person asked for; nothing once the screen has failed."""
        nothing: list[ScreenAction] = []
        return self._ask(lambda screen: screen.actions(), nothing)

    def hold(self, timeout_s: float) -> bool:
        """Wait for a key, at most so long."""
        return self._ask(lambda screen: screen.hold(timeout_s), True)

    def stop(self) -> None:
        """Release the terminal."""
        self._show(lambda screen: screen.stop())

    def _show(self, use: Callable[[Screen], None]) -> None:
        self._ask(use, None)

    def _ask(self, use: Callable[[Screen], R], otherwise: R) -> R:
        if self._screen.works:
            answer = self._screen.ask(use, otherwise)
            if self._screen.works:
                return answer
            with contextlib.suppress(Exception):  # the terminal is needed for Ctrl-C; it prints what was reported, too
                self._screen.subject.stop()
        return self._lines.ask(use, otherwise)


def guarded(screen: Screen) -> GuardedScreen:
    """Return a screen that never ends what it shows."""
    return screen if isinstance(screen, GuardedScreen) else GuardedScreen(screen)
