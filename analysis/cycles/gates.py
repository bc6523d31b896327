"""Which extremes at the two ends of a run are end points of its cycles; the inside is never touched.

Before the first cycle and after the last one the object is put in place, grasped, released or dropped. What that leaves
at the ends of a run looks like an extreme, but not one of the motion.
"""

from __future__ import annotations

import numpy as np

from analysis.cycles.endpoints import Extremes, pose_jumps
from analysis.cycles.settings import CycleSettings, LeftOut
from analysis.geometry import rotations
from analysis.series import FloatArray

_MIN_KEPT = 4
"""A grasp is left out of more end points than this: fewer would make no score, and do not show what is usual."""
_OUTLIER = 4.0 * 1.4826
"""Distance from the median that is not usual, in median absolute deviations: 4 standard deviations of normal values."""
_SAME_SPACING, _SAME_DWELL = 0.1, 0.25
"""Differences that are usual however even the cycles are, as a share."""


def gate_ends(
    extremes: Extremes, run: slice, period_s: float, settings: CycleSettings, *, any_tempo: bool = False
) -> tuple[slice, list[LeftOut]]:
    """Leave out idle poses and irregular cycles at the two ends of a run; the inside is never touched.

    Parameters
    ----------
    extremes : Extremes
        All extremes of one kind.
    run : slice
        Which of them.
    period_s : float
        Length of a cycle, s.
    settings : CycleSettings
        What is regular.
    any_tempo : bool, optional
        Tempo changes so much that the length of a cycle is judged by that of the next one.

    Returns
    -------
    run, left_out
        What remains, and what was taken off with the reason.
    """
    first, last = run.start, run.stop
    left_out: list[LeftOut] = []
    usual_dwell_s = float(np.median([point.dwell_s for point in extremes.endpoints[run]]))
    times_s = [point.time_s for point in extremes.endpoints]

    def usual_s(inner: int, further: int) -> float:
        return abs(times_s[further] - times_s[inner]) if any_tempo and last - first >= 3 else period_s

    while last - first >= 2 and (
        why := _irregular(extremes, first, first + 1, usual_s(first + 1, first + 2), usual_dwell_s, settings)
    ):
        left_out.append(LeftOut(extremes.endpoints[first].time_s, f"first cycle: {why}", primary=False))
        first += 1
    while last - first >= 2 and (
        why := _irregular(extremes, last - 1, last - 2, usual_s(last - 2, last - 3), usual_dwell_s, settings)
    ):
        left_out.append(LeftOut(extremes.endpoints[last - 1].time_s, f"last cycle: {why}", primary=False))
        last -= 1
    return slice(first, last), left_out


def _irregular(
    extremes: Extremes, end: int, inner: int, period_s: float, usual_dwell_s: float, settings: CycleSettings
) -> str:
    """Return why the extreme at an end of a run is not an end point; empty where it is one."""
    points = extremes.endpoints
    spacing = abs(points[inner].time_s - points[end].time_s) / period_s
    outward, inward = extremes.inner_swing[end][[0, 1] if inner > end else [1, 0]].tolist()
    if outward < settings.hysteresis:
        return "the pose before the motion or after it"
    if points[end].dwell_s > 2.0 * usual_dwell_s + 0.25 * period_s:
        return f"idle pose, held {points[end].dwell_s:.2f} s"
    paused = spacing > settings.pause and extremes.goes_on[min(inner, end)]
    if not (paused or settings.spacing[0] <= spacing <= settings.spacing[1]):
        return f"{spacing:.2f} periods from the next"
    if not settings.swing[0] <= inward <= settings.swing[1]:
        return f"swing of {inward:.2f} times the usual"
    return ""


def leave_out_grasp(extremes: Extremes, run: slice, settings: CycleSettings) -> tuple[slice, list[LeftOut]]:
    """Leave out the end points at which the hand takes hold of the object or lets go of it.

    There the object moves as the motion does not: the first or the last step is a pose jump. So is that of a slip. The
    cycle separates the two: a slip moves the object in the hand, and the hand turns on in time. A grasp or a
    release changes how long the cycle takes, how long the object stays at its end, or where it came from. A jump at the
    end of a cycle that is regular in all three stays, as a jump anywhere inside does.

    Parameters
    ----------
    extremes : Extremes
        All extremes of one kind.
    run : slice
        Which of them, the irregular ones at its ends left out already.
    settings : CycleSettings
        What is regular.

    Returns
    -------
    run, left_out
        What remains, and what was taken off with the reason.
    """
    first, last = run.start, run.stop
    left_out: list[LeftOut] = []
    while last - first > _MIN_KEPT and (why := _grasped(extremes, first, range(first, last), settings)):
        left_out.append(
            LeftOut(extremes.endpoints[first].time_s, f"first cycle: the grasp: {why}", primary=False, grasp=True)
        )
        first += 1
    while last - first > _MIN_KEPT and (why := _grasped(extremes, last - 1, range(first, last), settings)):
        left_out.append(
            LeftOut(extremes.endpoints[last - 1].time_s, f"last cycle: the release: {why}", primary=False, grasp=True)
        )
        last -= 1
    return slice(first, last), left_out


def _grasped(extremes: Extremes, end: int, run: range, settings: CycleSettings) -> str:
    """Return why the extreme at an end of a run is one of a grasp or a release; empty where it is an end point."""
    points = [extremes.endpoints[k] for k in run]
    at_start = end == run.start
    quats = np.array([point.quat_wxyz for point in points])
    jumps, steps_deg = pose_jumps(quats), np.degrees(rotations.distance(quats[1:], quats[:-1]))
    step = 0 if at_start else -1
    if not jumps[step]:
        return ""
    spacing_s, dwell_s = np.diff([point.time_s for point in points]), np.array([point.dwell_s for point in points])
    outward = float(extremes.inner_swing[end][0 if at_start else 1])
    odd = []
    if (times := _unusual(spacing_s, step, _SAME_SPACING)) is not None:
        odd.append(f"the cycle lasts {times:.2f} times the usual")
    if (times := _unusual(dwell_s, step, _SAME_DWELL)) is not None:
        odd.append(f"the object stays {times:.2f} times as long as usual")
    if not settings.swing[0] <= outward <= settings.swing[1]:
        odd.append(f"the travel {'to' if at_start else 'from'} it is {outward:.2f} times the usual")
    if not odd:
        return ""
    usual_deg = float(np.median(np.delete(steps_deg, step)))
    return f"a step of {steps_deg[step]:.2f}° where {usual_deg:.2f}° is usual, and {', '.join(odd)}"


def _unusual(values: FloatArray, at: int, same: float) -> float | None:
    """Return a value as a share of the median of the others; None where it is usual among them."""
    others = np.delete(values, at)
    middle = float(np.median(others))
    spread = _OUTLIER * float(np.median(np.abs(others - middle)))
    apart = abs(float(values[at]) - middle)
    return float(values[at]) / max(middle, 1e-12) if apart > max(spread, same * middle) else None
