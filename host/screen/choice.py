"""Which screen a capture gets: a live one where there is a terminal, one plain line per cycle elsewhere."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TextIO

from host.output.drawings import open_console
from host.output.lines import error_stream, output_stream
from host.screen.dashboard.theme import Theme
from host.screen.live_screen import LiveScreen
from host.screen.screens import LineScreen, Screen
from host.screen.terminal import in_foreground


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
    """Return the screen for a capture whose person may be looking at ``stream``, by default standard output.

    With ``json_output`` that belongs to a JSON object, and lines go to standard error.
    """
    if json_output:
        return LineScreen(error_stream())
    stream = stream or output_stream()
    choice = choice or ScreenChoice()
    console = open_console(stream)
    lines = choice.plain_lines or not console.is_terminal or console.is_dumb_terminal or not stream.isatty()
    if lines or not in_foreground(stream.fileno()):
        return LineScreen(stream)
    background = os.environ.get("COLORFGBG", "").rpartition(";")[2]  # without one, a terminal counts as dark
    theme = Theme(
        ascii_only=choice.ascii_only or _shows_ascii_only(os.environ) or not _can_show("θ█⣿", stream),
        light=choice.theme == "light" or (choice.theme == "auto" and background in {"7", "15"}),
        color=None if console.no_color else console.color_system,
    )
    return LiveScreen(stream, LineScreen(stream), theme, choice.bell)


def _shows_ascii_only(environment: Mapping[str, str]) -> bool:
    """Return whether the terminal is Linux's bare console, whose font has no braille, or the locale is C.

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
    """Return whether the encoding of a stream has some characters."""
    try:
        characters.encode(stream.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
