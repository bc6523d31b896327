"""The recorded point clouds with highlighted, numbered end points: the plots the benchmark card asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from analysis.reporting import style
from analysis.reporting.clouds import BODY_AXES, Clouds
from analysis.reporting.point_numbers import draw_numbers
from analysis.series import FloatArray


def sphere_figure(clouds: Clouds) -> style.PaperFigure:
    """Draw where the object's three axes point, on the unit sphere; below, their end points alone, numbered."""
    n = clouds.endpoint_axes.shape[1]
    figure = style.new_figure(3.9 if n else 2.6, layout="none")
    ax: Any = figure.add_axes(
        (0.0, 0.35, 1.0, 0.64) if n else (0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False
    )
    _sphere(ax)
    for number, name in enumerate(BODY_AXES):
        colour, marker = style.AXIS_COLOURS[number], style.AXIS_MARKERS[number]
        cloud, points = clouds.axes[number], clouds.endpoint_axes[number]
        ax.scatter(*cloud[~clouds.scored].T, s=1, color=style.LIGHT, lw=0, rasterized=True, depthshade=False)
        ax.scatter(*cloud[clouds.scored].T, s=1.5, color=colour, lw=0, alpha=0.45, rasterized=True, depthshade=False)
        if n:
            ax.scatter(*points.T, s=16, marker=marker, facecolor=colour, edgecolor="black", lw=0.4, depthshade=False)
        middle = (points if n else cloud).mean(axis=0)
        ax.text(
            *(1.28 * middle / max(float(np.linalg.norm(middle)), 1e-9)), name,
            fontsize=9, color=colour, weight="bold", ha="center", va="center", zorder=20,
            bbox={"boxstyle": "square,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75},
        )  # fmt: skip
    ax.set_box_aspect((1, 1, 1), zoom=1.15)
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.set_axis_off()
    for name, tip in zip("XYZ", np.eye(3), strict=True):
        ax.plot(*np.stack((tip, 1.15 * tip)).T, color=style.GREY, lw=0.8)
        ax.text(*(1.3 * tip), name, fontsize=6, color=style.GREY, ha="center", va="center")
    _look_at_the_axes(ax, clouds)
    figure.text(0.03, 0.985, "axes of the object: x, y, z", va="top", fontsize=7.5, weight="bold")
    figure.text(0.97, 0.985, "X, Y, Z: world", va="top", ha="right", fontsize=6.5, color=style.GREY)
    if n:
        _tips(figure, clouds)
    return figure


def _tips(figure: style.PaperFigure, clouds: Clouds) -> None:
    """Draw the end points of the three axes alone beside each other: seen from outside the sphere, on one scale."""
    figure.text(0.03, 0.345, "the end points alone, enlarged and numbered (°)", va="top", fontsize=7.5, weight="bold")
    panels = [_flattened(points) for points in clouds.endpoint_axes]
    half = max(0.72 * max(float(np.ptp(flat, axis=0).max()) for flat in panels), 1e-3)
    for number, flat in enumerate(panels):
        ax: Any = figure.add_axes((0.085 + 0.315 * number, 0.05, 0.25, 0.25 * style.COLUMN_IN / 3.9))
        colour = style.AXIS_COLOURS[number]
        ax.plot(flat[:, 0], flat[:, 1], color=style.GREY, lw=0.5)
        ax.plot(flat[:, 0], flat[:, 1], style.AXIS_MARKERS[number], color=colour, ms=2.6, mec="black", mew=0.3)
        middle = 0.5 * (flat.max(axis=0) + flat.min(axis=0))
        ax.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
        draw_numbers(ax, flat, 5.5)
        ax.set_title(f"object {BODY_AXES[number]}", fontsize=6.5, color=colour, pad=2)
        ax.tick_params(labelsize=5, length=2, pad=1.5)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(MaxNLocator(3))


def _flattened(points: FloatArray) -> FloatArray:
    """Return (n, 2) points of the unit sphere in deg from their middle, to the right and up as seen from outside."""
    middle = points.mean(axis=0)
    middle = middle / max(float(np.linalg.norm(middle)), 1e-9)
    right = np.cross((0.0, 0.0, 1.0) if abs(middle[2]) < 0.9 else (0.0, 1.0, 0.0), middle)
    right = right / np.linalg.norm(right)
    flat: FloatArray = np.degrees(points @ np.stack((right, np.cross(middle, right)), axis=1))
    return flat


def rotation_cloud_figure(clouds: Clouds) -> style.PaperFigure:
    """Draw the rotation-vector cloud in degrees, and beside it the end points alone, enlarged and numbered."""
    return _cloud_figure(
        clouds, clouds.rotvecs_deg, clouds.endpoint_rotvecs_deg, ("rx", "ry", "rz"), "°", "rotation from end point 1"
    )


def translation_cloud_figure(clouds: Clouds) -> style.PaperFigure | None:
    """Draw the positions in mm in the same way; None where the recording has none."""
    if clouds.positions_mm is None or clouds.endpoint_positions_mm is None:
        return None
    return _cloud_figure(
        clouds, clouds.positions_mm, clouds.endpoint_positions_mm, ("x", "y", "z"), "mm", "translation from end point 1"
    )


def _cloud_figure(
    clouds: Clouds, cloud: FloatArray, points: FloatArray, names: tuple[str, str, str], unit: str, what: str
) -> style.PaperFigure:
    figure = style.new_figure(5.0, layout="none")
    figure.text(0.03, 0.985, f"{what}, world frame", va="top", fontsize=7.5, weight="bold")
    figure.text(0.03, 0.455, "the end points alone, enlarged and numbered", va="top", fontsize=7.5, weight="bold")
    whole: Any = figure.add_axes((0.0, 0.455, 0.93, 0.5), projection="3d", computed_zorder=False)
    near: Any = figure.add_axes((0.0, 0.0, 0.93, 0.455), projection="3d", computed_zorder=False)
    elevation, azimuth = _view(points)
    for ax, values in ((whole, np.concatenate((cloud, points))), (near, points if len(points) else np.zeros((1, 3)))):
        _frame(ax, values, names, unit)
        ax.view_init(elev=elevation, azim=azimuth)
    whole.scatter(*cloud[~clouds.scored].T, s=1, color=style.LIGHT, lw=0, rasterized=True, depthshade=False)
    whole.scatter(*cloud[clouds.scored].T, s=1.5, color=style.BLUE, lw=0, alpha=0.5, rasterized=True, depthshade=False)
    whole.plot([], [], "o", ms=3, color=style.BLUE, label="samples, first to last end point")
    whole.plot([], [], "o", ms=3, color=style.LIGHT, label="samples before and after")
    if len(points):
        whole.scatter(
            *points.T, s=16, facecolor=style.VERMILION, edgecolor="black", lw=0.5, depthshade=False, label="end points"
        )
        near.plot(*points.T, color=style.GREY, lw=0.7)
        near.scatter(
            *points.T, s=14, c=np.arange(len(points)), cmap="viridis", edgecolor="black", lw=0.4, depthshade=False
        )
        draw_numbers(near, _projected(near, points), 6.5)
    figure.legend(
        loc="upper right", bbox_to_anchor=(1.0, 0.965), fontsize=6, markerscale=1.2, handletextpad=0.1, labelspacing=0.3
    )
    return figure


def _view(points: FloatArray) -> tuple[float, float]:
    """Return elevation and azimuth, of a few, from which the path of the end points appears longest, so most apart."""

    def length(view: tuple[float, float]) -> float:
        elevation, azimuth = np.radians(view)
        right = (-np.sin(azimuth), np.cos(azimuth), 0.0)
        up = (-np.sin(elevation) * np.cos(azimuth), -np.sin(elevation) * np.sin(azimuth), np.cos(elevation))
        return round(float(np.linalg.norm(np.diff(points @ np.stack((right, up), axis=1), axis=0), axis=1).sum()), 6)

    return max(((22.0, azimuth) for azimuth in (-52.0, -128.0, 38.0, 142.0)), key=length)


def _projected(ax: Any, points: FloatArray) -> FloatArray:  # noqa: ANN401 - mplot3d
    """Return where points of 3-D axes lie in the plane of the picture, (n, 2)."""
    ax.apply_aspect()
    seen: FloatArray = np.column_stack((points, np.ones(len(points)))) @ ax.get_proj().T
    return seen[:, :2] / seen[:, 3:]


def _frame(ax: Any, values: FloatArray, names: tuple[str, str, str], unit: str) -> None:  # noqa: ANN401 - mplot3d
    """Set equal scales on all three axes, labels with units, no grey panes."""
    middle = 0.5 * (values.max(axis=0) + values.min(axis=0))
    half = max(0.55 * float(np.ptp(values, axis=0).max()), 1e-6)
    for set_limits, centre in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), middle, strict=True):
        set_limits(centre - half, centre + half)
    ax.set_box_aspect((1, 1, 1), zoom=0.9)
    for set_label, name in zip((ax.set_xlabel, ax.set_ylabel, ax.set_zlabel), names, strict=True):
        set_label(f"{name} ({unit})", labelpad=-7)
    ax.zaxis.set_rotate_label(False)  # else it may stand on its head
    ax.zaxis.label.set_rotation(90)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.pane.set_facecolor("white")
        axis.pane.set_edgecolor(style.LIGHT)
        axis.get_major_locator().set_params(nbins=5)
    ax.tick_params(pad=-3, labelsize=6)
    ax.grid(visible=True)


def _look_at_the_axes(ax: Any, clouds: Clouds) -> None:  # noqa: ANN401 - mplot3d
    """Turn the view so that the object's three axes point towards the reader: none is behind the sphere."""
    points = clouds.endpoint_axes if clouds.endpoint_axes.shape[1] else clouds.axes
    towards = points[:, 0].sum(axis=0)
    elevation = np.degrees(np.arctan2(towards[2], np.hypot(towards[0], towards[1])))
    ax.view_init(elev=float(np.clip(elevation, -70, 70)), azim=float(np.degrees(np.arctan2(towards[1], towards[0]))))


def _sphere(ax: Any) -> None:  # noqa: ANN401 - mplot3d
    """Draw circles of latitude and longitude, light, so that the clouds stand out."""
    turn = np.linspace(0, 2 * np.pi, 73)
    circle, light = (np.cos(turn), np.sin(turn)), {"color": "#E4E4E4", "lw": 0.4}
    for latitude in np.radians((-60, -30, 0, 30, 60)):
        ring = np.cos(latitude)
        ax.plot(ring * circle[0], ring * circle[1], np.full_like(turn, np.sin(latitude)), **light)
    for longitude in np.radians(range(0, 180, 30)):
        ax.plot(circle[0] * np.cos(longitude), circle[0] * np.sin(longitude), circle[1], **light)
