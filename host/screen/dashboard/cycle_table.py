"""A line per cycle: when, how long, how far it missed, about which axis, what is odd about it; or a line per object."""

from __future__ import annotations

from typing import NamedTuple

from rich.cells import cell_len
from rich.text import Text

from host.screen.dashboard.boxes import Lines, block, once_a_cycle
from host.screen.dashboard.theme import Part, Theme
from host.trial.state import MISSED, OUTSIDE, CycleRow, TrialState

MIN_BAR, MAX_BAR = 6, 40
_FIXED = 35
"""Cells of the columns that always have the same width, with the spaces between them."""
_THETA = 8
_AXIS, _WIDE_AXIS = 15, 18
_FLAGS = 13
"""Cells kept for flags."""


class _Columns(NamedTuple):
    """What there is room for."""

    bar: int
    theta: bool
    axis: int
    """Width of the axis, 0 without one."""


def _columns(width: int) -> _Columns:
    """Return the columns that fit: the axis of the step goes before the course of θ̄, for that stands above anyway."""
    spare = width - _FIXED - MIN_BAR - _FLAGS
    axis = 0 if spare < _AXIS else _AXIS if spare < _WIDE_AXIS + _THETA + _FLAGS else _WIDE_AXIS
    theta = spare - axis >= _THETA
    return _Columns(min(MAX_BAR, max(MIN_BAR, MIN_BAR + spare - axis - _THETA * theta)), theta, axis)


@once_a_cycle
def cycle_table(state: TrialState, theme: Theme, width: int, height: int) -> Lines:
    """Draw the newest cycles that fit, below a heading."""
    columns = _columns(width)
    head = f"{'cycle':>6}{'time':>10}{'period':>9}{'step deg' if theme.ascii_only else 'step':>9} {'':{columns.bar}}"
    if columns.theta:
        head += f"{theme.words('θ̄'):>{_THETA if theme.ascii_only else _THETA + 1}}"  # ``format`` counts the bar over θ
    lines = [theme.text(head + ("  axis of step" if columns.axis else ""), "strong")]
    rows = state.score.cycles[-max(1, height - 1) :]
    longest = max((row.step_deg or 0.0 for row in state.score.cycles if not row.excluded), default=0.0)
    lines += [_line(row, longest, columns, theme, width) for row in rows]
    if not rows:
        lines.append(theme.text(f"  {_waiting(state)}", "quiet"))
    return block(lines, width, height, theme)


def _line(row: CycleRow, longest_deg: float, columns: _Columns, theme: Theme, width: int) -> Text:
    odd = "quiet" if row.excluded else "doubtful" if row.flags else "plain"
    share = 1.0 if longest_deg <= 0 else min(1.0, (row.step_deg or 0.0) / longest_deg)
    bar = _bar(share, columns.bar, bool(row.excluded), theme) if row.step_deg else ""
    number = str(row.number) if row.number else "start"
    period = "" if row.period_s is None else f"{row.period_s:.3f} s"
    parts: list[Part] = [
        (f"{number:>6}{row.time_s:>8.2f} s{period:>9}", "quiet" if row.excluded else "plain"),
        (f"{_angle(row.step_deg, theme):>9} ", odd),
        (f"{bar:{columns.bar}}", odd if odd != "plain" else "accent"),
    ]
    if columns.theta:
        parts.append(f"{_angle(row.theta_bar_deg, theme):>{_THETA}}")
    line = theme.join(*parts)
    by_operator = row.excluded not in {"", OUTSIDE, MISSED}
    note = f"left out: {row.excluded}" if by_operator else row.excluded or ", ".join(row.flags)
    if columns.axis and row.step_axis is not None:
        axis = theme.join((f"  {theme.vector(row.step_axis, 2 if columns.axis == _WIDE_AXIS else 1)}", "quiet"))
        if not note or line.cell_len + axis.cell_len + 1 + cell_len(theme.words(note)) <= width:  # a note goes before
            line.append_text(axis)
    return line.append_text(theme.join((f" {note}" if note else "", "doubtful")))


def _bar(share: float, cells: int, dashed: bool, theme: Theme) -> str:
    """Draw a share of so many cells, to half a cell where there are characters for it; never nothing."""
    if dashed or theme.ascii_only:
        sign = ("x" if dashed else "=") if theme.ascii_only else "┄"
        return sign * max(1, round(share * cells))
    whole, half = divmod(max(1, round(2 * share * cells)), 2)
    return "━" * whole + "╸" * half


def _angle(angle_deg: float | None, theme: Theme) -> str:
    """Write an angle with its sign of degrees; in ASCII the heading has the unit."""
    return "" if angle_deg is None else f"{angle_deg:.3f}" + ("" if theme.ascii_only else "°")


def _waiting(state: TrialState) -> str:
    if state.sensor.orientation_wxyz is None:
        return "no data yet"
    if state.motion.at_rest:
        return "at rest: start the hand, and every cycle gets a line here"
    return "it turns: the first end point is known after about one and a half cycles"


MAX_OBJECTS = 16
"""More lines than this are not shown; the focus still reaches every object."""


def object_rows(states: tuple[TrialState, ...], focus: int, theme: Theme, width: int, height: int) -> Lines:
    """Draw a line per object, at most ``height``, the one in focus among them; nothing where there is only one."""
    if len(states) < 2:
        return []
    room = max(1, min(height, MAX_OBJECTS, len(states)))
    first = min(max(0, focus - room // 2), len(states) - room)
    lines: Lines = []
    for index in range(first, first + room):
        state = states[index]
        sign = (">" if theme.ascii_only else "▶") if index == focus else " "
        n, theta_deg = state.score.n_cycles, state.score.theta_bar_deg
        theta = "    - " if theta_deg is None else f"{theta_deg:6.2f}"
        rate = "-" if state.stream.rate_hz is None else f"{state.stream.rate_hz:.0f} Hz"
        name = state.sensor.name or "sensorized object"
        trouble = state.alarms[0].kind if state.alarms else "" if state.link.connected else "DISCONNECTED"
        line = theme.join(
            (f"{sign} {index + 1:2} ", "strong" if index == focus else "plain"),
            f"{name[:16]:16} θ̄ {theta}° {n:4} {'cycle ' if n == 1 else 'cycles'} {rate:>8}  ",
        )
        parts: list[Part] = [
            (f"ALARM {trouble}" if trouble else "", "bad"),
            "finished" if state.score.finished else state.motion.phase,
            (state.link.name, "quiet"),
        ]
        lines.append(line.append_text(theme.listed(parts, width - line.cell_len)))
    return lines
