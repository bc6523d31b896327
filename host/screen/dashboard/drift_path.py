"""Where the drift went: rotation since the first end point per cycle, and the object's axes on a sphere."""

from __future__ import annotations

import math
from itertools import pairwise

from rich.text import Text

from host.screen.dashboard.boxes import Lines, beside, block, once_a_cycle
from host.screen.dashboard.canvas import Canvas
from host.screen.dashboard.theme import Theme
from host.trial.state import OUTSIDE, Quaternion, TrialState

Vector = tuple[float, float, float]

# The sphere is looked at from (1, 1, 1): every axis of the first end point points towards the eye.
_RIGHT: Vector = (-1 / math.sqrt(2), 1 / math.sqrt(2), 0.0)
_UP: Vector = (-1 / math.sqrt(6), -1 / math.sqrt(6), 2 / math.sqrt(6))
_EYE: Vector = (1 / math.sqrt(3), 1 / math.sqrt(3), 1 / math.sqrt(3))
_AXES: tuple[tuple[str, Vector], ...] = (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 1.0, 0.0)), ("z", (0.0, 0.0, 1.0)))

LEGEND_FROM = 9
"""Height of the sphere's picture from which on a line says what it shows."""


def _poses(state: TrialState) -> list[tuple[int, Quaternion]]:
    """Cycle numbers and orientations of the end points in the trial window, the first that counts among them."""
    return [
        (row.number, row.quat_wxyz)
        for row in state.score.cycles
        if row.quat_wxyz is not None and (row.excluded != OUTSIDE or row.quat_wxyz == state.score.origin_wxyz)
    ]


def cumulative_deg(state: TrialState) -> list[tuple[int, float]]:
    """Rotation from the first end point that counts to each in the trial window, deg, with the number of its cycle."""
    origin = state.score.origin_wxyz
    return [] if origin is None else [(number, _angle_deg(quat, origin)) for number, quat in _poses(state)]


def net_deg(state: TrialState) -> float | None:
    """Rotation from the first end point to the last, deg; None before the second."""
    path = cumulative_deg(state)
    return path[-1][1] if len(path) > 1 else None


@once_a_cycle
def small_path(state: TrialState, theme: Theme, width: int, height: int) -> Lines:
    """Plot the drift path without labels, for where there is little room."""
    return path_plot(state, theme, width, height, labels=False)


def path_plot(state: TrialState, theme: Theme, width: int, height: int, labels: bool = True) -> Lines:
    """Plot the rotation since the first end point over the cycles.

    Parameters
    ----------
    state : TrialState
        The moment.
    theme : Theme
        Colours and characters.
    width, height : int
        Of the rectangle.
    labels : bool
        Whether to write the scale at the left and the cycles below.
    """
    points = cumulative_deg(state)
    if len(points) < 2:
        return block([theme.text("no steps yet", "quiet")] if labels else [], width, height, theme)
    top = max(max(angle for _, angle in points), 1e-3)
    margin = (10 if theme.ascii_only else 8) if labels else 0
    canvas = Canvas(width - margin, height - (1 if labels else 0), theme)
    first, last = points[0][0], points[-1][0]
    across, up = (canvas.width - 1) / max(1, last - first), canvas.height - 1
    places = [((number - first) * across, angle / top * up) for number, angle in points]
    for (x0, y0), (x1, y1) in pairwise(places):
        canvas.line(x0, y0, x1, y1, "accent", ".")
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
    x0, y0 = (canvas.width - 1) / 2.0, (canvas.height - 1) / 2.0

    def place(point: Vector) -> tuple[float, float]:
        return x0 + radius * aspect * _dot(point, _RIGHT), y0 + radius * _dot(point, _UP)

    steps = max(24, round(6 * radius))
    for k in range(steps):
        angle = 2 * math.pi * k / steps
        canvas.dot(x0 + radius * aspect * math.cos(angle), y0 + radius * math.sin(angle), "frame", ".")
    origin = state.score.origin_wxyz
    if origin is not None:
        turns = [_difference(quat, origin) for _, quat in _poses(state)]
        tips = []
        for name, axis in _AXES:
            canvas.line(x0, y0, *place(axis), "frame", ".")
            trail = [place(tip) for tip in (_turned(turn, axis) for turn in turns) if _dot(tip, _EYE) >= 0.0]
            for (xa, ya), (xb, yb) in pairwise(trail):
                canvas.line(xa, ya, xb, yb, name, "+")
            tips += [(name, trail[-1])] if trail else []
        for name, tip in tips:
            canvas.letter(*tip, name, name)
    pad = max(0, (width - canvas.cells_wide) // 2)
    lines = [Text(" " * pad, end="").append_text(line) for line in canvas.lines()]
    if legend:
        lines.append(theme.text("letter: now · dots: past", "quiet"))
    return block(lines, width, height, theme)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _difference(q: Quaternion, p: Quaternion) -> Quaternion:
    """Compute q ⊗ p⁻¹: the rotation from p to q in the world frame."""
    aw, ax, ay, az = q
    bw, bx, by, bz = p[0], -p[1], -p[2], -p[3]
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def _angle_deg(q: Quaternion, p: Quaternion) -> float:
    w, x, y, z = _difference(q, p)
    return math.degrees(2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w)))


def _turned(q: Quaternion, v: Vector) -> Vector:
    """Rotate a vector."""
    w, x, y, z = q
    tx, ty, tz = 2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )
