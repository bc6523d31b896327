"""The diagnostics of θ̄: figures from the same end points that show what the score hides.

θ̄ telescopes: to first order it is the angle between the first and the last end point over the number of steps. One
real recording scores 0.547 degrees while its mean step is 2.251. So these figures always stand beside θ̄, and never
change it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from analysis.geometry import rotations
from analysis.scoring.card import RotationDrift, rotation_drift
from analysis.scoring.interval import leave_one_out
from analysis.scoring.result_parts import Diagnostics, PhaseSweep, quaternion_of, vector_of
from analysis.series import FloatArray, OrientationSeries, SeriesError

MIN_EIGENVALUE_SHARE = 0.98
"""Below this the steps disagree so much (about 16 degrees) that their average means little; a warning."""


def drift_diagnostics(quats: FloatArray, drift: RotationDrift) -> Diagnostics:
    """Return what stands beside θ̄, from the same end points; the caller adds what needs more than these.

    Parameters
    ----------
    quats : (n, 4) float64
        The end points that were scored, scalar first.
    drift : RotationDrift
        Their score.
    """
    counted = drift.counted_step_rotations_wxyz
    vectors = rotations.log(counted)
    n_steps = len(vectors)
    steps_deg = np.degrees(rotations.angle(counted))
    squared = float(np.sum(vectors**2))
    residual = rotations.distance(counted, drift.mean_rotation_wxyz)
    left_out = np.degrees(leave_one_out(counted)) if n_steps >= 2 else None
    slope = pose_slope(vectors)
    slope_length = float(np.linalg.norm(slope))
    every = rotations.log(drift.step_rotations_wxyz)
    lengths = np.linalg.norm(every, axis=1, keepdims=True)
    return Diagnostics(
        n_steps=n_steps,
        step_axes=tuple(map(vector_of, np.divide(every, lengths, out=np.zeros_like(every), where=lengths > 0.0))),
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
        slope_axis=vector_of(slope / slope_length) if slope_length > 0.0 else (0.0, 0.0, 0.0),
        top_eigenvalue_share=drift.top_eigenvalue_share,
        mean_rotation_wxyz=quaternion_of(drift.mean_rotation_wxyz),
    )


def pose_slope(steps_rotvec_rad: FloatArray) -> FloatArray:
    """Return the least-squares slope of the pose on cycle number.

    The pose at end point k is the sum of the step rotation vectors up to it: for small steps the rotation vector from
    the first end point, and it does not fold back at half a turn as that one does.

    Parameters
    ----------
    steps_rotvec_rad : (n−1, 3) float64
        Rotation vectors of the steps in world axes, rad, n ≥ 2.

    Returns
    -------
    (3,) rad per cycle, world axes.
    """
    poses = np.concatenate((np.zeros((1, 3)), np.cumsum(steps_rotvec_rad, axis=0)))
    cycle = np.arange(len(poses)) - (len(poses) - 1) / 2.0
    return np.asarray(cycle @ poses / (cycle @ cycle), dtype=np.float64)


def drift_over_phase(series: OrientationSeries, endpoint_times_s: npt.ArrayLike, n_phases: int = 16) -> PhaseSweep:
    """Return θ̄ of the same cycles at evenly spaced phases.

    Parameters
    ----------
    series : OrientationSeries
        The recording.
    endpoint_times_s : (n,) array_like
        End point times, s, increasing, in the recording's own time.
    n_phases : int, optional
        How many phases.

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
    thetas_deg = tuple(rotation_drift(row).theta_bar_deg for row in poses)
    return PhaseSweep(min(thetas_deg), max(thetas_deg), tuple(phases.tolist()), thetas_deg, len(times) - 1)


def positions_at(series: OrientationSeries, times_s: FloatArray) -> FloatArray | None:
    """Return the (n, 3) positions at n times inside the recording, m; None where it has none."""
    if series.positions_m is None:
        return None
    return np.stack([np.interp(times_s, series.times_s, column) for column in series.positions_m.T], axis=1)


def orientation_at(series: OrientationSeries, times_s: npt.ArrayLike) -> FloatArray:
    """Return the orientation at any time inside the recording, interpolated at constant rate of turn between samples.

    Parameters
    ----------
    series : OrientationSeries
        The recording, at least 2 samples.
    times_s : (...) array_like
        s, the recording's own time; outside it the end sample counts.

    Returns
    -------
    (..., 4) unit, scalar first.
    """
    times = np.asarray(times_s, dtype=np.float64)
    after = np.clip(np.searchsorted(series.times_s, times, side="right"), 1, len(series) - 1)
    start, end = series.times_s[after - 1], series.times_s[after]
    fraction = np.clip((times - start) / (end - start), 0.0, 1.0)
    return rotations.slerp(series.quats_wxyz[after - 1], series.quats_wxyz[after], fraction)
