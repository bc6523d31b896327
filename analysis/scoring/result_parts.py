"""The parts of a result that the analysis fills; :mod:`analysis.scoring.result` puts them together.

Every part is as it stands in the JSON: same names, same order, angles in deg, times in s, the recording's own where a
single moment is meant. A field with a default is absent from the JSON while it has that default.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import msgspec

from analysis.cycles.search import CycleSettings
from analysis.scoring.interval import DriftInterval
from analysis.sensor.baseline import StaticBaseline
from analysis.series import FloatArray

Vector: TypeAlias = tuple[float, float, float]
"""x, y, z in world axes."""
Known: TypeAlias = tuple[float | None, ...]
"""Numbers of which some may not be known."""
Quaternion: TypeAlias = tuple[float, float, float, float]
"""w, x, y, z; unit, body to world."""


def vector_of(values: FloatArray) -> Vector:
    """Return a (3,) array as plain numbers."""
    x, y, z = values.tolist()
    return x, y, z


def quaternion_of(values: FloatArray) -> Quaternion:
    """Return a (4,) array as plain numbers."""
    w, x, y, z = values.tolist()
    return w, x, y, z


def known(value: float) -> float | None:
    """Return a finite number; None for NaN and infinity, which JSON does not have."""
    return float(value) if math.isfinite(value) else None


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One object of the JSON: immutable, typed, read strictly."""


class ScoredEndpoint(Part, frozen=True, kw_only=True):
    """One end point as it went into the score."""

    row: int | None = None
    """Nearest sample, of recordings whose samples are rows."""
    sequence: int | None = None
    """Nearest sample, of recordings whose samples carry sequence numbers."""
    time_s: float
    """On the recording's time axis."""
    quat_wxyz: Quaternion
    """Orientation, averaged over the dwell where the search found it."""
    flags: tuple[str, ...]
    """What is odd about the cycle that ends here."""
    dwell_s: float | None
    """How long the object stayed near the extreme; None for chosen end points."""
    prominence_deg: float | None
    """Travel to or from it, whichever is less; None for chosen end points."""
    reason: str = ""
    """Why a person chose it or left its cycle out, where a reason was given."""

    @property
    def index(self) -> int:
        """Row or sequence number of the nearest sample."""
        found = self.sequence if self.row is None else self.row
        assert found is not None
        return found


class LeftOutPoint(Part, frozen=True):
    """A turning point at the ends of the trial that the search left out."""

    time_s: float
    """On the recording's time axis."""
    reason: str
    """Why it was left out."""


class AutomaticScore(Part, frozen=True):
    """The score of the automatic window, beside that of another one."""

    valid: bool
    """Whether it would be scored."""
    theta_bar_deg: float | None
    """θ̄, None where not valid."""
    n_endpoints: int
    """End points that would count."""
    indices: tuple[int, ...]
    """Rows or sequence numbers."""
    reasons: tuple[str, ...]
    """Why it would not be scored."""


class ScoredWindow(Part, frozen=True, kw_only=True):
    """Which end points count, and who decided."""

    kind: str
    """``automatic``, ``from-to`` or ``endpoints``."""
    from_s: float | None
    """Start: as given, else the first end point."""
    to_s: float | None
    """End: as given, else the last end point."""
    source: str
    """Who chose: the search, a person, the operator, a file."""
    left_out: tuple[LeftOutPoint, ...]
    """Turning points that the search left out."""
    automatic: AutomaticScore | None
    """None where the window is the automatic one."""


class ExcludedCycle(Part, frozen=True):
    """A cycle that a person left out: kept, flagged, with the reason."""

    from_s: float
    """End point at its start, as far as known when it was left out."""
    to_s: float
    """End point at its end."""
    reason: str
    """The person's; may be empty."""
    step: int = -1
    """Number of its step, from 0; −1 before it is found among the scored ones."""

    @classmethod
    def numbered(cls, cycle: int, reason: str) -> ExcludedCycle:
        """Return the cycle of a number, from 1, as tables show them: its end points are not known yet."""
        return cls(math.nan, math.nan, reason, cycle - 1)


class OtherExtreme(Part, frozen=True):
    """The same trial scored at the other turning point of the motion."""

    theta_bar_deg: float | None
    """None with fewer than 2 end points."""
    axis: Vector | None
    """Axis of its average step, world frame."""
    n_endpoints: int
    """End points at the other extreme."""
    endpoints: tuple[ScoredEndpoint, ...]
    """In time order."""


class SensorShare(Part, frozen=True):
    """How much of θ̄ the sensor alone can explain."""

    source: str
    """``baseline``, ``rests`` (inside the trial) or ``unknown``."""
    per_cycle_deg: float | None
    """Heading drift × period: what the sensor adds per cycle."""
    detectable_deg: float | None
    """The floor: 95th percentile of θ̄ of a resting object in such a trial."""
    below_floor: bool | None
    """θ̄ is below the floor: it cannot be distinguished from a resting object's."""
    note: str
    """For people."""
    baseline: StaticBaseline | None


class PhaseSweep(Part, frozen=True):
    """θ̄ of the same cycles at other phases: how much the choice of phase matters."""

    min: float
    """Smallest θ̄ of all phases, deg."""
    max: float
    """Largest θ̄ of all phases, deg."""
    phases: tuple[float, ...]
    """Fraction of a cycle after the end point, [0, 1)."""
    theta_bar_deg: tuple[float, ...]
    """θ̄ of the same cycles at each phase; n_cycles − 1 steps each."""
    n_cycles: int
    """Cycles between the first and the last end point."""


class Diagnostics(Part, frozen=True, kw_only=True, omit_defaults=False):
    """What θ̄ does not show, from the same end points. Degrees; world axes."""

    n_steps: int
    """Number of steps that count; every figure below comes from these, but poses, which are of all end points."""
    step_axes: tuple[Vector, ...]
    """Unit axis of each of the n − 1 steps, also of those left out; zeros where a step has no rotation at all."""
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
    """θ̄ without the last end point; None with fewer than 2 steps."""
    leave_one_out_deg: tuple[float, float] | None
    """Smallest and largest θ̄ when one step is left out."""
    slope_deg_per_cycle: float
    """Length of the least-squares slope of pose (rotation vector) on cycle number: uses every end point."""
    slope_axis: Vector
    """Axis of that slope."""
    top_eigenvalue_share: float
    """Largest eigenvalue of M over its trace; see :data:`analysis.scoring.diagnostics.MIN_EIGENVALUE_SHARE`."""
    over_phase_deg: PhaseSweep | None = None
    """None where only the end points are at hand."""
    interval: DriftInterval | None = None
    """None with fewer than 4 steps."""
    translation_drift_mm: float | None = None
    """‖mean of the differences of the positions‖; None where the recording has none."""
    mean_rotation_wxyz: Quaternion
    """r̄."""


class ScoredRun(Part, frozen=True):
    """End points without a pause between them."""

    from_s: float
    """First end point."""
    to_s: float
    """Last end point."""
    n_endpoints: int
    """End points in the run."""
    net_rotation_deg: float
    """Angle from its first end point to its last."""
    theta_bar_deg: float | None
    """With few steps it means little: for comparison with the run that was scored."""
    scored: bool
    """Whether this run is the one that was scored."""


class CycleSearch(Part, frozen=True, kw_only=True):
    """The search for cycles."""

    period_confidence: float | None
    """Normalised autocorrelation at the period, −1 to 1."""
    axis: Known
    """(3,) mean motion axis, world axes, unit."""
    axis_share: float | None
    """Share of the motion about the motion axis: 1 for one axis, 0.5 for circular motion."""
    swing_deg: float | None
    """Range of motion about the motion axis."""
    humps: int
    """Turning points of one kind per cycle."""
    likeness: float | None
    """Median correlation of a cycle's angular velocity with the mean of the others, −1 to 1."""
    irregularity: float | None
    """Relative spread of spacing and swings."""
    active_s: tuple[float, float] | None
    """First and last moment the object moves."""
    runs: tuple[ScoredRun, ...]
    """All runs of the extreme that is scored."""


class Source(Part, frozen=True, kw_only=True):
    """The recording that was scored."""

    source: str
    """Name of the file or link."""
    convention: str
    """How its orientations were read."""
    n_samples: int
    """Samples on the time axis."""
    start_s: float
    """First sample, on the recording's time axis."""
    duration_s: float
    """From the first sample to the last."""
    notes: tuple[str, ...]
    """What the reader assumed and did."""


class Settings(Part, frozen=True):
    """Numbers of the method."""

    cycles: CycleSettings
    """Of the search for cycles."""


class PublishedDrift(Part, frozen=True, kw_only=True):
    """Drift as the benchmark authors' scripts compute it."""

    euler_drift_deg: float
    """‖mean of the differences‖ of this motion alone: what the scripts meant to compute."""
    euler_drift_as_published_deg: float
    """The same with the rows that earlier motions left behind; equal where none did."""
    stale_rows: int
    """How many rows were left behind by earlier motions."""
    stale_of: tuple[int, ...]
    """How many rows each earlier motion left behind, in the order given."""
    preceding: int
    """Earlier motions given; without any, the published figure holds only if no longer one came before."""
    n_steps: int
    """Differences of the motion itself."""
