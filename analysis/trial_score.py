"""The result of a trial: θ̄ first, then how far to trust it, then the cycles it was made of."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from analysis.as_published import PublishedDrift
from analysis.baseline import StaticBaseline
from analysis.companions import DriftCompanions, PhaseSweep
from analysis.cycles import CycleAnalysis
from analysis.drift import RotationDrift
from analysis.series import FloatArray
from analysis.uncertainty import DriftInterval

RESULT_FORMAT = 1
"""Version of the JSON layout."""

Json = None | bool | int | float | str | list["Json"] | dict[str, "Json"]


@dataclass(frozen=True, eq=False)
class ScoredEndpoint:
    """One end point as it went into the score."""

    time_s: float
    """Recording's own time, s."""
    index: int
    """Row or sequence number of the nearest sample."""
    quat_wxyz: FloatArray
    """(4,) orientation that was scored."""
    flags: tuple[str, ...] = ()
    """What is odd about the cycle that ends here."""
    reason: str = ""
    """Why a person chose it, if one did and said so."""
    dwell_s: float | None = None
    """How long the object stayed near the extreme; None for chosen end points."""
    prominence_deg: float | None = None
    """Travel to or from it, whichever is less; None for chosen end points."""


@dataclass(frozen=True)
class Window:
    """Which end points were taken, and who decided."""

    kind: str
    """``automatic``, ``from-to`` or ``endpoints``."""
    from_s: float | None
    """Begin, recording's own time: as given, else of the first end point."""
    to_s: float | None
    """End."""
    source: str = ""
    """Where the choice came from."""
    left_out: tuple[tuple[float, str], ...] = ()
    """(time, reason) of turning points at the ends that the search left out."""


@dataclass(frozen=True)
class AutomaticScore:
    """What the automatic window gives, beside an edited one."""

    valid: bool
    """Whether it would be scored."""
    theta_bar_deg: float | None
    """θ̄, None where not valid."""
    n_endpoints: int
    """Number of end points."""
    indices: tuple[int, ...]
    """Rows or sequence numbers."""
    reasons: tuple[str, ...]
    """Why it is not valid."""


@dataclass(frozen=True)
class SensorShare:
    """What of θ̄ the sensor alone can explain."""

    source: str
    """``baseline``, ``rests`` (inside the trial) or ``unknown``."""
    baseline: StaticBaseline | None
    """What it was computed from."""
    per_cycle_deg: float | None
    """Heading drift × period: what the sensor fakes per cycle."""
    detectable_deg: float | None
    """The floor: 95th percentile of θ̄ of a resting object in such a trial."""
    below_floor: bool | None
    """θ̄ is below the floor: it cannot be told from a resting object's."""
    note: str
    """For people."""


@dataclass(frozen=True, eq=False)
class OtherExtreme:
    """The same trial scored at the other turning point of the motion."""

    drift: RotationDrift | None
    """None with fewer than 2 end points."""
    endpoints: tuple[ScoredEndpoint, ...]
    """In time order."""


@dataclass(frozen=True)
class ExcludedCycle:
    """A cycle that a person left out: kept, flagged, with the reason."""

    from_s: float
    """End point at its begin, recording's own time, s, as far as known when it was left out."""
    to_s: float
    """End point at its end."""
    reason: str
    """The person's; may be empty."""
    step: int = -1
    """Number of its step, from 0; −1 before it is found among the scored ones."""


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
        """Lay the result out as plain JSON: finite numbers, null for what is unknown."""
        from analysis.score_json import score_to_json  # it needs this module

        return score_to_json(self)

    def __repr__(self) -> str:
        """One line for an interactive session; every attribute printed would fill pages."""
        if self.theta_bar_deg is None:
            return f"TrialScore(no score: {'; '.join(self.reasons)})"
        ends = "" if self.interval_deg is None else " ({:.3f} … {:.3f})".format(*self.interval_deg)
        return f"TrialScore(θ̄ = {self.theta_bar_deg:.3f}°{ends}, {len(self.endpoints)} end points)"

    def _repr_html_(self) -> str:
        """Show the result in a notebook."""
        from analysis.reporting.library import result_html  # drawing is not needed to score

        return result_html(dict(self.to_json()))


def finite(value: object) -> Json:
    """Make plain JSON of results: arrays to lists, numbers that are not finite to null.

    Parameters
    ----------
    value
        Numbers, texts, arrays, and tuples, lists and mappings of them.

    Returns
    -------
    What :func:`json.dumps` takes with ``allow_nan=False``.
    """
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return finite(value.tolist())
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    raise TypeError(f"{type(value).__name__} is no part of a result")
