"""θ̄ in large figures, its interval, a small drift path, and below them the verdicts: what a glance must tell."""

from __future__ import annotations

import textwrap

from rich.text import Text

from analysis.scoring.interval import MIN_STEPS
from host.screen.dashboard.boxes import Lines, beside, block, framed
from host.screen.dashboard.canvas import big_text
from host.screen.dashboard.drift_path import net_deg, small_path
from host.screen.dashboard.theme import Look, Part
from host.trial.state import TrialState

HEIGHT = 5
TEXT_WIDTH, ASCII_TEXT_WIDTH = 44, 48
"""Room that the sentences want beside the figures."""
SILENCE_S = 1.0
"""So long without a sample is worth a word."""
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


def verdicts(state: TrialState) -> list[Part]:
    """Answer each question in a few words, with a sign that says the same as the colour; none once it is finished."""
    if state.finished:
        return []
    answers = (None if state.replayed else _connected(state), _finds_cycles(state), _trust(state), _enough(state))
    return [answer for answer in answers if answer is not None]


def missing(state: TrialState) -> str:
    """Say in a few words what a trustworthy score still needs; empty when nothing is missing."""
    needed = MIN_STEPS - state.n_cycles
    if needed > 0:
        return f"needs {needed} more cycle{'s' if needed > 1 else ''}"
    target = state.target_half_width_deg
    if target is not None and state.half_width_deg is not None and state.half_width_deg > target:
        if state.more_cycles is None:
            return f"±{target:g}° is out of reach"
        return f"needs {state.more_cycles} more for ±{target:g}°"
    return ""


def _good(words: str) -> Part:
    return f"✓ {words}", "good"


def _wait(words: str) -> Part:
    return f"… {words}", "plain"


def _look(words: str, meaning: str = "doubtful") -> Part:
    return f"! {words}", meaning


def _connected(state: TrialState) -> Part:
    link = state.link
    if not link.connected:
        return _look("DISCONNECTED", "bad")
    if link.silent_s > SILENCE_S:
        return _look(f"silent for {link.silent_s:.0f} s", "bad")
    return _wait("no data yet") if state.sensor.orientation_wxyz is None else _good("connected")


def _finds_cycles(state: TrialState) -> Part | None:
    if any(alarm.kind == "no cycles" for alarm in state.alarms):
        return _look("no cycles found", "bad")
    if not state.cycles:
        return None if state.sensor.orientation_wxyz is None else _wait("no cycles yet")
    return _wait("the hand rests") if "pause" in state.motion.flags else _good("cycles")


def _trust(state: TrialState) -> Part | None:
    kinds = {alarm.kind for alarm in state.alarms} - {"link", "no cycles"}
    if kinds:
        return _look("below the floor" if kinds == {"floor"} else "see the alarm", "bad")
    if state.theta_bar_deg is None:
        return None
    floor_deg = state.sensor.floor_deg
    if floor_deg is None:
        return _look("floor unknown")
    return _good("above the floor") if state.theta_bar_deg > floor_deg else _wait("below the floor so far")


def _enough(state: TrialState) -> Part | None:
    wanted = missing(state)
    if wanted:
        out_of_reach = state.n_cycles >= MIN_STEPS and state.more_cycles is None
        return _look(wanted) if out_of_reach else _wait(wanted)
    if state.guide is not None:  # it says itself when to stop
        return None
    if state.target_half_width_deg is not None:
        return _good(f"±{state.target_half_width_deg:g}° reached")
    left = 0 if state.target_cycles is None else state.target_cycles - state.n_cycles
    if left > 0:
        return _wait(f"{left} cycle{'s' if left > 1 else ''} to go")
    return _good("enough to score")
