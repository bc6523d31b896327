"""θ̄ in large figures, its interval, a small drift path, and below them the verdicts."""

from __future__ import annotations

import textwrap

from rich.text import Text

from analysis.uncertainty import MIN_STEPS
from host.dashboard.big_digits import big_text
from host.dashboard.boxes import Lines, beside, block, framed
from host.dashboard.drift_path import net_deg, small_path
from host.dashboard.look import Look, Part
from host.dashboard.verdicts import verdicts
from host.trial_state import TrialState

HEIGHT = 5
TEXT_WIDTH, ASCII_TEXT_WIDTH = 44, 48
"""Room that the sentences want beside the figures."""
MIN_PATH, MAX_PATH = 7, 28
"""Width of the small drift path, cells."""


def score_panel(state: TrialState, look: Look, width: int, with_path: bool) -> Lines:
    """Draw the score.

    Parameters
    ----------
    state : TrialState
        The moment.
    look : Look
        Colours and characters.
    width : int
        Of the frame; the height is :data:`HEIGHT`.
    with_path : bool
        Whether to draw the drift path at the right, where there is room.
    """
    number = "-.--" if state.theta_bar_deg is None else f"{state.theta_bar_deg:.2f}"
    meaning = "good" if state.finished else "number"
    digits = [Text(line, look.styles[meaning], end="") for line in big_text(f"{number}°", look.ascii_only)]
    digits_width = max(digit.cell_len for digit in digits) + 3
    inner = width - 4
    room = inner - digits_width
    path_width = min(MAX_PATH, room - (ASCII_TEXT_WIDTH if look.ascii_only else TEXT_WIDTH) - 1)
    refused = state.finished and state.theta_bar_deg is None  # then the reason needs the room
    net = net_deg(state) if with_path and path_width >= MIN_PATH and not refused else None
    parts = [block(digits, digits_width, 3, look)]
    if net is not None:
        room -= path_width + 1
        parts += [block(_words(state, look, room), room + 1, 3, look), small_path(state, look, path_width, 3)]
    else:
        parts.append(block(_words(state, look, room), room, 3, look))
    name = " · ".join(part for part in (state.title, state.sensor.name or "sensorized object") if part)
    since = "" if net is None else f"since the start {net:.1f}°"
    return framed(beside(*parts), name, width, HEIGHT, look, "accent", since, _foot(state, look, inner - 2))


def _foot(state: TrialState, look: Look, width: int) -> Text:
    """Write the verdicts; where there is no room for all, whether it can be trusted is left to the lines below."""
    answers = verdicts(state)
    while True:
        foot = look.listed(answers, between=" - " if look.ascii_only else " ─ ")
        if foot.cell_len <= width or not answers:
            return foot
        del answers[-2 if len(answers) > 2 else -1]


def _words(state: TrialState, look: Look, width: int) -> Lines:
    """Write the three lines beside the figures."""
    if not state.finished:
        return [
            look.text("rotation drift θ̄ per cycle, so far", "strong"),
            _interval(state, look),
            _progress(state, look, width),
        ]
    if state.theta_bar_deg is None:
        why = textwrap.wrap(look.words(state.summary.removeprefix("no score: ")), max(20, width))
        if len(why) > 2:
            why[1] = look.words(f"{why[1][: width - 1]}…")
        return [look.text("the result: no score", "strong"), *(look.text(line, "doubtful") for line in why[:2])]
    title = look.text(f"the result: rotation drift θ̄ of {_cycles(state)}", "strong")
    return [title, _interval(state, look), look.text(state.summary)]


def _interval(state: TrialState, look: Look) -> Text:
    if state.interval_deg is None:
        from_when = "none" if state.n_cycles >= MIN_STEPS else f"from {MIN_STEPS} cycles on"
        return look.text(f"95 % interval: {from_when}", "quiet")
    low, high = state.interval_deg
    places = 2 if high - low >= 0.04 else 3  # never "0.40° to 0.40°"
    half = "" if state.half_width_deg is None else f" (±{state.half_width_deg:.{places}f}°)"
    return look.text(f"95 % interval {low:.{places}f}° to {high:.{places}f}°{half}")


def _cycles(state: TrialState) -> str:
    target = "" if state.target_cycles is None or state.finished else f" of {state.target_cycles}"
    return f"{state.n_cycles}{target} cycle{'' if state.n_cycles == 1 and not target else 's'}"


def _progress(state: TrialState, look: Look, width: int) -> Text:
    minutes, seconds = divmod(int(state.elapsed_s), 60)
    until = "" if state.target_s is None else f" of {state.target_s:.0f} s"
    left_out = sum(1 for row in state.cycles if row.excluded and row.number)
    parts: list[Part] = [
        _cycles(state),
        (f"{left_out} left out" if left_out else "", "doubtful"),
        f"{minutes:02d}:{seconds:02d}{until}",
    ]
    return look.listed(parts, width)
