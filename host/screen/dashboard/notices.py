"""What wants attention: the guide's step, alarms, notes, the trial window, and the line of keys."""

from __future__ import annotations

import textwrap

from rich.text import Text

from analysis.scoring.interval import NO_DRIFT
from host.screen.dashboard.boxes import Lines, end_of, framed
from host.screen.dashboard.theme import Theme, View
from host.trial.state import Alarm, TrialState

KEYS = (
    ("m", "marker", "put a marker here"),
    ("n", "note", "type a note"),
    ("s", "window", "start or stop the trial window: only end points inside count"),
    ("x", "exclude", "leave the last cycle out, with a reason; again: take it back in"),
    ("f", "focus", "show the next object"),
    ("p", "pause", "hold the picture still; the capture goes on"),
    ("?", "help", "show this"),
    ("q", "finish", "end the capture in order and score it"),
)
"""Key, its name in the bottom line, and what it does."""
EDITING = "mnsx"
"""Keys of whoever runs the trial: none of them is for a replay."""
MAX_NOTICES = 4


def guide_lines(state: TrialState, theme: Theme, width: int) -> Lines:
    """Draw the step of a guided trial, framed; nothing without a guide."""
    guide = state.guide
    if guide is None:
        return []
    full, empty = ("#", ".") if theme.ascii_only else ("█", "░")
    cells = max(4, min(20, width // 4))
    done = round(cells * min(1.0, max(0.0, guide.progress)))
    line = theme.join(
        (f"{guide.title}  ", "strong"), (full * done + empty * (cells - done), "accent"), f"  {guide.hint}"
    )
    return framed([line], f"step {guide.number} of {guide.n_steps}", width, 3, theme, "accent")


def notice_lines(state: TrialState, theme: Theme, width: int) -> Lines:
    """Draw alarms, then warnings, then the trial window and the last mark; at most :data:`MAX_NOTICES` lines.

    Where there are many, each alarm has one line: none hides another.
    """
    wrapped = [_alarm_lines(alarm, theme, width) for alarm in state.alarms]
    if sum(map(len, wrapped)) > MAX_NOTICES:
        wrapped = [_alarm_lines(alarm, theme, 500) for alarm in state.alarms]
    lines: Lines = [line for alarm in wrapped for line in alarm]
    if len(lines) > MAX_NOTICES:
        others = ", ".join(alarm.kind for alarm in state.alarms[MAX_NOTICES - 1 :])
        return [*lines[: MAX_NOTICES - 1], theme.text(f"ALARM also: {others}", "bad")]
    warnings = list(state.warnings)
    if state.recording.problem and state.recording.problem not in warnings:
        warnings.append(state.recording.problem)
    for warning in reversed(warnings):
        lines += [theme.text(line, "doubtful") for line in _wrapped(theme.words(f"! {warning}"), width)[:2]]
    if state.score.slip:
        lines += [theme.text(line, "doubtful") for line in _wrapped(theme.words(f"! {state.score.slip}"), width)[:2]]
    interval_deg = state.score.interval_deg
    if interval_deg is not None and interval_deg[0] <= 0.0:
        lines.append(theme.text(f"θ̄ {NO_DRIFT}: the interval touches 0", "doubtful"))
    window = state.score.window
    if window is not None:
        start = "the beginning" if window.from_s is None else f"{window.from_s:.1f} s"
        end = "now on" if window.to_s is None else f"to {window.to_s:.1f} s"
        lines.append(theme.text(f"trial window: from {start} {end}", "accent"))
    if state.marks:
        mark = state.marks[-1]
        lines.append(theme.text(f"at {mark.time_s:.1f} s: {mark.text}", "quiet"))
    return lines[:MAX_NOTICES]


def _wrapped(words: str, width: int) -> list[str]:
    return textwrap.wrap(words, max(20, width - 1), subsequent_indent="  ")


def _alarm_lines(alarm: Alarm, theme: Theme, width: int) -> Lines:
    head = f"ALARM {alarm.kind}:"
    first, *rest = _wrapped(theme.words(f"{head} {alarm.sentence}"), width)
    line = theme.text(first)
    line.stylize(theme.styles["bad"], 0, len(head))
    return [line, *(theme.text(more) for more in rest[:1])]


def bottom_line(view: View, states: tuple[TrialState, ...], focus: int, width: int) -> Text:
    """Draw what is being typed, or the keys that mean something now."""
    theme, state = view.theme, states[focus]
    if view.prompt:
        asked, ends = f"{view.prompt}: ", "  (Enter, Esc)"
        typed = end_of(view.typed, max(8, width - len(asked) - len(ends) - 1), theme)
        return theme.join((asked, "strong"), typed, ("_", "accent"), (ends, "quiet"))
    if all(other.score.finished for other in states):
        return theme.join(("finished", "good"), ("" if state.guide is None else "  any key ends", "quiet"))
    line = theme.join(("finished  " if state.score.finished else "", "good"))
    if view.paused:
        what = "replay" if state.recording.replayed else "capture"
        line.append_text(theme.join((f"PAUSED, the {what} goes on  ", "doubtful")))
    if view.message:
        line.append_text(theme.join((f"{view.message}  ", "accent")))
    keys = [
        (key, name)
        for key, name, _ in KEYS
        if (key != "f" or len(states) > 1) and not (state.recording.replayed and key in EDITING)
    ]
    return line.append_text(_key_line(keys, theme, width - line.cell_len))


def _key_line(keys: list[tuple[str, str]], theme: Theme, width: int) -> Text:
    """Name the keys; where there is little room closer together, then without their names but the last two."""
    gap = 2 if sum(len(key) + len(name) + 3 for key, name in keys) - 2 <= width else 1
    named = keys if sum(len(key) + len(name) + 2 for key, name in keys) - 1 <= width else keys[-2:]
    line = Text(no_wrap=True, end="")
    for key, name in keys:
        its_name = f" {name}" if (key, name) in named else ""
        line.append_text(theme.join((key, "strong"), (f"{its_name}{' ' * gap}", "quiet")))
    line.rstrip()
    return line


def help_lines(theme: Theme, width: int, height: int) -> Lines:
    """Draw the help."""
    lines = [theme.join((f"{key:4}", "strong"), what) for key, _, what in KEYS]
    lines += [
        theme.join(("^Z  ", "strong"), "step aside: the old screen shows, the capture goes on; any key returns"),
        theme.join(("^C  ", "strong"), "as q"),
        theme.text(""),
        theme.text("Every key is an event of the recording; scores honour window and exclusions.", "quiet"),
        theme.text("What is left out stays in the recording and in the result, with its reason.", "quiet"),
        theme.text("θ̄ is the angle of the average step; the interval says how far to trust it.", "quiet"),
    ]
    return framed(lines, "keys", width, height, theme, "accent")
