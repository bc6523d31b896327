"""The running score of a live trial: end points in, rows and θ̄ out; the operator's window and exclusions honoured."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from analysis.cycles.settings import Endpoint
from analysis.geometry import rotations
from analysis.scoring.card import RotationDrift, rotation_drift
from analysis.scoring.interval import MIN_STEPS, DriftInterval, drift_interval, steps_needed
from analysis.scoring.slip import find_slip
from host.trial.state import MISSED, OUTSIDE, CycleRow, Quaternion, WindowView, plain_quaternion

MAX_ROWS = 200
"""Cycles kept as rows; the score is of all."""
EVERY_CYCLE = 100
"""Up to so many end points the interval is computed at each; beyond, at every tenth."""
MISSED_PERIODS = 1.6
"""A cycle so many times as long as usual, with samples missing in it, is several; as the offline search splits runs."""


class RunningScore:
    """End points and what they come to so far; the target is the half-width of the interval that is aimed at."""

    def __init__(self, target_half_width_deg: float | None = None) -> None:
        self._target_deg = target_half_width_deg
        self._rows: deque[CycleRow] = deque(maxlen=MAX_ROWS)
        self._times_s: list[float] = []
        self._dwells_s: list[float] = []
        self._quats: list[npt.NDArray[np.float64]] = []
        self._left_out: dict[int, str] = {}
        self.window: WindowView | None = None
        self.theta_bar_deg: float | None = None
        self.interval: DriftInterval | None = None
        self.slip = ""
        """How much of θ̄ few large steps make, in a sentence."""
        self.n_endpoints = 0
        """End points that count: in the window, less one for every cycle left out."""
        self.origin_wxyz: Quaternion | None = None
        """Orientation at the first end point that counts."""

    @property
    def rows(self) -> tuple[CycleRow, ...]:
        """The newest cycles."""
        return tuple(self._rows)

    @property
    def more_cycles(self) -> int | None:
        """How many more cycles the target asks for; None without a target, or where it is out of reach."""
        if self.interval is None or self._target_deg is None:
            return None
        needed = steps_needed(self.interval, self._target_deg)
        return None if needed is None else max(0, needed - self.interval.n_steps)

    def enter(self, endpoint: Endpoint, over_gap: bool = False) -> CycleRow:
        """Enter the next end point; return its row.

        Parameters
        ----------
        over_gap : bool
            Whether samples are missing since the one before. If more than a cycle went by, end points were missed, and
            the step over them is no step: it does not count here. The offline search may find them yet.
        """
        quat = np.asarray(endpoint.quat_wxyz, dtype=np.float64)
        number, time_s = len(self._quats), float(endpoint.time_s)
        period_s = step_deg = axis = None
        if number:
            step = rotations.log(rotations.difference(quat, self._quats[-1]))
            step_rad = float(np.linalg.norm(step))
            step_deg, axis = float(np.degrees(step_rad)), _axis(step, step_rad)
            period_s = time_s - self._times_s[-1]
            if over_gap and number > 1 and period_s > MISSED_PERIODS * float(np.median(np.diff(self._times_s))):
                self._left_out[number] = MISSED
        self._quats.append(quat)
        self._times_s.append(time_s)
        self._dwells_s.append(float(endpoint.dwell_s))
        self._score(always=False)
        row = CycleRow(
            number=number,
            time_s=time_s,
            period_s=period_s,
            step_deg=step_deg,
            step_axis=axis,
            theta_bar_deg=self.theta_bar_deg,
            flags=tuple(endpoint.flags),
            quat_wxyz=plain_quaternion(quat),
            excluded=self._reason(number),
        )
        self._rows.append(row)
        return row

    def forget(self) -> None:
        """Start again: what looked like cycles was a part of one, or movement before the first."""
        for kept in (self._rows, self._quats, self._times_s, self._dwells_s, self._left_out):
            kept.clear()
        self._score(always=True)

    def set_window(self, window: WindowView | None) -> None:
        """Count only end points inside a window."""
        self.window = window
        self._edited()

    def leave_out(self, number: int, reason: str) -> tuple[float, float] | None:
        """Leave out the cycle of a number; return the times of its end points, None where there is no such cycle."""
        if not 0 < number < len(self._times_s):
            return None
        self._left_out[number] = reason or "no reason given"
        self._edited()
        return self._times_s[number - 1], self._times_s[number]

    def take_back(self, number: int) -> tuple[float, float] | None:
        """Count a cycle again; return the times of its end points, None where it was not left out."""
        if number not in self._left_out:
            return None
        del self._left_out[number]
        self._edited()
        return self._times_s[number - 1], self._times_s[number]

    def number_at(self, from_s: float, to_s: float) -> int | None:
        """Find the cycle in which the middle of a span of time lies."""
        middle_s = 0.5 * (from_s + to_s)
        number = int(np.searchsorted(self._times_s, middle_s, side="right"))
        return number if 0 < number < len(self._times_s) else None

    def _inside(self, k: int) -> bool:
        window = self.window
        if window is None:
            return True
        # As the offline search has it: an end point whose dwell touches the window is inside.
        time_s, half_s = self._times_s[k], 0.5 * self._dwells_s[k]
        return (window.from_s is None or time_s >= window.from_s - half_s) and (
            window.to_s is None or time_s <= window.to_s + half_s
        )

    def _step_inside(self, number: int) -> bool:
        return self._inside(max(number - 1, 0)) and self._inside(number)

    def _reason(self, number: int) -> str:
        return self._left_out.get(number) or ("" if self._step_inside(number) else OUTSIDE)

    def _edited(self) -> None:
        self._score(always=True)
        self._rows = deque((replace(row, excluded=self._reason(row.number)) for row in self._rows), maxlen=MAX_ROWS)

    def _score(self, always: bool) -> None:
        inside = [k for k in range(len(self._quats)) if self._inside(k)]
        left_out = [k - 1 - inside[0] for k in self._left_out if self._step_inside(k)] if inside else []
        self.n_endpoints = len(inside) - len(left_out)
        self.origin_wxyz = plain_quaternion(self._quats[inside[0]]) if inside else None
        n_steps = len(inside) - 1 - len(left_out)
        if n_steps < 1:
            self.theta_bar_deg, self.interval, self.slip = None, None, ""
            return
        drift = rotation_drift(np.array([self._quats[k] for k in inside]), left_out)
        self.theta_bar_deg = drift.theta_bar_deg
        if n_steps < MIN_STEPS:
            self.interval = None
        elif always or n_steps < EVERY_CYCLE or n_steps % 10 == 0:
            self.interval = drift_interval(drift.counted_step_rotations_wxyz)
            self.slip = self._slip(drift, inside[0])

    @staticmethod
    def _slip(drift: RotationDrift, first: int) -> str:
        """Return how much of θ̄ few large steps make; ``first``, the number of the first end point that counts."""
        found = find_slip(drift)
        if found is None:
            return ""
        return replace(found, steps=tuple(first + step for step in found.steps)).sentence


def _axis(step: npt.NDArray[np.float64], step_rad: float) -> tuple[float, float, float] | None:
    if step_rad < 1e-9:
        return None
    x, y, z = (step / step_rad).tolist()
    return x, y, z
