"""A slip: few steps that are far larger than all others, and how much of θ̄ they make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry import averages, rotations
from analysis.scoring.card import RotationDrift

MIN_STEPS = 4
"""Fewer steps do not show what is usual."""
_MADS, _MEDIANS, _LEAST_DEG = 4.0, 2.5, 0.1


@dataclass(frozen=True)
class Slip:
    """Steps that stand out, and θ̄ without them. Degrees."""

    steps: tuple[int, ...]
    """Numbers of the steps, from 0, in time order."""
    largest_deg: float
    """Angle of the largest of them."""
    usual_deg: float
    """Median angle of the steps that count."""
    share: float
    """Part of θ̄ that they make: their turn about the drift axis over that of all steps; below 0 against it."""
    theta_bar_deg: float
    """θ̄ with them."""
    rest_deg: float
    """θ̄ without them."""

    @property
    def sentence(self) -> str:
        """What a reader of θ̄ has to know."""
        names = ", ".join(str(step + 1) for step in self.steps)
        what = f"the step of cycle {names} is" if len(self.steps) == 1 else f"the steps of cycles {names} are"
        return (
            f"slip: {what} {'' if len(self.steps) == 1 else 'up to '}{self.largest_deg:.2f}° where "
            f"{self.usual_deg:.2f}° is usual, and {self.effect}: no steady creep"
        )

    @property
    def effect(self) -> str:
        """How much of θ̄ they make, and what the rest is."""
        rest = f"{self.rest_deg:.2f}° without {'it' if len(self.steps) == 1 else 'them'}"
        if self.share <= 0.0:
            return f"works against the other steps: θ̄ is {self.theta_bar_deg:.2f}°, {rest}"
        makes = "makes" if len(self.steps) == 1 else "make"
        return f"{makes} {min(self.share, 1.0):.0%} of θ̄ ({self.theta_bar_deg:.2f}°, {rest})"


def find_slip(drift: RotationDrift) -> Slip | None:
    """Return the steps above median + 4 median absolute deviations and 2.5 medians; None where there are none.

    Steps that differ from the median by less than 0.1° are none: there, rounding and the sensor's noise make such
    ratios.

    Parameters
    ----------
    drift : RotationDrift
        A score and its steps; steps left out count nowhere.
    """
    counted = drift.counted_step_rotations_wxyz
    if len(counted) < MIN_STEPS:
        return None
    angles_deg = np.degrees(rotations.angle(counted))
    usual = float(np.median(angles_deg))
    spread = float(np.median(np.abs(angles_deg - usual)))
    slipped = angles_deg > max(usual + max(_MADS * spread, _LEAST_DEG), _MEDIANS * usual)
    if not slipped.any():
        return None
    turns = rotations.log(counted) @ drift.axis
    total = float(turns.sum())
    numbers = np.delete(np.arange(len(drift.step_rotations_wxyz)), drift.left_out)[slipped]
    return Slip(
        steps=tuple(numbers.tolist()),
        largest_deg=float(angles_deg.max()),
        usual_deg=usual,
        share=float(turns[slipped].sum()) / total if total > 0.0 else 0.0,
        theta_bar_deg=drift.theta_bar_deg,
        rest_deg=float(np.degrees(rotations.angle(averages.average(counted[~slipped])))),
    )
