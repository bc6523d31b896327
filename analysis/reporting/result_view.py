"""A score as reporting sees it: read from its JSON values, so that stored results and fresh ones are drawn alike."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from analysis.series import FloatArray


@dataclass(frozen=True)
class SensitivityRow:
    """One line of the sensitivity figure: a number, or a range."""

    label: str
    """What was done differently."""
    value: float | None
    """θ̄ in degrees; None where only a range makes sense."""
    low: float
    """Lower end, deg."""
    high: float
    """Upper end, deg."""
    is_score: bool = False
    """Whether this is θ̄ itself."""


@dataclass(frozen=True, eq=False)
class ResultView:
    """What the figures and the report take from a result."""

    result: dict[str, Any]
    """The JSON values themselves."""
    valid: bool
    """Whether a score is claimed."""
    theta_bar_deg: float | None
    """θ̄; None where not valid."""
    interval_deg: tuple[float, float] | None
    """95 % interval of θ̄, deg; None where there is none."""
    n_endpoints: int
    """Number of end points."""
    steps_deg: FloatArray
    """(n−1,) deg."""
    step_flags: tuple[tuple[str, ...], ...]
    """(n−1) flags of the end point that closes each step."""
    period_s: float | None
    """Length of a cycle, s."""
    motion_axis: FloatArray | None
    """(3,) axis of the motion, world frame; None where the result does not say."""
    window_s: tuple[float, float] | None
    """First and last end point, s; None without end points."""

    @classmethod
    def of(cls, result: dict[str, Any]) -> Self:
        """Read a result.

        Parameters
        ----------
        result
            ``TrialScore.to_json()``.
        """
        endpoints = result.get("endpoints") or []
        steps = np.array(result.get("steps_deg") or [], dtype=np.float64)
        flags = tuple(tuple(point.get("flags") or ()) for point in endpoints)[1:]
        axis = (result.get("cycles") or {}).get("axis")
        times_s = [float(point["time_s"]) for point in endpoints]
        return cls(
            result=result,
            valid=bool(result.get("valid")),
            theta_bar_deg=number(result.get("theta_bar_deg")),
            interval_deg=_pair(result.get("interval_deg")),
            n_endpoints=len(endpoints),
            steps_deg=steps,
            step_flags=flags if len(flags) == len(steps) else ((),) * len(steps),
            period_s=number(result.get("period_s")),
            motion_axis=np.array(axis, dtype=np.float64) if axis and None not in axis else None,
            window_s=(times_s[0], times_s[-1]) if times_s else None,
        )

    @property
    def companions(self) -> dict[str, Any]:
        """Companion figures by name; empty where there are none."""
        return self.result.get("companions") or {}

    def sensitivity(self) -> list[SensitivityRow]:
        """List θ̄ and what it would be with other choices, as far as the result says."""
        companions = self.companions
        other = self.result.get("other_extreme") or {}
        rows = [
            _row("θ̄, as the card says", self.theta_bar_deg, self.interval_deg, is_score=True),
            _row("without the first end point", companions.get("without_first_deg")),
            _row("without the last end point", companions.get("without_last_deg")),
            _row("each cycle left out in turn", None, _pair(companions.get("leave_one_out_deg"))),
            _row("at the other extreme", other.get("theta_bar_deg")),
            _row("at any phase of the cycle", None, _pair(companions.get("over_phase_deg"))),
            _row("slope over all end points", companions.get("slope_deg_per_cycle")),
        ]
        return [row for row in rows if row is not None]


def number(value: object) -> float | None:
    """Give a finite number, or None for what is none."""
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None


def _pair(value: object) -> tuple[float, float] | None:
    if isinstance(value, dict):
        value = (value.get("min"), value.get("max"))
    if not isinstance(value, list | tuple) or len(value) != 2:
        return None
    low, high = number(value[0]), number(value[1])
    return None if low is None or high is None else (low, high)


def _row(
    label: str, value: object, ends: tuple[float, float] | None = None, *, is_score: bool = False
) -> SensitivityRow | None:
    shown = number(value)
    if shown is None and ends is None:
        return None
    low, high = ends if ends is not None else (shown or 0.0, shown or 0.0)
    return SensitivityRow(label, shown, low, high, is_score)
