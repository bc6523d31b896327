"""The interactive clouds of the HTML report: values for plotly.js, and the script itself, compressed.

Only plotly's 3-D bundle is shipped (``assets/``), and in a report it stands compressed: the browser unpacks it. The
Python package of plotly is not needed and not used.
"""

from __future__ import annotations

import base64
from pathlib import Path
from typing import TypeAlias

import numpy as np

from analysis.reporting import style as look
from analysis.reporting.clouds import BODY_AXES, Clouds, clouds_of
from analysis.reporting.trial_report import TrialReport
from analysis.series import FloatArray

BUNDLE = Path(__file__).parent / "assets" / "plotly-gl3d.min.js.gz"
MAX_POINTS = 2000
Scene: TypeAlias = dict[str, object]
"""``title``, and ``data`` and ``layout`` for plotly.js."""
_Trace: TypeAlias = dict[str, object]
_PLOTLY_MARKERS = ("circle", "diamond", "square")


def plotly_base64() -> str:
    """Return the 3-D bundle of plotly.js: gzip, as base64."""
    return base64.b64encode(BUNDLE.read_bytes()).decode("ascii")


def scenes(trial: TrialReport) -> list[Scene]:
    """Return the 3-D scenes of a trial: rotation, its end points alone, object axes, and translation where known.

    Returns
    -------
    In the order of the tabs.
    """
    clouds = clouds_of(trial.series, trial.result, MAX_POINTS)
    found = [
        _cloud_scene("Rotation (°)", clouds, clouds.rotvecs_deg, clouds.endpoint_rotvecs_deg, ("rx", "ry", "rz"), "°")
    ]
    if len(clouds.endpoint_rotvecs_deg) > 1:
        alone = _endpoints("end points", clouds.endpoint_rotvecs_deg, look.VERMILION, "circle", line=True)
        found.append(_scene("Its end points alone (°)", [alone], clouds.endpoint_rotvecs_deg, ("rx", "ry", "rz"), "°"))
    found.append(_axes_scene(clouds))
    if clouds.positions_mm is not None and clouds.endpoint_positions_mm is not None:
        found.append(
            _cloud_scene(
                "Translation (mm)", clouds, clouds.positions_mm, clouds.endpoint_positions_mm, ("x", "y", "z"), "mm"
            )
        )
    return found


def _cloud_scene(
    title: str, clouds: Clouds, cloud: FloatArray, points: FloatArray, names: tuple[str, str, str], unit: str
) -> dict[str, object]:
    data = [
        _trace("before and after", cloud[~clouds.scored], look.LIGHT, 2, clouds.times_s[~clouds.scored]),
        _trace("first to last end point", cloud[clouds.scored], look.BLUE, 2, clouds.times_s[clouds.scored]),
        _endpoints("end points", points, look.VERMILION, "circle", line=True),
    ]
    return _scene(title, data, np.concatenate((cloud, points)), names, unit)


def _scene(
    title: str, data: list[_Trace], values: FloatArray, names: tuple[str, str, str], unit: str
) -> dict[str, object]:
    extent = np.ptp(values, axis=0)
    largest = max(float(extent.max()), 1e-6)
    # Equal scales on all axes; a flat cloud gets room around it, so that the box is never thinner than half.
    half = 0.53 * np.maximum(extent, largest / 2.0)
    middle = 0.5 * (values.max(axis=0) + values.min(axis=0))
    axes: dict[str, object] = {}
    for column, (axis, name) in enumerate(zip("xyz", names, strict=True)):
        ends = [round(float(middle[column] - half[column]), 4), round(float(middle[column] + half[column]), 4)]
        axes[f"{axis}axis"] = {**_axis(f"{name} ({unit})"), "range": ends}
    ratio = {axis: round(float(half[column] / half.max()), 4) for column, axis in enumerate("xyz")}
    return {
        "title": title,
        "data": data,
        "layout": _layout({**axes, "aspectmode": "manual", "aspectratio": ratio}),
    }


def _axes_scene(clouds: Clouds) -> dict[str, object]:
    data = []
    for number, name in enumerate(BODY_AXES):
        colour = look.AXIS_COLOURS[number]
        data.append(_trace(f"object {name}", clouds.axes[number], colour, 2, clouds.times_s))
        data.append(_endpoints(f"{name} at end points", clouds.endpoint_axes[number], colour, _PLOTLY_MARKERS[number]))
    axes = {f"{axis}axis": {**_axis(f"world {axis.upper()}"), "range": [-1.1, 1.1]} for axis in "xyz"}
    return {"title": "Object axes on the sphere", "data": data, "layout": _layout({**axes, "aspectmode": "cube"})}


def _trace(name: str, points: FloatArray, colour: str, size: int, times_s: FloatArray) -> dict[str, object]:
    return {
        "type": "scatter3d",
        "mode": "markers",
        "name": name,
        **_columns(points),
        "text": [f"{time_s:.2f} s" for time_s in times_s],
        "hoverinfo": "x+y+z+text+name",
        "marker": {"size": size, "color": colour, "opacity": 0.7},
    }


def _endpoints(name: str, points: FloatArray, colour: str, symbol: str, *, line: bool = False) -> dict[str, object]:
    return {
        "type": "scatter3d",
        "mode": "lines+markers+text" if line else "markers+text",
        "name": name,
        **_columns(points),
        "text": [str(number + 1) for number in range(len(points))],
        "hoverinfo": "x+y+z+text+name",
        "textfont": {"size": 11, "color": look.INK},
        "marker": {"size": 5, "color": colour, "symbol": symbol, "line": {"color": "black", "width": 1}},
        "line": {"color": look.GREY, "width": 2},
    }


def _columns(points: FloatArray) -> dict[str, list[float]]:
    rounded = np.round(points, 4) + 0.0  # no -0.0: it would depend on the last digit
    return {axis: rounded[:, column].tolist() for column, axis in enumerate("xyz")}


def _axis(title: str) -> dict[str, object]:
    return {
        "title": {"text": title},
        "backgroundcolor": "white",
        "gridcolor": look.LIGHT,
        "showspikes": False,
        "nticks": 6,
    }


def _layout(scene: dict[str, object]) -> dict[str, object]:
    return {
        "scene": {**scene, "camera": {"eye": {"x": 1.1, "y": -1.4, "z": 0.8}}},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"orientation": "h", "y": 0.02, "itemsizing": "constant"},
        "paper_bgcolor": "white",
    }
