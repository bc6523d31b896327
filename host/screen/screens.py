"""Who watches a capture: a live screen where there is a terminal, one plain line per cycle elsewhere."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TextIO

from rich.console import Console

from host.screen.dashboard.theme import terminal_is_light
from host.screen.keys import ScreenAction
from host.screen.live_screen import LiveScreen
from host.screen.pipe import ScreenSettings
from host.screen.terminal import in_foreground
from host.text import plain
from host.trial.state import CycleRow, TrialState

__all__ = ["LineScreen", "LiveScreen", "QuietScreen", "Screen", "ScreenChoice", "open_screen"]


class Screen(Protocol):
    """What a capture tells of itself while it runs; no method waits for the terminal longer than it takes to print."""

    def start(self) -> None:
        """Begin."""

    def update(self, state: TrialState, index: int = 0) -> None:
        """Take the present state (of one of several objects); drawn when it is time."""

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Tell of a cycle; ``index`` says of which object, where there are several."""

    def say(self, sentence: str) -> None:
        """Tell a person something once."""

    def actions(self) -> list[ScreenAction]:
        """Give what a person asked for since the last call."""

    def hold(self, timeout_s: float) -> bool:
        """Wait until a person has seen the result and pressed a key; True at once where there is no person."""

    def stop(self) -> None:
        """Give the terminal back."""


class QuietScreen:
    """Shows nothing; keeps what was said."""

    def __init__(self) -> None:
        self.said: list[str] = []

    def start(self) -> None:
        """Begin."""

    def update(self, state: TrialState, index: int = 0) -> None:
        """Ignore the state."""

    def cycle(self, row: CycleRow, index: int | None = None) -> None:
        """Ignore the cycle."""

    def say(self, sentence: str) -> None:
        """Keep the sentence."""
        self.said.append(sentence)

    def actions(self) -> list[ScreenAction]:
        """Give nothing: there are no keys."""
        return []

    def hold(self, timeout_s: float) -> bool:
        """Go on: there is nobody to wait for."""
        del timeout_s
        return True

    def stop(self) -> None:
        """End."""


class LineScreen:
    """One plain line per cycle, sentence and new alarm.

    Parameters
    ----------
    stream : text file
        Where the lines go.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._alarms: dict[int, set[str]] = {}

    def start(self) -> None:
        """Begin."""

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

    def say(self, sentence: str) -> None:
        """Print the sentence."""
        self._print(plain(sentence, 1000))

    def actions(self) -> list[ScreenAction]:
        """Give nothing: there are no keys."""
        return []

    def hold(self, timeout_s: float) -> bool:
        """Go on: there is nobody to wait for."""
        del timeout_s
        return True

    def stop(self) -> None:
        """End."""

    def _print(self, line: str) -> None:
        try:
            print(line, file=self._stream, flush=True)
        except (BrokenPipeError, ValueError):
            # Whoever read this has gone; the capture goes on.
            self._stream = io.StringIO()


@dataclass(frozen=True, slots=True)
class ScreenChoice:
    """How a person wants the screen."""

    ascii_only: bool = False
    """Only ASCII; also chosen where the terminal cannot show anything else."""
    theme: str = "auto"
    """``dark``, ``light``, or ``auto``: by ``COLORFGBG``."""
    bell: bool = False
    """Ring at every alarm and at the end."""
    plain_lines: bool = False
    """One line per cycle even where there is a terminal."""


def open_screen(json_output: bool, stream: TextIO | None = None, choice: ScreenChoice | None = None) -> Screen:
    """Choose how a capture shows itself.

    Parameters
    ----------
    json_output : bool
        Standard output belongs to a JSON object: lines go to standard error.
    stream : text file, optional
        Where a person may be looking; standard output by default.
    choice : ScreenChoice, optional
        What the person asked for.
    """
    if json_output:
        return LineScreen(sys.stderr)
    stream = stream or sys.stdout
    choice = choice or ScreenChoice()
    console = Console(file=stream)
    lines = choice.plain_lines or not console.is_terminal or console.is_dumb_terminal or not stream.isatty()
    if lines or not in_foreground(stream.fileno()):
        return LineScreen(stream)
    light = choice.theme == "light" or (choice.theme == "auto" and terminal_is_light(os.environ.get("COLORFGBG")))
    settings = ScreenSettings(
        ascii_only=choice.ascii_only or _shows_ascii_only(os.environ) or not _can_show("θ█⣿", stream),
        light=light,
        color=None if console.no_color else console.color_system,
        bell=choice.bell,
    )
    return LiveScreen(stream, LineScreen(stream), settings)


def _shows_ascii_only(environment: Mapping[str, str]) -> bool:
    """Whether the terminal is Linux's bare console, whose font has no braille, or the locale is C.

    Python itself would use UTF-8 in the C locale.
    """
    if environment.get("TERM") == "linux":
        return True
    if environment.get("PYTHONUTF8") == "1":
        return False
    names = [environment.get(name, "") for name in ("LC_ALL", "LC_CTYPE", "LANG")]
    if names[1] == "C.UTF-8" and names[2] in {"C", "POSIX"}:  # set by Python as it started
        names[1] = ""
    return next((name for name in names if name), "") in {"C", "POSIX"}


def _can_show(characters: str, stream: TextIO) -> bool:
    """Whether the encoding of a stream has some characters."""
    try:
        characters.encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
