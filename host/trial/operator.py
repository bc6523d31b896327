"""What the operator did during a capture, as events of the recording, and what of it changes the score.

Every key is recorded. Three of them are edits that scoring honours: the trial window, and cycles left out or taken
back in. They name times on the time axis of the samples, so that they mean the same in every later scoring.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from analysis.scoring.result_parts import ExcludedCycle
from host.text import plain

MARKER, NOTE = "marker", "note"
WINDOW_START, WINDOW_STOP = "window-start", "window-stop"
EXCLUDE, INCLUDE = "exclude", "include"
GUIDE = "guide"
MAX_TEXT = 500


@dataclass(frozen=True, slots=True)
class OperatorAction:
    """One thing the operator did."""

    kind: str
    """:data:`MARKER`, :data:`NOTE`, ... or the name of a key of the screen (``finish``, ``pause``, ...)."""
    time_s: float
    """Newest sample at that moment, s since the first; NaN before it."""
    text: str = ""
    """What was typed, or which marker it was."""
    from_s: float = math.nan
    """End point at the start of the cycle that is meant, s; NaN where no cycle is."""
    to_s: float = math.nan
    """End point at its end, s."""

    def values(self) -> dict[str, Any]:
        """Return the values of its message in a recording."""
        return asdict(self) | {"text": plain(self.text, MAX_TEXT)}


def action_of(values: dict[str, Any]) -> OperatorAction:
    """Return the action in the values of a message."""
    return OperatorAction(
        kind=plain(values["kind"], 40),
        time_s=float(values["time_s"]),
        text=plain(values["text"], MAX_TEXT),
        from_s=float(values["from_s"]),
        to_s=float(values["to_s"]),
    )


@dataclass(frozen=True, slots=True)
class OperatorEdits:
    """What of the operator's actions changes the score."""

    window: tuple[float | None, float | None] | None = None
    """(from, to), s since the first sample; None where everything counts."""
    excluded: tuple[ExcludedCycle, ...] = ()
    """Cycles left out, oldest first."""


def edits_of(actions: Iterable[OperatorAction]) -> OperatorEdits:
    """Put the actions of a recording, in their order, together: the last word on window and cycles counts."""
    window: tuple[float | None, float | None] | None = None
    excluded: dict[tuple[float, float], ExcludedCycle] = {}
    for action in actions:
        if action.kind == WINDOW_START and math.isfinite(action.time_s):
            window = (action.time_s, None)
        elif action.kind == WINDOW_STOP and math.isfinite(action.time_s):
            window = (None if window is None else window[0], action.time_s)
        elif action.kind == EXCLUDE and math.isfinite(action.from_s + action.to_s):
            excluded[action.from_s, action.to_s] = ExcludedCycle(action.from_s, action.to_s, action.text)
        elif action.kind == INCLUDE:
            excluded.pop((action.from_s, action.to_s), None)
    return OperatorEdits(window, tuple(excluded[key] for key in sorted(excluded)))
