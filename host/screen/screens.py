"""Who watches a capture: nobody, or a reader of one plain line per cycle; :mod:`host.screen.live_screen` is the third.

A screen only watches: whatever becomes of it, the capture goes on.
"""

from __future__ import annotations

import io
from typing import TextIO

from host.output.lines import write_line
from host.screen.keys import ScreenAction
from host.text import plain
from host.trial.state import CycleRow, TrialState


class Screen:
    """What a capture shows of itself while it runs; this one shows nothing.

    No method waits for the terminal longer than it takes to print.
    """

    @property
    def problems(self) -> tuple[str, ...]:
        """What failed of the screen itself, a sentence each."""
        return ()

    def start(self) -> None:
        """Show that the capture starts: the link is open."""

    def update(self, state: TrialState, index: int = 0) -> None:
        """Show the present state, of one of several objects; drawn when it is time."""

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Show a cycle; ``index`` is the object it is of, where there are several."""

    def report(self, sentence: str) -> None:
        """Show a person a sentence."""

    def actions(self) -> list[ScreenAction]:
        """Return what a person asked for since the last call."""
        return []

    def hold(self, timeout_s: float) -> bool:
        """Wait until a person has pressed a key, at most so long; True at once where there is no person."""
        del timeout_s
        return True

    def stop(self) -> None:
        """Release the terminal. May be called twice."""


class QuietScreen(Screen):
    """Shows nothing; keeps what was reported."""

    def __init__(self) -> None:
        self.reported: list[str] = []

    def report(self, sentence: str) -> None:
        """Keep the sentence."""
        self.reported.append(sentence)


class LineScreen(Screen):
    """One plain line per cycle, sentence and new alarm."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._alarms: dict[int, set[str]] = {}

    def update(self, state: TrialState, index: int = 0) -> None:
        """Print alarms that have come up; the rest of a state is for screens."""
        known = self._alarms.get(index, set())
        self._alarms[index] = {alarm.kind for alarm in state.alarms}
        whose = f"object {index + 1}  " if len(self._alarms) > 1 else ""
        for alarm in state.alarms:
            if alarm.kind not in known:
                self._print(f"{whose}ALARM {alarm.kind}: {plain(alarm.sentence, 1000)}")

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Print one line."""
        parts = [] if index is None else [f"object {index + 1}"]
        parts += [f"cycle {row.number:3d}" if row.number else "start    ", f"{row.time_s:8.2f} s"]
        if row.period_s is not None:
            parts.append(f"period {row.period_s:6.3f} s")
        if row.step_deg is not None:
            parts.append(f"step {row.step_deg:7.3f}°")
        if row.theta_bar_deg is not None:
            parts.append(f"θ̄ {row.theta_bar_deg:7.3f}°")
        if row.flags:
            parts.append(", ".join(row.flags))
        self._print("  ".join(parts))

    def report(self, sentence: str) -> None:
        """Print the sentence."""
        self._print(plain(sentence, 1000))

    def _print(self, line: str) -> None:
        try:
            write_line(line, self._stream)
        except (BrokenPipeError, ValueError):
            # Whoever read this has gone; the capture goes on.
            self._stream = io.StringIO()
