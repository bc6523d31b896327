"""From an extreme just confirmed to an end point: the middle of its dwell in the recent past."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.cycles.online.angle import BIN_S, AnglePoint
from analysis.cycles.settings import CycleSettings, Endpoint
from analysis.cycles.turning_points import dwell
from analysis.geometry import averages
from analysis.series import FloatArray

_SMOOTH_S = 0.04
_PUT_IN_PLACE_S = 2.0


def place_endpoint(
    points: Sequence[AnglePoint],
    extreme: AnglePoint,
    *,
    usual_rad: float,
    period_s: float,
    settings: CycleSettings,
) -> tuple[Endpoint, bool]:
    """Find the dwell around an extreme and the orientation in the middle of it.

    Parameters
    ----------
    points : sequence of AnglePoint
        From the turning point before (or from where memory starts) to now; at least two.
    extreme : AnglePoint
        The one among them.
    usual_rad : float
        Usual swing, rad.
    period_s : float
        Length of a cycle, s; 0 where unknown: then twice the time it took to come here.
    settings : CycleSettings
        Depth of the dwell, width of the average, largest gap.

    Returns
    -------
    endpoint, put_in_place
        The end point, and whether the object was brought here quickly and then held: a start pose, if it is the
        first extreme.
    """
    times_s = np.array([point.time_s for point in points])
    angle = np.array([point.angle_rad for point in points])
    angle = _smoothed(angle, times_s, max(_SMOOTH_S, period_s / 200.0))
    travel = abs(extreme.angle_rad - points[0].angle_rad)
    sign = 1.0 if extreme.angle_rad > points[-1].angle_rad else -1.0
    middle = int(np.searchsorted(times_s, extreme.time_s))
    near = slice(max(middle - 8, 0), middle + 9)  # smoothing moves the extreme a little
    middle = near.start + int(np.argmax(sign * angle[near]))
    # The depth is that of the offline search: a share of the usual swing, or of the largest swing for which this travel
    # would still count, where it is less.
    depth = settings.dwell_depth * min(travel / settings.hysteresis, usual_rad)
    ends = dwell(angle, middle, 0, len(angle) - 1, depth)
    from_s, to_s = np.interp(ends, np.arange(len(times_s)), times_s).tolist()
    time_s = 0.5 * (from_s + to_s)
    # How long it took to come here: from leaving the point before.
    moved = np.flatnonzero(np.abs(angle - angle[0]) > settings.dwell_depth * travel)
    rise_s = from_s - float(times_s[moved[0]]) if len(moved) else 0.0
    # The orientation is an average around the middle, as offline; of at least the nearest three points.
    distance_s = np.abs(times_s - time_s)
    third_s = float(np.sort(distance_s)[min(3, len(distance_s) - 1)])
    period_s = period_s or 2.0 * (rise_s + 0.5 * (to_s - from_s))
    reach_s = max(settings.average * period_s, third_s, 1e-9)
    rows = np.flatnonzero(distance_s < reach_s)
    gap_s = float(np.diff(times_s[max(int(rows[0]) - 1, 0) : int(rows[-1]) + 2]).max())
    endpoint = Endpoint(
        time_s=time_s,
        index=points[int(np.argmin(distance_s))].index,
        quat_wxyz=averages.average([points[row].quat_wxyz for row in rows.tolist()], 1.0 - distance_s[rows] / reach_s),
        dwell_s=to_s - from_s,
        prominence_deg=math.degrees(travel),
        flags=("gap nearby",) if gap_s > max(settings.max_gap * period_s, 3.0 * BIN_S) else (),
    )
    return endpoint, to_s - from_s > max(_PUT_IN_PLACE_S, 3.0 * rise_s)


def _smoothed(angle: FloatArray, times_s: FloatArray, sigma_s: float) -> FloatArray:
    """Smooth evenly spaced points with a Gaussian; the ends are held."""
    sigma = sigma_s / max(float(np.median(np.diff(times_s))), 1e-9)
    sigma = min(sigma, float(len(angle)))  # of a cycle that spans a clock that was set: no wider than what there is
    reach = int(3.0 * sigma)
    if reach < 1 or len(angle) < 3:
        return angle
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    padded = np.concatenate((np.full(reach, angle[0]), angle, np.full(reach, angle[-1])))
    return np.convolve(padded, weights / weights.sum(), mode="valid")
