"""What a glance must tell: whether it is connected, finds cycles, can be trusted, and may be ended."""

from __future__ import annotations

from analysis.uncertainty import MIN_STEPS
from host.dashboard.look import Part
from host.trial_state import TrialState

SILENCE_S = 1.0
"""So long without a sample is worth a word."""


def verdicts(state: TrialState) -> list[Part]:
    """Answer each question in a few words, with a sign that says the same as the colour; none once it is finished."""
    if state.finished:
        return []
    answers = (None if state.replayed else _connected(state), _cycles(state), _trust(state), _enough(state))
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


def _cycles(state: TrialState) -> Part | None:
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
