"""Who watches a capture: a live screen where there is a terminal, one plain line per cycle elsewhere."""

from __future__ import annotations

import io
import sys
from typing import Protocol, TextIO

from rich.console import Console
from rich.live import Live

from host.dashboard import render
from host.plain_text import plain
from host.trial_state import CycleRow, TrialState

FRAMES_PER_SECOND = 8.0


class Screen(Protocol):
    """What a capture tells of itself while it runs; no method waits for the terminal longer than it takes to print."""

    def start(self) -> None:
        """Begin."""

    def update(self, state: TrialState) -> None:
        """Take the present state; drawn when it is time."""

    def cycle(self, row: CycleRow) -> None:
        """Tell of a cycle."""

    def say(self, sentence: str) -> None:
        """Tell a person something once."""

    def stop(self) -> None:
        """Give the terminal back."""


class QuietScreen:
    """Shows nothing; keeps what was said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def start(self) -> None:
        """Begin."""

    def update(self, state: TrialState) -> None:
        """Ignore the state."""

    def cycle(self, row: CycleRow) -> None:
        """Ignore the cycle."""

    def say(self, sentence: str) -> None:
        """Keep the sentence."""
        self.said.append(sentence)

    def stop(self) -> None:
        """End."""


class LineScreen:
    """One plain line per cycle and sentence.

    Parameters
    ----------
    stream : text file
        Where the lines go.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def start(self) -> None:
        """Begin."""

    def update(self, state: TrialState) -> None:
        """Ignore the state: it is for screens."""

    def cycle(self, row: CycleRow) -> None:
        """Print one line."""
        parts = [f"cycle {row.number:3d}" if row.number else "start    ", f"{row.time_s:8.2f} s"]
        if row.period_s is not None:
            parts.append(f"period {row.period_s:6.3f} s")
        if row.step_deg is not None:
            parts.append(f"step {row.step_deg:7.3f}°")
        if row.theta_bar_deg is not None:
            parts.append(f"θ̄ {row.theta_bar_deg:7.3f}°")
        if row.flags:
            parts.append(", ".join(row.flags))
        self._print("  ".join(parts))

    def say(self, sentence: str) -> None:
        """Print the sentence."""
        self._print(plain(sentence, 1000))

    def stop(self) -> None:
        """End."""

    def _print(self, line: str) -> None:
        try:
            print(line, file=self._stream, flush=True)
        except (BrokenPipeError, ValueError):
            # Whoever read this has gone; the capture goes on.
            self._stream = io.StringIO()


class LiveScreen:
    """The dashboard, drawn by a thread of its own from the last state it was given.

    Parameters
    ----------
    console : Console
        On a terminal.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._state = TrialState()
        self._said: list[str] = []
        self._live = Live(
            get_renderable=lambda: render(self._state),
            console=console,
            screen=True,
            auto_refresh=True,
            refresh_per_second=FRAMES_PER_SECOND,
            redirect_stdout=False,
            redirect_stderr=False,
        )

    def start(self) -> None:
        """Take the terminal."""
        self._live.start(refresh=True)

    def update(self, state: TrialState) -> None:
        """Keep the state for the next frame."""
        self._state = state

    def cycle(self, row: CycleRow) -> None:
        """Ignore the cycle: it is in the state."""

    def say(self, sentence: str) -> None:
        """Keep the sentence for when the terminal is free again; the state's warnings show it meanwhile."""
        self._said.append(plain(sentence, 1000))

    def stop(self) -> None:
        """Give the terminal back, then print what was said."""
        self._live.stop()
        for sentence in self._said:
            self._console.print(sentence, markup=False, highlight=False)
        self._said.clear()


def open_screen(json_output: bool, stream: TextIO | None = None) -> Screen:
    """Choose how a capture shows itself.

    Parameters
    ----------
    json_output : bool
        Standard output belongs to a JSON object: lines go to standard error.
    stream : text file, optional
        Where a person may be looking; standard output by default.
    """
    if json_output:
        return LineScreen(sys.stderr)
    stream = stream or sys.stdout
    console = Console(file=stream)
    if console.is_terminal and not console.is_dumb_terminal and stream.isatty():
        return LiveScreen(console)
    return LineScreen(stream)
