"""The dashboard: a picture of one or several :class:`~host.trial.state.TrialState`, for any size from 60 x 16 on.

:func:`picture` is pure: the same states, view and size give the same lines. Names come from devices and files, so every
text is a :class:`rich.text.Text`, never a markup string. Colour is never the only carrier of a meaning.
"""

from __future__ import annotations

from host.screen.dashboard.boxes import Lines, beside, block, fitted, framed, once_a_cycle
from host.screen.dashboard.cycle_table import cycle_table, object_rows
from host.screen.dashboard.drift_path import path_plot, sphere_plot
from host.screen.dashboard.notices import bottom_line, guide_lines, help_lines, notice_lines
from host.screen.dashboard.score_panel import score_panel
from host.screen.dashboard.status_panel import status_panel
from host.screen.dashboard.theme import Theme, View
from host.trial.state import TrialState

__all__ = ["Theme", "View", "picture"]

WIDE, TALL = 100, 28
"""From this size on the drift path and the sphere have panels of their own."""
MIN_TABLE, MIN_PANEL = 3, 6
HELP_LINES = 18
MIN_PLOT, MAX_PLOT = 30, 72
"""Width of the right column, cells."""


def picture(states: tuple[TrialState, ...], view: View, width: int, height: int) -> Lines:
    """Draw a moment, of one object or several, as exactly ``height`` lines of exactly ``width`` cells."""
    theme = view.theme
    focus = min(view.focus, len(states) - 1)
    state = states[focus]
    wide = width >= WIDE and height >= TALL
    top = score_panel(state, theme, width, with_path=not wide)
    top += object_rows(states, focus, theme, width, max(2, height // 6))
    top += guide_lines(state, theme, width)
    notices = notice_lines(state, theme, width)
    foot = [*status_panel(state, theme, width), bottom_line(view, states, focus, width)]
    spare = height - len(top) - len(notices) - len(foot)
    if spare < MIN_TABLE or (view.help_open and spare < HELP_LINES):
        # A small terminal: what is wrong goes before the status.
        foot = foot[-1:]
        spare = height - len(top) - len(notices) - len(foot)
    middle_height = max(1, spare)
    if view.help_open:
        middle = help_lines(theme, width, middle_height)
    elif wide:
        middle = _wide_middle(state, theme, width, middle_height)
    else:
        middle = cycle_table(state, theme, width, middle_height)
    lines = [*top, *notices, *middle, *foot]
    return block([fitted(line, width, theme) for line in lines[: height - 1]] + lines[-1:], width, height, theme)


@once_a_cycle
def _wide_middle(state: TrialState, theme: Theme, width: int, height: int) -> Lines:
    right = min(MAX_PLOT, max(MIN_PLOT, width * 9 // 20 - 15))
    table = cycle_table(state, theme, width - right - 1, height)
    path_height = max(MIN_PANEL, height * 2 // 5)
    if height - path_height < MIN_PANEL:
        path_height = height
    path = path_plot(state, theme, right - 4, path_height - 2)
    plots = framed(path, "rotation since the start", right, path_height, theme)
    if path_height < height:
        sphere = sphere_plot(state, theme, right - 4, height - path_height - 2)
        plots += framed(sphere, "where the axes went", right, height - path_height, theme)
    return beside(table, block([], 1, height, theme), plots)
