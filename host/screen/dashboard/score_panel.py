"""θ̄ in large figures, its interval, a small drift path, and below them the verdicts: what a glance must show."""

from __future__ import annotations

import textwrap

from rich.text import Text

from analysis.scoring.interval import MIN_STEPS
from host.screen.dashboard.boxes import Lines, beside, block, framed
from host.screen.dashboard.canvas import big_text
from host.screen.dashboard.drift_path import net_deg, small_path
from host.screen.dashboard.status_panel import outage
from host.screen.dashboard.theme import Part, Theme, counted
from host.trial.state import ScoreView, TrialState

HEIGHT = 5
TEXT_WIDTH, ASCII_TEXT_WIDTH = 44, 48
"""Room that the sentences want beside the figures."""
MIN_PATH, MAX_PATH = 7, 28
"""Width of the small drift path, cells."""


def score_panel(state: TrialState, theme: Theme, width: int, with_path: bool) -> Lines:
    """Draw the score, :data:`HEIGHT` lines; ``with_path`` with the drift path at the right, where there is room."""
    score = state.score
    number = "-.--" if score.theta_bar_deg is None else f"{score.theta_bar_deg:.2f}"
    style = theme.styles["good" if score.finished else "number"]
    digits = [Text(line, style, end="") for line in big_text(f"{number}°", theme.ascii_only)]
    digits_width = max(digit.cell_len for digit in digits) + 3
    inner = width - 4
    room = inner - digits_width
    path_width = min(MAX_PATH, room - (ASCII_TEXT_WIDTH if theme.ascii_only else TEXT_WIDTH) - 1)
    refused = score.finished and score.theta_bar_deg is None  # then the reason needs the room
    net = net_deg(state) if with_path and path_width >= MIN_PATH and not refused else None
    path, gap = [], 0
    if net is not None:
        room -= path_width + 1
        path, gap = [small_path(state, theme, path_width, 3)], 1
    parts = [block(digits, digits_width, 3, theme), block(_words(state, theme, room), room + gap, 3, theme), *path]
    name = " · ".join(part for part in (state.title, state.sensor.name or "sensorized object") if part)
    since = "" if net is None else f"since the start {net:.1f}°"
    return framed(beside(*parts), name, width, HEIGHT, theme, "accent", since, _foot(state, theme, inner - 2))


def _foot(state: TrialState, theme: Theme, width: int) -> Text:
    """Return the verdicts; where there is no room for all, whether it can be trusted is left to the lines below."""
    answers = verdicts(state)
    while True:
        foot = theme.listed(answers, between=" - " if theme.ascii_only else " ─ ")
        if foot.cell_len <= width or not answers:
            return foot
        del answers[-2 if len(answers) > 2 else -1]


def _words(state: TrialState, theme: Theme, width: int) -> Lines:
    """Return the three lines beside the figures."""
    score = state.score
    if not score.finished:
        title = theme.text("rotation drift θ̄ per cycle, so far", "strong")
        return [title, _interval(score, theme), _progress(state, theme, width)]
    if score.theta_bar_deg is None:
        why = textwrap.wrap(theme.words(score.summary.removeprefix("no score: ")), max(20, width))
        if len(why) > 2:
            why[1] = theme.words(f"{why[1][: width - 1]}…")
        return [theme.text("the result: no score", "strong"), *(theme.text(line, "doubtful") for line in why[:2])]
    title = theme.text(f"the result: rotation drift θ̄ of {counted(score.n_cycles, 'cycle')}", "strong")
    return [title, _interval(score, theme), theme.text(score.summary)]


def _interval(score: ScoreView, theme: Theme) -> Text:
    if score.interval_deg is None:
        from_when = "none" if score.n_cycles >= MIN_STEPS else f"from {MIN_STEPS} cycles on"
        return theme.text(f"95 % interval: {from_when}", "quiet")
    low, high = score.interval_deg
    places = 2 if high - low >= 0.04 else 3  # never "0.40° to 0.40°"
    half = "" if score.half_width_deg is None else f" (±{score.half_width_deg:.{places}f}°)"
    return theme.text(f"95 % interval {low:.{places}f}° to {high:.{places}f}°{half}")


def _progress(state: TrialState, theme: Theme, width: int) -> Text:
    score, target = state.score, state.target
    minutes, seconds = divmod(int(state.elapsed_s), 60)
    until = "" if target.duration_s is None else f" of {target.duration_s:.0f} s"
    left_out = sum(1 for row in score.cycles if row.excluded and row.number)
    parts: list[Part] = [
        counted(score.n_cycles, "cycle") if target.cycles is None else f"{score.n_cycles} of {target.cycles} cycles",
        (f"{left_out} left out" if left_out else "", "doubtful"),
        f"{minutes:02d}:{seconds:02d}{until}",
    ]
    return theme.listed(parts, width)


def verdicts(state: TrialState) -> list[Part]:
    """Return an answer to each question, in a few words with a sign that means the same as the colour.

    Is it connected, does it find cycles, can it be trusted, is it enough? None once it is finished.
    """
    if state.score.finished:
        return []
    connected = None if state.recording.replayed else _connected(state)
    answers = (connected, _finds_cycles(state), _trust(state), _enough(state))
    return [answer for answer in answers if answer is not None]


def _connected(state: TrialState) -> Part:
    trouble = outage(state)
    if trouble:
        return (f"! {trouble}", "bad")
    return ("… no data yet", "plain") if state.sensor.orientation_wxyz is None else ("✓ connected", "good")


def _finds_cycles(state: TrialState) -> Part | None:
    if any(alarm.kind == "no cycles" for alarm in state.alarms):
        return ("! no cycles found", "bad")
    if not state.score.cycles:
        return None if state.sensor.orientation_wxyz is None else ("… no cycles yet", "plain")
    return ("… the hand rests", "plain") if "pause" in state.motion.flags else ("✓ cycles", "good")


def _trust(state: TrialState) -> Part | None:
    kinds = {alarm.kind for alarm in state.alarms} - {"link", "no cycles"}
    if kinds:
        return ("! below the floor" if kinds == {"floor"} else "! see the alarm", "bad")
    if state.score.theta_bar_deg is None:
        return None
    floor_deg = state.sensor.floor_deg
    if floor_deg is None:
        return ("! floor unknown", "doubtful")
    above = state.score.theta_bar_deg > floor_deg
    return ("✓ above the floor", "good") if above else ("… below the floor so far", "plain")


def _enough(state: TrialState) -> Part | None:
    score, target = state.score, state.target
    needed, target_deg = MIN_STEPS - score.n_cycles, target.half_width_deg
    if needed > 0:
        return (f"… needs {counted(needed, 'more cycle')}", "plain")
    if target_deg is not None and score.half_width_deg is not None and score.half_width_deg > target_deg:
        if score.more_cycles is None:
            return (f"! ±{target_deg:g}° is out of reach", "doubtful")
        return (f"… needs {score.more_cycles} more for ±{target_deg:g}°", "plain")
    if state.guide is not None:  # its own line asks for the end
        return None
    if target_deg is not None:
        return (f"✓ ±{target_deg:g}° reached", "good")
    left = 0 if target.cycles is None else target.cycles - score.n_cycles
    return (f"… {counted(left, 'cycle')} to go", "plain") if left > 0 else ("✓ enough to score", "good")
