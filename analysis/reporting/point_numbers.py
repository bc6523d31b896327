"""Numbers beside points that may lie close together: each where it covers no point and no other number."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.patheffects import withStroke

from analysis.reporting import style
from analysis.series import FloatArray

_DISTANCES_PT = (6.0, 9.0, 13.0, 18.0)
_FAR_PT = 8.0  # from here on a thin line leads to the point
_MARKER_PT = 2.6
_DIRECTIONS = np.radians((45, 90, 0, 135, -45, 180, -90, -135, 22, 68, 112, 158, -22, -68, -112, -158))


def draw_numbers(ax: Any, points: FloatArray, size: float = 6.0) -> None:  # noqa: ANN401 - plane or 3-D axes
    """Write 1, 2, … beside points where there is room; the first and the last always.

    Parameters
    ----------
    ax : object
        Axes whose size and limits are final.
    points : (n, 2) float64
        In the coordinates of the axes (of 3-D axes: projected).
    size : float, optional
        Of the digits, points.
    """
    scale = 72.0 / ax.figure.dpi
    frame = ax.get_window_extent()
    corners = np.array(((frame.x0, frame.y0), (frame.x1, frame.y1))) * scale
    for number, offset in number_offsets(ax.transData.transform(points) * scale, corners, size).items():
        far = float(np.hypot(*offset)) > _FAR_PT
        ax.annotate(
            str(number + 1), points[number], xytext=tuple(offset), textcoords="offset points", fontsize=size,
            ha="center", va="center", zorder=20, annotation_clip=False,
            arrowprops={"arrowstyle": "-", "lw": 0.3, "color": style.GREY, "shrinkA": 0, "shrinkB": 1} if far else None,
            path_effects=[withStroke(linewidth=1.0, foreground="white")],
        )  # fmt: skip


def number_offsets(points_pt: FloatArray, corners_pt: FloatArray, size: float) -> dict[int, FloatArray]:
    """Return where the middle of each number stands, from its point.

    Parameters
    ----------
    points_pt : (n, 2) float64
        On the page, points.
    corners_pt : (2, 2) float64
        Lower left and upper right corner of the room there is.
    size : float
        Of the digits, points.

    Returns
    -------
    (2,) offset by number of the point; points without room are left out, but never the first and the last.
    """
    n = len(points_pt)
    order = list(dict.fromkeys((0, n - 1, *range(n)))) if n else []  # the ends choose first
    middles, halves = np.zeros((0, 2)), np.zeros((0, 2))  # boxes of the numbers placed so far
    found: dict[int, FloatArray] = {}
    for number in order:
        half = np.array((0.33 * size * len(str(number + 1)), 0.4 * size))
        # A covered point or number costs 1, the line below 0.5, distance a little: beyond 1 there is no room.
        best, least = None, 10.0 if number in {0, n - 1} else 1.0
        for distance in _DISTANCES_PT:
            for direction in _DIRECTIONS:
                away = distance + half[0] - half[1]  # wide numbers stand off sideways
                offset = np.array((away * np.cos(direction), distance * np.sin(direction)))
                at = points_pt[number] + offset
                if ((at - half < corners_pt[0]) | (at + half > corners_pt[1])).any():
                    continue
                covered = np.sum((np.abs(points_pt - at) < half + _MARKER_PT).all(axis=1))
                covered += np.sum((np.abs(middles - at) < halves + half).all(axis=1))
                cost = float(covered) + 0.5 * _crossings(points_pt, at, half) + 0.02 * distance
                if cost < least:
                    best, least = offset, cost
        if best is not None:
            found[number] = best
            middles, halves = np.vstack((middles, points_pt[number] + best)), np.vstack((halves, half))
    return found


def _crossings(points_pt: FloatArray, at: FloatArray, half: FloatArray) -> int:
    """Return whether the line through the points runs under a box: 0 or 1, tried at a few points of it."""
    if len(points_pt) < 2:
        return 0
    share = np.linspace(0.0, 1.0, 25)[:, None, None]
    line = points_pt[:-1] * (1.0 - share) + points_pt[1:] * share
    return int((np.abs(line - at) < half).all(axis=2).any())
