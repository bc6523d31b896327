"""The ends of a window as a person gives them: seconds, or markers set during the capture."""

from __future__ import annotations

import math
from typing import TypeAlias

from host.errors import UsageError
from host.recording.load import RecordedTrial
from host.trial.operator import MARKER

Bound: TypeAlias = float | str | None
"""Seconds since the first sample; ``m3`` for the third marker; None for the end of the recording."""

Window: TypeAlias = tuple[Bound, Bound]
"""Start and end."""


def resolve_window(window: Window, trial: RecordedTrial | None) -> tuple[float | None, float | None]:
    """Return a window with markers replaced by their times, seconds since the first sample.

    A recording that is not ours, ``trial`` None, has no markers.

    Raises
    ------
    UsageError
        There is no such marker; names those there are.
    """
    times_s = {} if trial is None else _marker_times_s(trial)
    return _resolved(window[0], times_s), _resolved(window[1], times_s)


def _marker_times_s(trial: RecordedTrial) -> dict[str, float]:
    """Return the markers of a recording: the operator's m1, m2, …; where there is none, the object's by their value."""
    pressed = [action.time_s for action in trial.actions if action.kind == MARKER]
    if pressed:
        return {f"m{number}": time_s for number, time_s in enumerate(pressed, 1) if math.isfinite(time_s)}
    origin_s = float(trial.series.times_s[0]) if len(trial.series) else 0.0
    return {f"m{event.value}": event.time_s - origin_s for event in trial.events if event.kind == "MARKER"}


def _resolved(bound: Bound, times_s: dict[str, float]) -> float | None:
    if not isinstance(bound, str):
        return bound
    if bound not in times_s:
        known = ", ".join(f"{name} at {time_s:.2f} s" for name, time_s in list(times_s.items())[:20])
        raise UsageError(f"the recording has no marker {bound}", f"it has {known}" if known else "give seconds instead")
    return times_s[bound]
