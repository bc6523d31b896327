"""The ends of a window as a person gives them: seconds, or markers set during the capture."""

from __future__ import annotations

import argparse
import math
import re
from typing import TypeAlias

from host.errors import UsageError
from host.recording.load import RecordedTrial
from host.trial.operator import MARKER

Bound: TypeAlias = float | str | None
"""Seconds since the first sample; ``m3`` for the third marker; None for the end of the recording."""

Window: TypeAlias = tuple[Bound, Bound]
"""Start and end."""


def parse_bound(text: str) -> float | str:
    """Return the value of ``--from`` or ``--to``; for argparse.

    Raises
    ------
    argparse.ArgumentTypeError
        Neither seconds nor a marker.
    """
    if re.fullmatch(r"m[0-9]{1,5}", text):
        return text
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise argparse.ArgumentTypeError(f"{text!r} is neither seconds (12.5) nor a marker (m1)")
    return seconds


def resolve_window(window: Window | None, trial: RecordedTrial | None) -> tuple[float | None, float | None] | None:
    """Return a window with markers replaced by their times.

    Parameters
    ----------
    window : (from, to) or None
        As given.
    trial : RecordedTrial or None
        The recording; None where it is not ours and has no markers.

    Returns
    -------
    (from, to) or None
        Seconds since the first sample.

    Raises
    ------
    UsageError
        There is no such marker; names those there are.
    """
    if window is None:
        return None
    times_s = {} if trial is None else marker_times_s(trial)
    return _resolved(window[0], times_s), _resolved(window[1], times_s)


def marker_times_s(trial: RecordedTrial) -> dict[str, float]:
    """Return the markers of a recording: the operator's m1, m2, …; where there is none, the object's by their value.

    Returns
    -------
    dict
        Name to seconds since the first sample.
    """
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
