"""θ̄ in large figures, its interval, what is still missing, and a small drift path."""

from __future__ import annotations

from rich.text import Text

from analysis.uncertainty import MIN_STEPS
from host.big_digits import big_text
from host.dashboard.boxes import Lines, beside, block, framed
from host.dashboard.drift_path import path_plot
from host.dashboard.look import Look
from host.trial_state import TrialState

HEIGHT = 5
TEXT_WIDTH = 50
"""Room that the sentences want beside the figures."""

MAX_PATH = 28
"""Width of the small drift path, cells."""


def score_panel(state: TrialState, look: Look, width: int, small_path: bool) -> Lines:
    """Draw the score.

    Parameters
    ----------
    state : TrialState
        The moment.
    look : Look
        Colours and characters.
    width : int
        Of the frame; the height is :data:`HEIGHT`.
    small_path : bool
        Whether to draw the drift path at the right, where there is room.
    """
    number = "-.--" if state.theta_bar_deg is None else f"{state.theta_bar_deg:.2f}"
    meaning = "good" if state.finished else "number"
    digits = [Text(line, look.styles[meaning], end="") for line in big_text(f"{number}°", look.ascii_only)]
    digits_width = max(digit.cell_len for digit in digits) + 3
    inner = width - 4
    words = [_kind(state, look), _interval(state, look), _progress(state, look)]
    words_width = inner - digits_width
    parts = [block(digits, digits_width, 3, look)]
    path_width = min(MAX_PATH, words_width - TEXT_WIDTH)
    if small_path and path_width >= 7:
        parts += [block(words, words_width - path_width, 3, look), path_plot(state, look, path_width, 3, labels=False)]
    else:
        parts.append(block(words, words_width, 3, look))
    name = state.sensor.name or "sensorized object"
    return framed(beside(*parts), f"{state.title} · {name}", width, HEIGHT, look, "accent")


def _kind(state: TrialState, look: Look) -> Text:
    if state.finished:
        return look.join(("rotation drift θ̄ per cycle: the result", "strong"))
    return look.join(("rotation drift θ̄ so far, per cycle", "strong"))


def _interval(state: TrialState, look: Look) -> Text:
    if state.finished and state.summary:
        return look.text(state.summary)
    if state.interval_deg is None:
        return look.join((f"95 % interval: {missing(state) or 'none'}", "quiet"))
    low, high = state.interval_deg
    half = "" if state.half_width_deg is None else f" (±{state.half_width_deg:.2f}°)"
    return look.join(f"95 % interval {low:.2f}° to {high:.2f}°{half}")


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


def _progress(state: TrialState, look: Look) -> Text:
    minutes, seconds = divmod(int(state.elapsed_s), 60)
    target = "" if state.target_cycles is None else f" of {state.target_cycles}"
    plural = "" if state.n_cycles == 1 and not target else "s"
    until = "" if state.target_s is None else f" of {state.target_s:.0f} s"
    line = look.join(f"{state.n_cycles}{target} cycle{plural} · {minutes:02d}:{seconds:02d}{until}")
    words = "" if state.finished or state.interval_deg is None else missing(state)
    if words:
        line.append_text(look.join((f" · {words}", "strong")))
    left_out = sum(1 for row in state.cycles if row.excluded and row.number)
    if left_out:
        line.append_text(look.join((f" · {left_out} left out", "doubtful")))
    return line
