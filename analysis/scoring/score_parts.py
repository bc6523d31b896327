"""What a trial's result is made of: end points, window, the sensor's share, the other extreme, cycles left out."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.scoring.card import RotationDrift
from analysis.sensor.baseline import StaticBaseline
from analysis.series import FloatArray


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
    """Start, recording's own time: as given, else of the first end point."""
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
    """End point at its start, recording's own time, s, as far as known when it was left out."""
    to_s: float
    """End point at its end."""
    reason: str
    """The person's; may be empty."""
    step: int = -1
    """Number of its step, from 0; −1 before it is found among the scored ones."""
