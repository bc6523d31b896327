"""The companions of θ̄: figures from the same end points that show what the score hides.

θ̄ telescopes: to first order it is the angle between the first and the last end point over the number of steps. One
real recording scores 0.547 degrees while its mean step is 2.251. So these figures always stand beside θ̄, and never
change it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.geometry import averages, rotations
from analysis.scoring.card import RotationDrift, rotation_drift
from analysis.series import FloatArray, OrientationSeries, SeriesError

MIN_EIGENVALUE_SHARE = 0.98
"""Below this the steps disagree so much (about 16 degrees) that their average says little; a warning."""


def leave_one_out(steps_wxyz: FloatArray) -> FloatArray:
    """Angle of the average step with each step left out in turn.

    Parameters
    ----------
    steps_wxyz
        (m, 4) step rotations, m ≥ 2.

    Returns
    -------
    (m,) rad; the first is θ̄ without the first end point, the last θ̄ without the last.
    """
    # Relative to the average of all, so that small differences between the answers are not lost in rounding.
    mean = averages.average(steps_wxyz)
    relative = rotations.difference(steps_wxyz, mean)
    outer = relative[:, :, None] * relative[:, None, :]
    tops = np.linalg.eigh(outer.sum(axis=0) - outer)[1][:, :, -1]
    return rotations.angle(rotations.multiply(tops, mean))


@dataclass(frozen=True, eq=False)
class DriftCompanions:
    """What θ̄ does not show, from the same end points. Degrees; world axes."""

    n_steps: int
    """Number of steps that count; every figure below comes from these, but poses, which are of all end points."""
    step_axes: FloatArray
    """(n−1, 3) unit axis of every step, also of those left out; zeros where a step is exactly nothing."""
    mean_step_deg: float
    """Mean of the step angles; far above θ̄ where the steps scatter."""
    median_step_deg: float
    """Median of the step angles."""
    dispersion_deg: float
    """Root mean square angle between the steps and their average r̄, with n−2 in the denominator."""
    axis_share: float
    """Share of the steps' squared rotation that lies along the drift axis, in [0, 1]."""
    net_rotation_deg: float
    """Angle from the first end point to the last, in [0, 180]."""
    max_excursion_deg: float
    """Largest angle of any end point from the first one."""
    without_first_deg: float | None
    """θ̄ without the first end point; None with fewer than 2 steps."""
    without_last_deg: float | None
    """θ̄ without the last end point."""
    leave_one_out_deg: tuple[float, float] | None
    """Smallest and largest θ̄ when one step is left out."""
    slope_deg_per_cycle: float
    """Length of the least-squares slope of pose (rotation vector) on cycle number: uses every end point."""
    slope_axis: FloatArray
    """(3,) unit axis of that slope."""
    top_eigenvalue_share: float
    """Largest eigenvalue of M over its trace; a warning below ``MIN_EIGENVALUE_SHARE``."""


def drift_companions(quats_wxyz: npt.ArrayLike, drift: RotationDrift | None = None) -> DriftCompanions:
    """Compute what stands beside θ̄, from the same end points.

    Parameters
    ----------
    quats_wxyz
        (n, 4) the end points that were scored.
    drift
        Their score, if it is at hand.

    Returns
    -------
    DriftCompanions

    Raises
    ------
    SeriesError
        Fewer than 2 end points.
    """
    quats = np.asarray(quats_wxyz, dtype=np.float64)
    if drift is None:
        drift = rotation_drift(quats)
    counted = drift.counted_step_rotations_wxyz
    vectors = rotations.log(counted)
    n_steps = len(vectors)
    steps_deg = np.degrees(rotations.angle(counted))
    squared = float(np.sum(vectors**2))
    residual = rotations.distance(counted, drift.mean_rotation_wxyz)
    left_out = np.degrees(leave_one_out(counted)) if n_steps >= 2 else None
    slope = pose_slope(vectors)
    slope_length = float(np.linalg.norm(slope))
    every = drift.step_rotvecs_rad
    lengths = np.linalg.norm(every, axis=1, keepdims=True)
    return DriftCompanions(
        n_steps=n_steps,
        step_axes=np.divide(every, lengths, out=np.zeros_like(every), where=lengths > 0.0),
        mean_step_deg=float(np.mean(steps_deg)),
        median_step_deg=float(np.median(steps_deg)),
        dispersion_deg=float(np.degrees(np.sqrt(np.sum(residual**2) / max(n_steps - 1, 1)))),
        axis_share=float(np.sum((vectors @ drift.axis) ** 2)) / squared if squared > 0.0 else 0.0,
        net_rotation_deg=float(np.degrees(rotations.distance(quats[-1], quats[0]))),
        max_excursion_deg=float(np.degrees(rotations.distance(quats, quats[0]).max())),
        without_first_deg=None if left_out is None else float(left_out[0]),
        without_last_deg=None if left_out is None else float(left_out[-1]),
        leave_one_out_deg=None if left_out is None else (float(left_out.min()), float(left_out.max())),
        slope_deg_per_cycle=float(np.degrees(slope_length)),
        slope_axis=slope / slope_length if slope_length > 0.0 else np.zeros(3),
        top_eigenvalue_share=drift.top_eigenvalue_share,
    )


def pose_slope(steps_rotvec_rad: FloatArray) -> FloatArray:
    """Least-squares slope of the pose on cycle number.

    The pose at end point k is the sum of the step rotation vectors up to it: for small steps the rotation vector from
    the first end point, and it does not fold back at half a turn as that one does.

    Parameters
    ----------
    steps_rotvec_rad
        (n−1, 3) rotation vectors of the steps in world axes, rad, n ≥ 2.

    Returns
    -------
    (3,) rad per cycle, world axes.
    """
    poses = np.concatenate((np.zeros((1, 3)), np.cumsum(steps_rotvec_rad, axis=0)))
    cycle = np.arange(len(poses)) - (len(poses) - 1) / 2.0
    return np.asarray(cycle @ poses / (cycle @ cycle), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class PhaseSweep:
    """θ̄ taken at other phases of the same cycles: how much the choice of phase matters."""

    n_cycles: int
    """Cycles between the first and the last end point."""
    phases: FloatArray
    """(p,) fraction of a cycle after the end point, [0, 1)."""
    theta_bar_deg: FloatArray
    """(p,) θ̄ of the same cycles at that phase; n_cycles − 1 steps each."""


def drift_over_phase(series: OrientationSeries, endpoint_times_s: Sequence[float], n_phases: int = 16) -> PhaseSweep:
    """Score the same cycles at evenly spaced phases.

    Parameters
    ----------
    series
        The recording.
    endpoint_times_s
        (n,) end point times, s, increasing, in the recording's own time.
    n_phases
        How many phases.

    Returns
    -------
    PhaseSweep

    Raises
    ------
    SeriesError
        Fewer than 3 end points: at phases between two end points there is one pose less than end points.
    """
    times = np.asarray(endpoint_times_s, dtype=np.float64)
    if len(times) < 3:
        raise SeriesError(f"θ̄ over phase needs at least 3 end points, got {len(times)}")
    phases = np.arange(n_phases) / n_phases
    # Every phase is scored on the same number of steps, also phase 0, which could use one more.
    at = times[:-1] + phases[:, None] * np.diff(times)
    poses = orientation_at(series, at)
    return PhaseSweep(
        n_cycles=len(times) - 1,
        phases=phases,
        theta_bar_deg=np.array([rotation_drift(row).theta_bar_deg for row in poses]),
    )


def orientation_at(series: OrientationSeries, times_s: npt.ArrayLike) -> FloatArray:
    """Orientation at any time inside the recording, interpolated at constant rate of turn between samples.

    Parameters
    ----------
    series
        The recording, at least 2 samples.
    times_s
        (...) s, the recording's own time; outside it the end sample is taken.

    Returns
    -------
    (..., 4) unit, scalar first.
    """
    times = np.asarray(times_s, dtype=np.float64)
    after = np.clip(np.searchsorted(series.times_s, times, side="right"), 1, len(series) - 1)
    start, end = series.times_s[after - 1], series.times_s[after]
    fraction = np.clip((times - start) / (end - start), 0.0, 1.0)
    return rotations.slerp(series.quats_wxyz[after - 1], series.quats_wxyz[after], fraction)
