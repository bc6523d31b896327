"""The benchmark's score θ̄, exactly as the card says, and the figures that show what it hides.

Card RAL-SI-2020-B19-0838.4-V1.0, "Scoring". With q_1 … q_n the orientations at the end points:

    r_i = q_{i+1} ⊗ q_i⁻¹                    step 2, :func:`step_rotations`
    M = Σ r_i r_iᵀ,  r̄ = its top eigenvector   step 3, :func:`analysis.geometry.averages.average`
    θ̄ = 2·acos(|a|), a the scalar part of r̄    step 4, :func:`rotation_drift`; computed as 2·atan2(|v|, |a|)

θ̄ depends, to first order, on the first and the last end point only and hides the scatter of the steps.
:mod:`analysis.scoring.diagnostics` makes that visible; it never changes θ̄.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.geometry import averages, rotations
from analysis.series import FloatArray, SeriesError


@dataclass(frozen=True, eq=False)
class RotationDrift:
    """θ̄ and what it was made of; world axes."""

    theta_bar_rad: float
    """θ̄: angle of the average step, rad, in [0, π]."""
    mean_rotation_wxyz: FloatArray
    """(4,) r̄, unit, scalar part ≥ 0."""
    axis: FloatArray
    """(3,) unit axis of r̄ in the world frame; zeros when there is no drift at all."""
    step_rotations_wxyz: FloatArray
    """(n−1, 4) the r_i, scalar part ≥ 0."""
    top_eigenvalue_share: float
    """Largest eigenvalue of M over its trace; 1 when all steps agree."""
    left_out: tuple[int, ...] = ()
    """Steps, from 0, that are kept here but do not count for r̄, by a person's decision."""

    @property
    def theta_bar_deg(self) -> float:
        """θ̄ in degrees."""
        return float(np.degrees(self.theta_bar_rad))

    @property
    def counted_step_rotations_wxyz(self) -> FloatArray:
        """(m, 4) the steps that count: all but those left out."""
        return np.delete(self.step_rotations_wxyz, self.left_out, axis=0) if self.left_out else self.step_rotations_wxyz

    @property
    def steps_deg(self) -> FloatArray:
        """(n−1,) angle of every step, degrees, in [0, 180]."""
        return np.degrees(rotations.angle(self.step_rotations_wxyz))


def step_rotations(quats_wxyz: npt.ArrayLike) -> FloatArray:
    """Return the left differences r_i = q_{i+1} ⊗ q_i⁻¹ of orientations in cycle order; card step 2.

    Parameters
    ----------
    quats_wxyz : (n, 4) array_like
        Unit, scalar first, body to world.

    Returns
    -------
    (n−1, 4) world-frame rotations, scalar part ≥ 0.

    Raises
    ------
    SeriesError
        Fewer than 2 orientations.
    """
    quats = np.asarray(quats_wxyz, dtype=np.float64)
    if quats.ndim != 2 or quats.shape[1] != 4 or len(quats) < 2:
        raise SeriesError(f"a drift needs at least 2 end points as (n, 4) quaternions, got shape {quats.shape}")
    steps = rotations.difference(quats[1:], quats[:-1])
    return np.where(steps[:, :1] < 0.0, -steps, steps)


def rotation_drift(quats_wxyz: npt.ArrayLike, left_out: Sequence[int] = ()) -> RotationDrift:
    """Return the score of end points by the card: steps, average, θ̄.

    Parameters
    ----------
    quats_wxyz : (n, 4) array_like
        Unit orientations at the end points in cycle order, scalar first, body to world, one per cycle at the
        same phase; n ≥ 2.
    left_out : sequence of int, optional
        Steps, from 0, that do not count: a person excluded these cycles. The card knows no such thing; whoever reports
        a score has to report that.

    Raises
    ------
    SeriesError
        Fewer than 2 end points, no step left, or a step that is not there.
    """
    steps = step_rotations(quats_wxyz)
    without = tuple(sorted(set(left_out)))
    if without and not 0 <= without[0] <= without[-1] < len(steps):
        raise SeriesError(f"there are {len(steps)} steps, from 0; {without} cannot be left out")
    if len(without) == len(steps):
        raise SeriesError("every step is left out: no drift remains")
    mean, share = averages.average_and_share(np.delete(steps, without, axis=0) if without else steps)
    length = float(np.linalg.norm(mean[1:]))
    return RotationDrift(
        theta_bar_rad=float(rotations.angle(mean)),
        mean_rotation_wxyz=mean,
        axis=mean[1:] / length if length > 0.0 else np.zeros(3),
        step_rotations_wxyz=steps,
        top_eigenvalue_share=share,
        left_out=without,
    )


def translation_drift_mm(positions_m: npt.ArrayLike) -> float:
    """Return the translation drift of the authors' scripts: ‖mean of the differences of successive positions‖.

    Parameters
    ----------
    positions_m : (n, 3) array_like
        Positions at the end points, m, n ≥ 2.

    Returns
    -------
    mm per cycle.

    Raises
    ------
    SeriesError
        Fewer than 2 positions.
    """
    positions = np.asarray(positions_m, dtype=np.float64)
    if positions.ndim != 2 or len(positions) < 2:
        raise SeriesError(f"a translation drift needs at least 2 positions, got shape {positions.shape}")
    return float(np.linalg.norm(np.diff(positions, axis=0).mean(axis=0)) * 1000.0)
