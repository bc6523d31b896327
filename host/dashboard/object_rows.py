"""Several objects at once: a line for each, one in focus."""

from __future__ import annotations

from host.dashboard.boxes import Lines
from host.dashboard.look import Look, Part
from host.trial_state import TrialState

MAX_OBJECTS = 16
"""More lines than this are not shown; the focus still reaches every object."""


def object_rows(states: tuple[TrialState, ...], focus: int, look: Look, width: int, height: int) -> Lines:
    """Draw a line per object; nothing where there is only one.

    Parameters
    ----------
    states : tuple of TrialState
        One per object.
    focus : int
        Which of them is shown whole.
    look : Look
        Colours and characters.
    width : int
        Of the line: what does not fit is left out.
    height : int
        How many lines there may be; the one in focus is among them.
    """
    if len(states) < 2:
        return []
    room = max(1, min(height, MAX_OBJECTS, len(states)))
    first = min(max(0, focus - room // 2), len(states) - room)
    lines: Lines = []
    for index in range(first, first + room):
        state = states[index]
        sign = (">" if look.ascii_only else "▶") if index == focus else " "
        theta = "    - " if state.theta_bar_deg is None else f"{state.theta_bar_deg:6.2f}"
        rate = "-" if state.link.rate_hz is None else f"{state.link.rate_hz:.0f} Hz"
        name = state.sensor.name or "sensorized object"
        trouble = state.alarms[0].kind if state.alarms else "" if state.link.connected else "DISCONNECTED"
        line = look.join(
            (f"{sign} {index + 1:2} ", "strong" if index == focus else "plain"),
            f"{name[:16]:16} θ̄ {theta}° {state.n_cycles:4} {'cycle ' if state.n_cycles == 1 else 'cycles'} {rate:>8}  ",
        )
        parts: list[Part] = [
            (f"ALARM {trouble}" if trouble else "", "bad"),
            "finished" if state.finished else state.motion.phase,
            (state.link.name, "quiet"),
        ]
        lines.append(line.append_text(look.listed(parts, width - line.cell_len)))
    return lines
