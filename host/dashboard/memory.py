"""Drawings that change with a cycle only are drawn once a cycle, not with every picture: most of a picture's cost."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from host.dashboard.boxes import Lines
from host.dashboard.look import Look
from host.trial_state import CycleRow, Quaternion, TrialState

Drawing = Callable[[TrialState, Look, int, int], Lines]
_Key = tuple[Quaternion | None, bool, bool, Look, int, int]
KEPT = 16
"""Drawings remembered of each kind: enough for several objects."""


def once_a_cycle(drawing: Drawing) -> Drawing:
    """Remember what a drawing of cycles gave; the result is the same, only sooner.

    Parameters
    ----------
    drawing : callable
        Of state, look, width and height. Of the state it may look at the cycles, the origin, and whether there is data
        and movement at all.
    """
    kept: deque[tuple[tuple[CycleRow, ...], _Key, Lines]] = deque(maxlen=KEPT)

    def remembered(state: TrialState, look: Look, width: int, height: int) -> Lines:
        has_data = state.sensor.orientation_wxyz is not None
        key = (state.origin_wxyz, has_data, state.motion.at_rest, look, width, height)
        for cycles, known, lines in kept:
            # The very same cycles: to compare hundreds would cost as much as to draw them.
            if cycles is state.cycles and known == key:
                return lines
        lines = drawing(state, look, width, height)
        kept.append((state.cycles, key, lines))
        return lines

    return remembered
