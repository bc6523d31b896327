"""The result of a trial: θ̄ first, then how far to trust it, then the cycles it was made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from analysis.cycles.search import CycleAnalysis
from analysis.scoring import score_json
from analysis.scoring.as_published import PublishedDrift
from analysis.scoring.card import RotationDrift
from analysis.scoring.diagnostics import DriftCompanions, PhaseSweep
from analysis.scoring.interval import DriftInterval
from analysis.scoring.plain_json import Json, finite
from analysis.scoring.score_parts import (
    AutomaticScore,
    ExcludedCycle,
    OtherExtreme,
    ScoredEndpoint,
    SensorShare,
    Window,
)

RESULT_FORMAT = 1
"""Version of the JSON layout."""


@dataclass(frozen=True, eq=False)
class TrialScore:
    """Everything about one trial. ``drift`` and what follows from it are None unless ``valid``."""

    valid: bool
    """Whether a drift may be claimed."""
    reasons: tuple[str, ...]
    """Why not; empty where valid."""
    warnings: tuple[str, ...]
    """What to keep in mind."""
    notes: tuple[str, ...]
    """What the reader assumed and did."""
    endpoints: tuple[ScoredEndpoint, ...]
    """End points, also where the trial is not valid."""
    index_kind: str
    """``row`` or ``sequence``."""
    period_s: float | None
    """Median distance between end points, s."""
    cycles: CycleAnalysis
    """The search that found (or would have found) them."""
    window: Window
    """Which end points were taken."""
    automatic: AutomaticScore | None
    """The automatic score, where the window was given or edited."""
    excluded: tuple[ExcludedCycle, ...] = ()
    """Cycles a person left out."""
    drift: RotationDrift | None = None
    """θ̄ by the card."""
    companions: DriftCompanions | None = None
    """What θ̄ hides."""
    interval: DriftInterval | None = None
    """Confidence interval; None with fewer than 4 steps."""
    phase: PhaseSweep | None = None
    """θ̄ at other phases of the same cycles."""
    other: OtherExtreme | None = None
    """The other extreme."""
    translation_drift_mm: float | None = None
    """‖mean of the differences of the positions‖, where there are positions."""
    sensor: SensorShare | None = None
    """The sensor's own share."""
    published: PublishedDrift | None = None
    """The authors' figure, where asked for."""
    losses: Mapping[str, int | float] | None = None
    """What the link lost; None for files."""
    start_s: float = 0.0
    """Time of the first sample, recording's own time, s."""
    duration_s: float = 0.0
    """Length of the recording, s."""
    n_samples: int = 0
    """Samples of the recording."""
    source: str = ""
    """What was scored."""
    convention: str = ""
    """How its orientations were read."""
    extra: Mapping[str, Json] = field(default_factory=dict)
    """What the caller wants in the result as well."""

    @property
    def theta_bar_deg(self) -> float | None:
        """θ̄ in degrees; None where no drift may be claimed."""
        return None if self.drift is None else self.drift.theta_bar_deg

    @property
    def interval_deg(self) -> tuple[float, float] | None:
        """Ends of the confidence interval in degrees."""
        return None if self.interval is None else (self.interval.low_deg, self.interval.high_deg)

    def to_json(self) -> dict[str, Json]:
        """Lay the result out as plain JSON: finite numbers, null for what is unknown.

        Returns
        -------
        Fields of ``docs/benchmark.md``, "The result as JSON"; angles in deg, times in s.
        """
        drift = self.drift
        fields: dict[str, object] = {
            "format": RESULT_FORMAT,
            "theta_bar_deg": self.theta_bar_deg,
            "axis": None if drift is None else drift.axis,
            "n_endpoints": len(self.endpoints),
            "interval_deg": self.interval_deg,
            "valid": self.valid,
            "reasons": self.reasons,
            "warnings": self.warnings,
            "endpoints": score_json.endpoint_fields(self.endpoints, self.index_kind),
            "steps_deg": [] if drift is None else drift.steps_deg,
            "flags": [list(point.flags) for point in self.endpoints],
            "period_s": self.period_s,
            "other_extreme": None if self.other is None else score_json.other_fields(self.other, self.index_kind),
            "companions": self._companion_fields(),
            "sensor": None if self.sensor is None else score_json.sensor_fields(self.sensor),
            "window": score_json.window_fields(self.window, self.automatic),
            "cycles": score_json.cycle_fields(self.cycles),
            "losses": self.losses,
            "recording": {
                "source": self.source,
                "convention": self.convention,
                "n_samples": self.n_samples,
                "start_s": self.start_s,
                "duration_s": self.duration_s,
                "notes": self.notes,
            },
            "settings": {"cycles": asdict(self.cycles.settings)},
            **({} if not self.excluded else {"excluded_cycles": [asdict(item) for item in self.excluded]}),
            **({} if self.published is None else {"as_published": score_json.published_fields(self.published)}),
            **self.extra,
        }
        return {name: finite(value) for name, value in fields.items()}

    def _companion_fields(self) -> dict[str, object] | None:
        if self.companions is None or self.drift is None:
            return None
        values: dict[str, object] = asdict(self.companions)
        if self.phase is not None:
            sweep = self.phase.theta_bar_deg
            values["over_phase_deg"] = {
                "min": float(sweep.min()),
                "max": float(sweep.max()),
                "phases": self.phase.phases,
                "theta_bar_deg": sweep,
                "n_cycles": self.phase.n_cycles,
            }
        values["interval"] = None if self.interval is None else asdict(self.interval)
        values["translation_drift_mm"] = self.translation_drift_mm
        values["mean_rotation_wxyz"] = self.drift.mean_rotation_wxyz
        return values

    def __repr__(self) -> str:
        """One line for an interactive session; every attribute printed would fill pages."""
        if self.theta_bar_deg is None:
            return f"TrialScore(no score: {'; '.join(self.reasons)})"
        ends = "" if self.interval_deg is None else " ({:.3f} … {:.3f})".format(*self.interval_deg)
        return f"TrialScore(θ̄ = {self.theta_bar_deg:.3f}°{ends}, {len(self.endpoints)} end points)"

    def _repr_html_(self) -> str:
        """Show the result in a notebook."""
        from analysis.reporting.library import result_html  # drawing is not needed to score

        return result_html(self.to_json())
