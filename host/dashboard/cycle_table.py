"""One line per cycle: when, how long, how far it missed, about which axis, what is odd about it."""

from __future__ import annotations

from rich.text import Text

from host.dashboard.boxes import Lines, block
from host.dashboard.look import Look
from host.trial_state import CycleRow, TrialState

AXIS_WIDTH, NARROW_AXIS_WIDTH = 17, 14
MIN_BAR, MAX_BAR = 6, 40
_FIXED = 42
"""Cells of the columns that always have the same width, with the spaces between them."""
_FLAGS = 13
"""Cells kept for flags."""


def cycle_table(state: TrialState, look: Look, width: int, height: int) -> Lines:
    """Draw the newest cycles that fit.

    Parameters
    ----------
    state : TrialState
        The moment.
    look : Look
        Colours and characters.
    width, height : int
        Of the rectangle, heading included.
    """
    axis_width = 0
    if width >= _FIXED + NARROW_AXIS_WIDTH + MIN_BAR + _FLAGS:
        axis_width = AXIS_WIDTH if width >= _FIXED + AXIS_WIDTH + MIN_BAR + 3 * _FLAGS else NARROW_AXIS_WIDTH
    bar = min(MAX_BAR, max(MIN_BAR, width - _FIXED - _FLAGS - axis_width))
    head = f"{'cycle':>6}{'time':>10}{'period':>9}{'step':>8} {'':{bar}}{look.words('θ̄'):>{_theta_width(look)}} "
    lines = [look.text(head + (" axis of step" if axis_width else ""), "strong")]
    rows = state.cycles[-max(1, height - 1) :]
    longest = max((row.step_deg or 0.0 for row in state.cycles), default=0.0)
    lines += [_line(row, longest, bar, axis_width, look) for row in rows]
    if not rows:
        lines.append(look.text(f"  {_waiting(state)}", "quiet"))
    return block(lines, width, height, look)


def _theta_width(look: Look) -> int:
    """Width for ``format``, which counts the bar over θ as a character of its own."""
    return 7 if look.ascii_only else 8


def _line(row: CycleRow, longest_deg: float, bar: int, axis_width: int, look: Look) -> Text:
    odd = "quiet" if row.excluded else "doubtful" if row.flags else "plain"
    share = 0.0 if row.step_deg is None or longest_deg <= 0 else row.step_deg / longest_deg
    cells = max(1 if row.step_deg else 0, round(share * bar))
    number = str(row.number) if row.number else "start"
    period = "" if row.period_s is None else f"{row.period_s:.3f} s"
    step = "" if row.step_deg is None else f"{row.step_deg:.3f}"
    theta = "" if row.theta_bar_deg is None else f"{row.theta_bar_deg:.3f}"
    sign = ("x" if look.ascii_only else "┄") if row.excluded else "━"
    parts: list[str | tuple[str, str]] = [
        (f"{number:>6}{row.time_s:>8.2f} s{period:>9}", "quiet" if row.excluded else "plain"),
        (f"{step:>8} ", odd),
        (f"{sign * cells:{bar}}", odd if odd != "plain" else "accent"),
        f"{theta:>7} ",
    ]
    if axis_width:
        places = 2 if axis_width == AXIS_WIDTH else 1
        axis = "" if row.step_axis is None else " ".join(f"{part:+.{places}f}" for part in row.step_axis)
        parts.append((f" {axis:{axis_width - 1}}", "quiet"))
    if row.excluded:
        parts.append((f" left out: {row.excluded}", "doubtful"))
    elif row.flags:
        parts.append((f" {', '.join(row.flags)}", "doubtful"))
    return look.join(*parts)


def _waiting(state: TrialState) -> str:
    if state.sensor.orientation_wxyz is None:
        return "no data yet"
    return "waiting for cycles"
