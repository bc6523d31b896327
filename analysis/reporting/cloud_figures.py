"""The recorded point clouds with highlighted, numbered end points: the plots the benchmark card asks for."""

from __future__ import annotations

from typing import Any

import numpy as np

from analysis.reporting import figure_style as look
from analysis.reporting.clouds import BODY_AXES, Clouds
from analysis.reporting.figures import numbers_shown
from analysis.series import FloatArray


def sphere_figure(clouds: Clouds) -> look.PaperFigure:
    """Draw where the object's three axes point, on the unit sphere of the world frame."""
    figure = look.new_figure(2.9, layout="none")
    ax: Any = figure.add_axes((0.0, 0.13, 1.0, 0.87), projection="3d", computed_zorder=False)
    _sphere(ax)
    for number, name in enumerate(BODY_AXES):
        colour, marker = look.AXIS_COLOURS[number], look.AXIS_MARKERS[number]
        cloud, points = clouds.axes[number], clouds.endpoint_axes[number]
        ax.scatter(*cloud[~clouds.scored].T, s=1, color=look.LIGHT, lw=0, rasterized=True, depthshade=False)
        ax.scatter(*cloud[clouds.scored].T, s=1.5, color=colour, lw=0, alpha=0.45, rasterized=True, depthshade=False)
        if len(points):
            ax.scatter(
                *points.T, s=22, marker=marker, facecolor=colour, edgecolor="black", lw=0.6, depthshade=False,
                label=f"object {name} at the end points",
            )  # fmt: skip
            outward = 1.2 * points.mean(axis=0)
            text = f"{name}: 1–{len(points)}" if len(points) > 1 else f"{name}: 1"
            ax.text(
                *outward, text, fontsize=7, color=colour, weight="bold", ha="center", va="center", zorder=20,
                bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75},
            )  # fmt: skip
    ax.set_box_aspect((1, 1, 1), zoom=1.15)
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.set_axis_off()
    for name, tip in zip("XYZ", np.eye(3), strict=True):
        ax.plot(*np.stack((tip, 1.2 * tip)).T, color=look.GREY, lw=0.8)
        ax.text(*(1.28 * tip), f"world {name}", fontsize=6, color=look.GREY, ha="center", va="center")
    _look_at_the_axes(ax, clouds)
    if clouds.endpoint_axes.shape[1]:
        figure.legend(loc="lower center", ncols=1, fontsize=6.5, handletextpad=0.2)
    return figure


def rotation_cloud_figure(clouds: Clouds) -> look.PaperFigure:
    """Draw the rotation-vector cloud in degrees, and beside it the end points alone, enlarged and numbered."""
    return _cloud_figure(
        clouds, clouds.rotvecs_deg, clouds.endpoint_rotvecs_deg, ("rx", "ry", "rz"), "°", "rotation from end point 1"
    )


def translation_cloud_figure(clouds: Clouds) -> look.PaperFigure | None:
    """Draw the positions in mm in the same way; None where the recording has none."""
    if clouds.positions_mm is None or clouds.endpoint_positions_mm is None:
        return None
    return _cloud_figure(
        clouds, clouds.positions_mm, clouds.endpoint_positions_mm, ("x", "y", "z"), "mm", "translation from end point 1"
    )


def _cloud_figure(
    clouds: Clouds, cloud: FloatArray, points: FloatArray, names: tuple[str, str, str], unit: str, what: str
) -> look.PaperFigure:
    figure = look.new_figure(4.5, layout="none")
    figure.text(0.03, 0.985, f"{what}, world frame", va="top", fontsize=7.5, weight="bold")
    whole: Any = figure.add_axes((0.02, 0.49, 0.86, 0.47), projection="3d", computed_zorder=False)
    whole.scatter(*cloud[~clouds.scored].T, s=1, color=look.LIGHT, lw=0, rasterized=True, depthshade=False)
    whole.scatter(*cloud[clouds.scored].T, s=1.5, color=look.BLUE, lw=0, alpha=0.5, rasterized=True, depthshade=False)
    whole.plot([], [], "o", ms=3, color=look.BLUE, label="recorded samples, scored cycles")
    whole.plot([], [], "o", ms=3, color=look.LIGHT, label="before and after")
    near: Any = figure.add_axes((0.02, 0.02, 0.86, 0.42), projection="3d", computed_zorder=False)
    figure.text(0.03, 0.47, "the end points alone, enlarged and numbered", va="top", fontsize=7.5, weight="bold")
    if len(points):
        whole.scatter(
            *points.T, s=20, facecolor=look.VERMILION, edgecolor="black", lw=0.5, depthshade=False, label="end points"
        )
        near.plot(*points.T, color=look.GREY, lw=0.7)
        near.scatter(
            *points.T, s=18, c=np.arange(len(points)), cmap="viridis", edgecolor="black", lw=0.4, depthshade=False
        )
        for number in numbers_shown(len(points), 20):
            near.text(*points[number], f"  {number + 1}", fontsize=6.5, zorder=20, va="bottom")
    for ax, values in ((whole, np.concatenate((cloud, points))), (near, points if len(points) else np.zeros((1, 3)))):
        _frame(ax, values, names, unit)
    figure.legend(loc="upper right", bbox_to_anchor=(1.0, 0.975), fontsize=6, markerscale=1.2, handletextpad=0.1)
    return figure


def _frame(ax: Any, values: FloatArray, names: tuple[str, str, str], unit: str) -> None:  # noqa: ANN401 - mplot3d
    """Equal scales on all three axes, labels with units, no grey panes."""
    middle = 0.5 * (values.max(axis=0) + values.min(axis=0))
    half = max(0.55 * float(np.ptp(values, axis=0).max()), 1e-6)
    for set_limits, centre in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), middle, strict=True):
        set_limits(centre - half, centre + half)
    ax.set_box_aspect((1, 1, 1), zoom=0.86)
    for set_label, name in zip((ax.set_xlabel, ax.set_ylabel, ax.set_zlabel), names, strict=True):
        set_label(f"{name} ({unit})", labelpad=-6)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.pane.set_facecolor("white")
        axis.pane.set_edgecolor(look.LIGHT)
        axis.get_major_locator().set_params(nbins=5)
    ax.tick_params(pad=-3, labelsize=6)
    ax.grid(visible=True)
    ax.view_init(elev=22, azim=-52)


def _look_at_the_axes(ax: Any, clouds: Clouds) -> None:  # noqa: ANN401 - mplot3d
    """Turn the view so that the object's three axes point towards the reader: none is behind the sphere."""
    points = clouds.endpoint_axes if clouds.endpoint_axes.shape[1] else clouds.axes
    towards = points[:, 0].sum(axis=0)
    elevation = np.degrees(np.arctan2(towards[2], np.hypot(towards[0], towards[1])))
    ax.view_init(elev=float(np.clip(elevation, -70, 70)), azim=float(np.degrees(np.arctan2(towards[1], towards[0]))))


def _sphere(ax: Any) -> None:  # noqa: ANN401 - mplot3d
    """Circles of latitude and longitude, light, so that the clouds stand out."""
    turn = np.linspace(0, 2 * np.pi, 73)
    for latitude in np.radians((-60, -30, 0, 30, 60)):
        ring = np.cos(latitude)
        ax.plot(ring * np.cos(turn), ring * np.sin(turn), np.full_like(turn, np.sin(latitude)), color="#E4E4E4", lw=0.4)
    for longitude in np.radians(range(0, 180, 30)):
        ax.plot(
            np.cos(turn) * np.cos(longitude), np.cos(turn) * np.sin(longitude), np.sin(turn), color="#E4E4E4", lw=0.4
        )
