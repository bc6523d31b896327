"""Point clouds of a recording, with its end points: the arrays behind the printed and the interactive figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.geometry import rotations
from analysis.scoring.diagnostics import positions_at
from analysis.scoring.result import Result
from analysis.series import FloatArray, OrientationSeries

MAX_CLOUD_POINTS = 3000
"""More cannot be distinguished in print, and a report stays small."""
BODY_AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Clouds:
    """m samples and n end points of one recording, ready to draw."""

    times_s: FloatArray
    """(m,) time since the first sample, s."""
    scored: npt.NDArray[np.bool_]
    """(m,) whether the sample lies between the first and the last end point."""
    rotvecs_deg: FloatArray
    """(m, 3) rotation vector from the first end point, world frame, deg; continuous beyond 180."""
    axes: FloatArray
    """(3, m, 3) the object's x, y and z axis in the world frame: points on the unit sphere."""
    positions_mm: FloatArray | None
    """(m, 3) position from that of the first end point, world frame, mm."""
    endpoint_rotvecs_deg: FloatArray
    """(n, 3) as ``rotvecs_deg``."""
    endpoint_axes: FloatArray
    """(3, n, 3) as ``axes``."""
    endpoint_positions_mm: FloatArray | None
    """(n, 3) as ``positions_mm``."""


def clouds_of(series: OrientationSeries, result: Result, max_points: int = MAX_CLOUD_POINTS) -> Clouds:
    """Return the clouds of a scored recording; more than ``max_points`` samples are thinned evenly."""
    times_s, quats = result.endpoint_times_s, result.endpoint_quats_wxyz
    step = max(1, -(-len(series) // max_points))
    rows = np.arange(0, len(series), step)
    reference = quats[0] if len(quats) else series.quats_wxyz[0]
    # One sign-continuous track through samples and end points together, so that both are on the same branch.
    all_times = np.concatenate((series.times_s[rows], times_s))
    order = np.argsort(all_times, kind="stable")
    everything = np.concatenate((series.quats_wxyz[rows], quats))
    relative = rotations.difference(everything[order], reference)
    anchor = int(np.flatnonzero(order >= len(rows))[0]) if len(quats) else 0
    track = rotations.continuous_signs(relative)
    track = -track if track[anchor, 0] < 0.0 else track
    vectors = np.empty((len(order), 3))
    vectors[order] = np.degrees(_full_log(track))
    positions_mm, endpoint_positions_mm, at_endpoints = None, None, positions_at(series, times_s)
    if series.positions_m is not None and at_endpoints is not None:
        origin = at_endpoints[0] if len(times_s) else series.positions_m[0]
        positions_mm = (series.positions_m[rows] - origin) * 1000.0
        endpoint_positions_mm = (at_endpoints - origin) * 1000.0
    start_s, end_s = (times_s[0], times_s[-1]) if len(times_s) else (np.inf, -np.inf)
    samples_s = series.times_s[rows]
    return Clouds(
        times_s=samples_s - series.times_s[0],
        scored=(samples_s >= start_s) & (samples_s <= end_s),
        rotvecs_deg=vectors[: len(rows)],
        axes=np.stack([rotations.rotate(series.quats_wxyz[rows], axis) for axis in np.eye(3)]),
        positions_mm=positions_mm,
        endpoint_rotvecs_deg=vectors[len(rows) :],
        endpoint_axes=np.stack([rotations.rotate(quats, axis) for axis in np.eye(3)]),
        endpoint_positions_mm=endpoint_positions_mm,
    )


def turn_about_axis(series: OrientationSeries, axis: npt.ArrayLike | None) -> tuple[FloatArray, FloatArray]:
    """Return the angle turned about a fixed axis since the first sample, not limited to ±180 degrees.

    Parameters
    ----------
    series : OrientationSeries
        The recording.
    axis : (3,) array_like or None
        Unit axis, world frame; None for the axis with most of the motion.

    Returns
    -------
    angle_deg
        (m,) sum of the increments along the axis.
    axis
        (3,) the axis used.
    """
    increments = rotations.log(rotations.difference(series.quats_wxyz[1:], series.quats_wxyz[:-1]))
    if axis is None:
        values, vectors = np.linalg.eigh(increments.T @ increments)
        main = vectors[:, int(np.argmax(values))]
        used = main * np.sign(main[np.argmax(np.abs(main))])
    else:
        used = np.asarray(axis, dtype=np.float64)
    angle = np.concatenate(([0.0], np.cumsum(increments @ used)))
    return np.degrees(angle), used


def _full_log(quats: FloatArray) -> FloatArray:
    """Return (m, 3) rotation vectors by the sign given, length in [0, 2π): continuous where the quaternions are."""
    length = np.linalg.norm(quats[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(length, quats[:, 0])
    factor: FloatArray = np.divide(angle, length, out=np.full_like(length, 2.0), where=length > 1e-12)
    return quats[:, 1:] * factor[:, None]
