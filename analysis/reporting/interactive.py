"""The interactive clouds of the HTML report: values for plotly.js, and the script itself, compressed.

Only plotly's 3-D bundle is shipped (``assets/``), and in a report it stands compressed: the browser unpacks it. The
Python package of plotly is not needed and not used.
"""

from __future__ import annotations

import base64
from pathlib import Path
from typing import TypeAlias

import numpy as np

from analysis.reporting import style
from analysis.reporting.clouds import BODY_AXES, Clouds, clouds_of
from analysis.reporting.trial_report import TrialReport
from analysis.series import FloatArray

BUNDLE = Path(__file__).parent / "assets" / "plotly-gl3d.min.js.gz"
MAX_POINTS = 2000
Values: TypeAlias = dict[str, object]
"""An object of plotly.js: a trace, or a scene with its ``title``, ``data`` and ``layout``."""
_PLOTLY_MARKERS = ("circle", "diamond", "square")


def plotly_base64() -> str:
    """Return the 3-D bundle of plotly.js: gzip, as base64."""
    return base64.b64encode(BUNDLE.read_bytes()).decode("ascii")


def scenes(trial: TrialReport) -> list[Values]:
    """Return the 3-D scenes of a trial: rotation, its end points alone, object axes, and translation where known.

    They are in the order of the tabs.
    """
    clouds = clouds_of(trial.series, trial.result, MAX_POINTS)
    points, names = clouds.endpoint_rotvecs_deg, ("rx", "ry", "rz")
    found = [_cloud_scene("Rotation (°)", clouds, clouds.rotvecs_deg, points, names, "°")]
    if len(points) > 1:
        alone = _endpoints("end points", points, style.VERMILION, "circle", line=True)
        found.append(_scene("Its end points alone (°)", [alone], points, names, "°"))
    found.append(_axes_scene(clouds))
    positions, points_mm = clouds.positions_mm, clouds.endpoint_positions_mm
    if positions is not None and points_mm is not None:
        found.append(_cloud_scene("Translation (mm)", clouds, positions, points_mm, ("x", "y", "z"), "mm"))
    return found


def _cloud_scene(
    title: str, clouds: Clouds, cloud: FloatArray, points: FloatArray, names: tuple[str, str, str], unit: str
) -> Values:
    data = [
        _cloud("before and after", cloud[~clouds.scored], style.LIGHT, clouds.times_s[~clouds.scored]),
        _cloud("first to last end point", cloud[clouds.scored], style.BLUE, clouds.times_s[clouds.scored]),
        _endpoints("end points", points, style.VERMILION, "circle", line=True),
    ]
    return _scene(title, data, np.concatenate((cloud, points)), names, unit)


def _scene(title: str, data: list[Values], values: FloatArray, names: tuple[str, str, str], unit: str) -> Values:
    extent = np.ptp(values, axis=0)
    largest = max(float(extent.max()), 1e-6)
    # Equal scales on all axes; a flat cloud gets room around it, so that the box is never thinner than half.
    half = 0.53 * np.maximum(extent, largest / 2.0)
    middle = 0.5 * (values.max(axis=0) + values.min(axis=0))
    axes: Values = {}
    for column, (axis, name) in enumerate(zip("xyz", names, strict=True)):
        ends = [round(float(middle[column] - half[column]), 4), round(float(middle[column] + half[column]), 4)]
        axes[f"{axis}axis"] = {**_axis(f"{name} ({unit})"), "range": ends}
    ratio = {axis: round(float(half[column] / half.max()), 4) for column, axis in enumerate("xyz")}
    return {"title": title, "data": data, "layout": _layout({**axes, "aspectmode": "manual", "aspectratio": ratio})}


def _axes_scene(clouds: Clouds) -> Values:
    data = []
    for number, name in enumerate(BODY_AXES):
        colour = style.AXIS_COLOURS[number]
        data.append(_cloud(f"object {name}", clouds.axes[number], colour, clouds.times_s))
        data.append(_endpoints(f"{name} at end points", clouds.endpoint_axes[number], colour, _PLOTLY_MARKERS[number]))
    axes = {f"{axis}axis": {**_axis(f"world {axis.upper()}"), "range": [-1.1, 1.1]} for axis in "xyz"}
    return {"title": "Object axes on the sphere", "data": data, "layout": _layout({**axes, "aspectmode": "cube"})}


def _cloud(name: str, points: FloatArray, colour: str, times_s: FloatArray) -> Values:
    texts = [f"{time_s:.2f} s" for time_s in times_s]
    return {**_trace(name, "markers", points, texts), "marker": {"size": 2, "color": colour, "opacity": 0.7}}


def _endpoints(name: str, points: FloatArray, colour: str, symbol: str, *, line: bool = False) -> Values:
    numbers = [str(number + 1) for number in range(len(points))]
    return {
        **_trace(name, "lines+markers+text" if line else "markers+text", points, numbers),
        "textfont": {"size": 11, "color": style.INK},
        "marker": {"size": 5, "color": colour, "symbol": symbol, "line": {"color": "black", "width": 1}},
        "line": {"color": style.GREY, "width": 2},
    }


def _trace(name: str, mode: str, points: FloatArray, texts: list[str]) -> Values:
    rounded = np.round(points, 4) + 0.0  # no -0.0: it would depend on the last digit
    columns = {axis: rounded[:, column].tolist() for column, axis in enumerate("xyz")}
    named = {"type": "scatter3d", "mode": mode, "name": name}
    return {**named, **columns, "text": texts, "hoverinfo": "x+y+z+text+name"}


def _axis(title: str) -> Values:
    grid = {"backgroundcolor": "white", "gridcolor": style.LIGHT, "showspikes": False, "nticks": 6}
    return {"title": {"text": title}, **grid}


def _layout(scene: Values) -> Values:
    return {
        "scene": {**scene, "camera": {"eye": {"x": 1.1, "y": -1.4, "z": 0.8}}},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "legend": {"orientation": "h", "y": 0.02, "itemsizing": "constant"},
        "paper_bgcolor": "white",
    }
