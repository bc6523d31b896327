"""Where the drift went: rotation since the first end point per cycle, and the object's axes on a sphere."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt
from rich.text import Text

from analysis.geometry import rotations
from host.screen.dashboard.boxes import Lines, beside, block, once_a_cycle
from host.screen.dashboard.canvas import Canvas
from host.screen.dashboard.theme import Theme
from host.trial.state import OUTSIDE, TrialState

FloatArray = npt.NDArray[np.float64]

# The sphere is seen from (1, 1, 1): every axis of the first end point points towards the eye.
_VIEW = np.array([[-1, 1, 0], [-1, -1, 2]]) / np.sqrt([[2], [6]])
"""(2, 3): rows are the directions to the right and up."""
_EYE = np.ones(3)
_AXES = dict(zip("xyz", np.eye(3), strict=True))

LEGEND_FROM = 9
"""Height of the sphere's picture from which on a line explains it."""


def _turns(state: TrialState) -> tuple[list[int], FloatArray]:
    """Return the rotations since the first end point that counts, (n, 4), of those in the trial window.

    With them the numbers of their cycles; nothing while no end point counts.
    """
    origin = state.score.origin_wxyz
    poses = [
        (row.number, row.quat_wxyz)
        for row in state.score.cycles
        if row.quat_wxyz is not None and (row.excluded != OUTSIDE or row.quat_wxyz == origin)
    ]
    if origin is None or not poses:
        return [], np.empty((0, 4))
    numbers, quats = zip(*poses, strict=True)
    return list(numbers), rotations.difference(quats, origin)


def net_deg(state: TrialState) -> float | None:
    """Return the rotation from the first end point to the last, deg; None before the second."""
    numbers, turns = _turns(state)
    return float(np.degrees(rotations.angle(turns[-1]))) if len(numbers) > 1 else None


@once_a_cycle
def small_path(state: TrialState, theme: Theme, width: int, height: int) -> Lines:
    """Plot the drift path without labels, for where there is little room."""
    return path_plot(state, theme, width, height, labels=False)


def path_plot(state: TrialState, theme: Theme, width: int, height: int, labels: bool = True) -> Lines:
    """Plot the rotation since the first end point over the cycles, with ``labels`` at the left and below."""
    numbers, turns = _turns(state)
    if len(numbers) < 2:
        return block([theme.text("no steps yet", "quiet")] if labels else [], width, height, theme)
    labels = labels and height > 1  # in a single line the path itself goes before
    angles_deg = np.degrees(rotations.angle(turns)).tolist()
    top = max(*angles_deg, 1e-3)
    margin = (10 if theme.ascii_only else 8) if labels else 0
    canvas = Canvas(width - margin, height - (1 if labels else 0), theme)
    first, last = numbers[0], numbers[-1]
    across, up = (canvas.width - 1) / max(1, last - first), canvas.height - 1
    places = [((number - first) * across, angle / top * up) for number, angle in zip(numbers, angles_deg, strict=True)]
    for one, other in pairwise(places):
        canvas.line(one, other, "accent", ".")
    for x, y in places:
        canvas.dot(x, y, "accent", "o")
    drawn = canvas.lines()
    if not labels:
        return block(drawn, width, height, theme)
    scale = [theme.text("")] * len(drawn)
    scale[0] = theme.text(f"{top:6.2f}° ", "quiet")
    scale[-1] = theme.text(f"{0.0:6.2f}° ", "quiet")
    below = theme.text(f"{'':{margin}}cycle {first} to {last}", "quiet")
    body = beside(block(scale, margin, len(drawn), theme), block(drawn, width - margin, len(drawn), theme))
    return block([*body, below], width, height, theme)


def sphere_plot(state: TrialState, theme: Theme, width: int, height: int) -> Lines:
    """Draw where the object's axes have wandered since the first end point.

    The axes of the first end point are x, y and z of the picture, each towards the eye; a letter stands where the axis
    is now, dots where it was.
    """
    legend = height >= LEGEND_FROM
    cells_high = max(2, height - legend)
    canvas = Canvas(min(width, cells_high * 2 + 1), cells_high, theme)
    aspect = 2.0 if theme.ascii_only else 1.0  # an ASCII dot is a cell, twice as high as wide
    radius = min((canvas.width - 1) / (2.0 * aspect), (canvas.height - 1) / 2.0)
    middle = np.array([canvas.width - 1, canvas.height - 1]) / 2.0
    scale = radius * np.array([aspect, 1.0])

    angles = np.linspace(0.0, 2 * np.pi, max(24, round(6 * radius)), endpoint=False)
    for x, y in (middle + scale * np.stack([np.cos(angles), np.sin(angles)], axis=1)).tolist():
        canvas.dot(x, y, "frame", ".")
    _, turns = _turns(state)
    now = []
    for name, axis in _AXES.items():
        if not len(turns):
            break
        canvas.line(middle.tolist(), (middle + scale * (_VIEW @ axis)).tolist(), "frame", ".")
        tips = rotations.rotate(turns, axis)
        trail = (middle + scale * (tips[tips @ _EYE >= 0.0] @ _VIEW.T)).tolist()
        for one, other in pairwise(trail):
            canvas.line(one, other, name, "+")
        now += [(name, trail[-1])] if trail else []
    for name, (x, y) in now:
        canvas.letter(x, y, name, name)
    pad = max(0, (width - canvas.cells_wide) // 2)
    lines = [Text(" " * pad, end="").append_text(line) for line in canvas.lines()]
    if legend:
        lines.append(theme.text("letter: now · dots: past", "quiet"))
    return block(lines, width, height, theme)
