"""What the search for cycles works with and returns: settings, end points, runs, and the reasons for every choice."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis.geometry import averages, rotations
from analysis.series import FloatArray

AFTER_PAUSE = "after a pause"
"""Flag of an end point whose step lies across a pause."""
LONG_DWELL = "long dwell"
"""Flag of an end point at which the object stays much longer than at the others."""


@dataclass(frozen=True)
class MotionSettings:
    """From orientations to angular velocity, and what of it counts as motion."""

    rate_hz: float = 100.0
    """Rate of the even grid, 1/s."""
    sigma_s: float = 0.04
    """Gaussian smoothing of the orientation, s. End points themselves are averaged from unsmoothed samples."""
    moving_share: float = 0.15
    """The object moves where its speed is above this share of its working speed."""
    slow_path_share: float = 0.1
    """Where nothing is found, what is slow is looked at again: the first tenth of all turning, from slow to fast."""
    speed_limit: float = 3.0
    """Faster strokes count as this many times the usual speed when the period and the axis are looked for."""


@dataclass(frozen=True)
class PeriodSettings:
    """The period."""

    period_sigma: float = 0.025
    """Smoothing of ω with which the period is looked for a second time, periods."""
    more_sigma_s: tuple[float, ...] = (0.1, 0.25)
    """Further smoothing of ω tried, one after the other, where noise hides the period, s."""
    min_sigmas: float = 8.0
    """Shortest period looked for after further smoothing, in σ."""
    max_noise_share: float = 0.2
    """Share of noise in the power of ω above which it is smoothed further."""
    min_period_s: float = 0.4
    """Shortest period looked for, s."""
    max_period_s: float = 120.0
    """Longest period looked for, s."""
    peak_share: float = 0.8
    """The period is the first peak of the autocorrelation above this share of the largest."""
    min_confidence: float = 0.3
    """Autocorrelation at the period below which there is no claim."""
    min_tempo_confidence: float = 0.15
    """The same for even swings about one axis whose cycles are similar: there, changing tempo hides the period."""
    sure_confidence: float = 0.5
    """Autocorrelation at the period below which there is a warning."""


@dataclass(frozen=True)
class AxisSettings:
    """The motion axis, and the range of motion about it."""

    axis_sigma: float = 1.5
    """Gaussian window of the motion axis, periods."""
    min_axis_share: float = 0.6
    """Share of the motion about one axis below which the axis is called ambiguous."""
    min_swing_deg: float = 0.5
    """Range of motion below which there is no claim, deg."""


@dataclass(frozen=True)
class EndpointSettings:
    """Turning points, and which of them end a cycle, where."""

    hysteresis: float = 0.4
    """A turning point counts when the angle travels this share of the range of motion on both sides."""
    spacing: tuple[float, float] = (0.7, 1.35)
    """Distance between end points that makes a regular cycle, periods."""
    swing: tuple[float, float] = (0.5, 1.6)
    """Travel to and from an end point that makes a regular cycle, shares of the range of motion."""
    even_swings: tuple[float, float] = (0.75, 1.33)
    """Swings of one size: every swing is a cycle even where tempo changes hide the period, shares of the median."""
    pause: float = 1.6
    """A longer distance between end points splits the trial into runs, periods."""
    dwell_depth: float = 0.1
    """An end point is the middle of the time this near to the extreme, share of the range of motion."""
    average: float = 0.015
    """Samples this near to the end point are averaged, with weights falling linearly to 0, periods."""
    max_gap: float = 0.05
    """An end point between samples further apart than this is refused, periods."""


@dataclass(frozen=True)
class VerdictSettings:
    """Whether the cycles may be scored, and what is warned of."""

    min_likeness: float = 0.75
    """Correlation of the cycles with each other below which there is no claim."""
    max_irregularity: float = 0.35
    """Relative spread of spacing and swings above which there is no claim."""
    max_rests: float = 3.0
    """As many rests per cycle make grasp-and-release, if ``max_rest_share`` is passed and the motion is mixed."""
    max_rest_share: float = 0.35
    """Share of the time at rest, see ``max_rests``."""
    pure_axis_share: float = 0.9
    """Motion about one axis as much as this is never grasp-and-release."""
    sure_likeness: float = 0.9
    """Cycles as similar as this are scored at any tempo; with many rests, they are only warned of."""
    max_advance: float = 0.6
    """Net turn per cycle as a share of the range of motion above which the motion is one-way."""
    min_endpoints: int = 3
    """Fewer end points than this make no score."""
    short_period_s: float = 0.6
    """A shorter period than this makes a warning, s."""
    max_tempo_change: float = 0.4
    """Range of the distances between end points that makes a warning, periods."""
    max_noise: float = 0.08
    """Noise of a single sample that makes a warning, share of the range of motion."""


@dataclass(frozen=True)
class CycleSettings(VerdictSettings, EndpointSettings, AxisSettings, PeriodSettings, MotionSettings):
    """Numbers the search works with; the same for every recording. Lengths of time are shares of the period."""

    # Results hold them as one flat list, in the order of the steps: the base classes from the last to the first.


@dataclass(frozen=True, eq=False)
class Endpoint:
    """One end point: the same phase of every cycle."""

    time_s: float
    """Middle of the dwell, s, in the time of the series."""
    index: int
    """Nearest sample as its source names it: data row or sequence number."""
    quat_wxyz: FloatArray
    """(4,) orientation, unit, scalar first, scalar part ≥ 0: average of the samples around ``time_s``."""
    dwell_s: float
    """How long the object stays near the extreme, s."""
    prominence_deg: float
    """Travel about the motion axis to the extreme or away from it, whichever is less, deg."""
    flags: tuple[str, ...] = ()
    """What is odd about it.

    ``after a pause``, ``odd spacing``, ``odd swing``, ``pose jump``, ``long dwell``, ``gap nearby``.
    """


@dataclass(frozen=True)
class LeftOut:
    """A turning point that is not an end point, and why."""

    time_s: float
    """Where, s."""
    reason: str
    """Why, for people."""
    primary: bool
    """Whether it belongs to the extreme that is scored."""
    grasp: bool = False
    """Whether it is an extreme of the motion at which the hand takes hold of the object or lets go of it."""


@dataclass(frozen=True, eq=False)
class Run:
    """End points of one extreme without a pause between them."""

    endpoints: tuple[Endpoint, ...]
    """In time order, at least one."""
    scored: bool
    """The longest run of the primary extreme is the one that is scored."""

    @property
    def start_s(self) -> float:
        """Time of the first end point, s."""
        return self.endpoints[0].time_s

    @property
    def end_s(self) -> float:
        """Time of the last end point, s."""
        return self.endpoints[-1].time_s


@dataclass(frozen=True, eq=False)
class CycleAnalysis:
    """Cycles of a recording, or the reasons why there are none to score."""

    settings: CycleSettings
    """What it was made with."""
    window: tuple[float, float] | None
    """The window asked for, s; None means found automatically."""
    reasons: tuple[str, ...] = ()
    """Why the end points may not be scored, for people; empty where they may."""
    warnings: tuple[str, ...] = ()
    """What to keep in mind, for people."""
    period_s: float = float("nan")
    """Median distance between end points; where there are none, the lag of the autocorrelation, s."""
    period_confidence: float = 0.0
    """Normalised autocorrelation at the period, −1 to 1."""
    axis: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    """(3,) mean motion axis, world frame, unit, largest component positive."""
    axis_share: float = 0.0
    """Share of the motion about the motion axis: 1 for one axis, 0.5 for circular motion."""
    swing_deg: float = 0.0
    """Range of motion about the motion axis, deg."""
    likeness: float = 0.0
    """Median correlation of a cycle's angular velocity with the mean of the others, −1 to 1."""
    irregularity: float = 0.0
    """Relative spread of spacing and swings."""
    active_s: tuple[float, float] | None = None
    """First and last moment the object moves, s."""
    runs: tuple[Run, ...] = ()
    """All runs of the primary extreme."""
    other_endpoints: tuple[Endpoint, ...] = ()
    """End points of the other extreme in its longest run."""
    left_out: tuple[LeftOut, ...] = ()
    """Turning points left out, with the reason."""
    peaks_per_cycle: int = 1
    """Turning points of one kind per cycle; above 1 one of them ends the cycle, always the same."""

    @property
    def valid(self) -> bool:
        """Whether the end points may be scored."""
        return not self.reasons

    @property
    def endpoints(self) -> tuple[Endpoint, ...]:
        """End points of the primary extreme in its longest run: what is scored, if :attr:`valid`."""
        return next((run.endpoints for run in self.runs if run.scored), ())

    @property
    def theta_bar_deg(self) -> float:
        """Angle of the mean step between the end points, deg; NaN for fewer than two."""
        quats = np.array([point.quat_wxyz for point in self.endpoints])
        if len(quats) < 2:
            return float("nan")
        return float(np.degrees(rotations.angle(averages.average(rotations.difference(quats[1:], quats[:-1])))))
