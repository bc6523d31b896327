"""Several objects at once: a capture each, in threads, one screen for all."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.scoring.result import Result
from host.capture.run import FinishedCapture, run_capture
from host.capture.settings import CaptureSettings
from host.errors import HostError, InternalError
from host.results.result import ScoreOptions
from host.screen.guarded_screen import guarded
from host.screen.keys import ScreenAction
from host.screen.screens import Screen
from host.trial.state import CycleRow, TrialState

PAUSE_S = 0.001
"""For every other object, a link rests so long after a read on which more followed: all of them together are then read
some two thousand times a second, however fast they send."""


@dataclass(frozen=True, slots=True)
class ObjectOutcome:
    """How the capture of one of several objects ended."""

    link: str
    finished: FinishedCapture | None
    """None where there is nothing to score."""
    error: HostError | None

    @property
    def exit_code(self) -> int:
        """As of a capture of this object alone."""
        if self.error is not None:
            return self.error.exit_code
        return 0 if self.finished is not None and self.finished.score.valid else 1

    @property
    def result(self) -> Result | None:
        """The score; None where there is nothing to score."""
        return None if self.finished is None else self.finished.score


class _SharedScreen:
    """One screen for several captures: hands every capture the keys that are meant for it."""

    def __init__(self, screen: Screen, stop: threading.Event) -> None:
        self.screen = screen
        self._stop = stop
        self._lock = threading.Lock()
        self._waiting: dict[int, list[ScreenAction]] = defaultdict(list)

    def actions(self, index: int) -> list[ScreenAction]:
        with self._lock:
            for action in self.screen.actions():
                self._waiting[action.index].append(action)
                if action.kind == "finish":
                    self._stop.set()  # it ends them all
            return self._waiting.pop(index, [])


class _ObjectScreen(Screen):
    """The screen as one of the captures sees it: it neither starts nor stops what others use."""

    def __init__(self, shared: _SharedScreen, index: int) -> None:
        self._shared = shared
        self._index = index

    @property
    def problems(self) -> tuple[str, ...]:
        return self._shared.screen.problems

    def update(self, state: TrialState, index: int = 0) -> None:
        del index  # ours is the one that counts
        self._shared.screen.update(state, self._index)

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        del index
        self._shared.screen.cycle(row, self._index)

    def report(self, sentence: str) -> None:
        self._shared.screen.report(f"object {self._index + 1}: {sentence}")

    def actions(self) -> list[ScreenAction]:
        return self._shared.actions(self._index)

    def hold(self, timeout_s: float) -> bool:
        return self._shared.screen.hold(timeout_s)


def capture_several(
    links: Sequence[str],
    recordings: Sequence[Path],
    settings: CaptureSettings,
    screen: Screen,
    stop: threading.Event,
    options: ScoreOptions | None = None,
) -> list[ObjectOutcome]:
    """Capture several objects with the same settings, and return how each went; one that fails leaves the others alone.

    Parameters
    ----------
    links : sequence of str
        URIs; nodes of one CAN bus are links with different ``?node=``.
    recordings : sequence of Path
        One for each.
    screen : Screen
        Started and stopped here.
    stop : threading.Event
        Ends them all.
    """
    settings = replace(settings, read_pause_s=PAUSE_S * (len(links) - 1))
    screen = guarded(screen)
    shared = _SharedScreen(screen, stop)
    outcomes = [ObjectOutcome(link, None, HostError("the capture failed")) for link in links]

    def capture(index: int) -> None:
        mine = _ObjectScreen(shared, index)
        try:
            finished = run_capture(links[index], recordings[index], settings, mine, stop, options)
            outcomes[index] = ObjectOutcome(links[index], finished, finished.outcome.error)
        except Exception as raised:  # noqa: BLE001 - the others go on, and this one is reported with them
            error = raised if isinstance(raised, HostError) else InternalError(raised)
            outcomes[index] = ObjectOutcome(links[index], None, error)
            mine.report(str(error))

    screen.start()
    names = [f"rotdrift-object-{number}" for number in range(1, len(links) + 1)]
    threads = [threading.Thread(target=capture, args=(index,), name=name) for index, name in enumerate(names)]
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        stop.set()
        screen.stop()
    return outcomes
