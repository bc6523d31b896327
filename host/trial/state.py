"""What a capture shows of itself at one moment: frozen, put together in :mod:`host.capture.snapshot`.

Each view has one source, which knows all of it.

Texts in here come from devices and files: they are plain (:func:`host.text.plain`), but not markup.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np
import numpy.typing as npt

from firmware_protocol.items import StreamCounters
from host.losses.ledger import LossReport

Quaternion = tuple[float, float, float, float]
"""Scalar first."""
REST_DPS, MOVING_DPS = 1.5, 3.0
"""Turning rates below which the object is at rest, and above which it is moved."""
OUTSIDE, MISSED = "outside the trial window", "cycles were missed"
"""Reasons why a cycle does not count that are not the operator's own words."""
UNCOUNTED = "cycles not counted"
"""Phase of a motion whose cycle detector or running score has failed."""


def plain_quaternion(quat_wxyz: npt.NDArray[np.float64]) -> Quaternion:
    """Return a quaternion (4,) as plain numbers."""
    w, x, y, z = quat_wxyz.tolist()
    return w, x, y, z


@dataclass(frozen=True, slots=True)
class CycleRow:
    """One end point, and the cycle that it closes: the way from the end point before."""

    number: int
    """Of the cycle, from 1; 0 for the first end point, which closes none."""
    time_s: float
    """End point, s since the first sample."""
    period_s: float | None
    """Since the end point before; None for the first."""
    step_deg: float | None
    """Angle of the step from the end point before; None for the first."""
    step_axis: tuple[float, float, float] | None
    """Its axis, world frame, unit; None for the first and where the angle is too small to have one."""
    theta_bar_deg: float | None
    """θ̄ of all end points so far; None below two."""
    flags: tuple[str, ...] = ()
    """What is odd about it."""
    quat_wxyz: Quaternion | None = None
    """Orientation at the end point, body to world."""
    excluded: str = ""
    """Why the cycle does not count: the operator's reason, :data:`OUTSIDE` or :data:`MISSED`; else empty."""


@dataclass(frozen=True, slots=True)
class WindowView:
    """The trial window that the operator set; without one everything counts."""

    from_s: float | None = None
    """Its start, s since the first sample; None: open."""
    to_s: float | None = None
    """Its end; None: open."""


@dataclass(frozen=True, slots=True)
class TargetView:
    """When the capture will end; None where there is no limit."""

    cycles: int | None = None
    duration_s: float | None = None
    half_width_deg: float | None = None
    """Half-width of the interval that the capture is to reach (``--until``)."""


@dataclass(frozen=True, slots=True)
class ScoreView:
    """θ̄ so far, and the cycles it is of; once ``finished``, the result."""

    n_endpoints: int = 0
    """End points so far: one more than cycles."""
    cycles: tuple[CycleRow, ...] = ()
    """The first end point and the cycles after it; of many the last :data:`host.trial.running_score.MAX_ROWS`."""
    theta_bar_deg: float | None = None
    """Provisional until ``finished``."""
    interval_deg: tuple[float, float] | None = None
    """Its confidence interval; None while there are too few cycles."""
    half_width_deg: float | None = None
    """Half of the interval's width, before its ends were cut."""
    more_cycles: int | None = None
    """How many more cycles the interval's formula asks for to reach the target; None where it is out of reach."""
    slip: str = ""
    """How much of θ̄ few large steps make, in a sentence; empty where none stands out."""
    origin_wxyz: Quaternion | None = None
    """Orientation at the first end point that counts; None before it."""
    window: WindowView | None = None
    """The trial window; None where the operator set none."""
    finished: bool = False
    """Whether the offline result has replaced the provisional one."""
    summary: str = ""
    """The result in a sentence, once ``finished``."""

    @property
    def n_cycles(self) -> int:
        """Cycles so far."""
        return max(0, self.n_endpoints - 1)


@dataclass(frozen=True, slots=True)
class LinkView:
    """The link, as the capture knows it."""

    name: str = ""
    """Its URI."""
    connected: bool = True
    one_way: bool = False
    """Whether the object streams without ever answering."""
    expected_rate_hz: float | None = None
    """What the object was asked for or reports; None where it does not."""
    overflow_chunks: int = 0
    """Chunks this program could not receive in time."""


@dataclass(frozen=True, slots=True)
class CounterView:
    """What the decoder counted that a good link has none of.

    Named as in :class:`firmware_protocol.items.StreamCounters` and, on a bus,
    :class:`firmware_protocol.can.counters.CanCounters`; a counter that the link's decoder does not have stays 0.
    """

    crc_errors: int = 0
    malformed: int = 0
    refused: int = 0
    unnumbered: int = 0
    misnumbered: int = 0
    wrong_lengths: int = 0
    damaged_batches: int = 0
    long_packet_errors: int = 0
    error_frames: int = 0
    remote_frames: int = 0
    cobs_errors: int = 0
    oversize: int = 0
    unsupported_versions: int = 0
    unknown_types: int = 0

    @classmethod
    def of(cls, counters: StreamCounters) -> CounterView:
        """Return the view of a decoder's counters."""
        return cls(**{each.name: getattr(counters, each.name, 0) for each in fields(cls)})


@dataclass(frozen=True, slots=True)
class StreamView:
    """What came over the link."""

    rate_hz: float | None = None
    """Samples per second over the last seconds."""
    silent_s: float = 0.0
    """Since the last sample."""
    n_bytes: int = 0
    losses: LossReport = field(default_factory=LossReport)
    segments: int = 0
    """1, and one more for each reset of the device or step of its clock."""
    segment_reason: str = ""
    """Why the last segment started."""
    reconnects: int = 0
    """How often the link was lost and came back."""
    counters: CounterView = CounterView()


@dataclass(frozen=True, slots=True)
class ClockView:
    """The object's clock against the host's; None where it is not known yet."""

    skew_ppm: float | None = None
    """Its rate over the host's, less one."""
    jitter_p50_ms: float | None = None
    """Median of what the link adds to its least latency."""
    jitter_p99_ms: float | None = None
    """99th percentile of the same."""
    offset_interval_ns: tuple[float, float] | None = None
    """Host minus device clock lies between these; None without answers to TIME_REQUEST."""
    warm_up_s: float | None = None
    """How long the estimate took until it could be relied on."""


@dataclass(frozen=True, slots=True)
class SensorView:
    """The object and its sensor."""

    name: str = ""
    device_id: str = ""
    """16 hex digits; empty where the object does not send it."""
    still: bool | None = None
    """Whether the sensor judges the object at rest; None before the first sample."""
    saturated: bool = False
    calibrated: bool | None = None
    temperature_c: float | None = None
    battery_v: float | None = None
    orientation_wxyz: Quaternion | None = None
    """Last orientation, body to world."""
    heading_deg_per_min: float | None = None
    """The sensor's own drift, from its static baseline; None without one."""
    floor_deg: float | None = None
    """Smallest drift per cycle that differs from a resting object's, from the baseline; None without one."""


@dataclass(frozen=True, slots=True)
class MotionView:
    """The motion as the online detector sees it."""

    phase: str = "no data"
    """In words: no data, waiting for cycles, running, :data:`UNCOUNTED`."""
    moving: bool = False
    """Whether the object turns right now."""
    period_s: float | None = None
    swing_deg: float | None = None
    cycle_phase: float | None = None
    """0 at the last end point, 1 where the next is due; None before the first."""
    flags: tuple[str, ...] = ()
    """What is odd now: gap, axis ambiguous, noisy, pause."""
    turn_rate_dps: float | None = None
    """How fast the object turns, mean over the last half second, deg/s; None before the first sample."""
    peak_rate_dps: float | None = None
    """Its fastest turn of the last second, over some 30 ms, deg/s; None before the first sample."""

    @property
    def at_rest(self) -> bool:
        """Whether the object does not turn."""
        return (self.turn_rate_dps or 0.0) < REST_DPS


@dataclass(frozen=True, slots=True)
class RecordingView:
    """The recording."""

    path: str = ""
    n_bytes: int = 0
    problem: str | None = None
    """Why it is not on disk; None when all is well."""
    free_bytes: int | None = None
    """Room left on the disk."""
    replayed: bool = False
    """Whether it is replayed: its operator has done what there was to do."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """Something that should make the operator look up."""

    kind: str
    """Short name, always the same for the same thing: ``no cycles``, ``losses``, ..."""
    sentence: str
    """What is wrong and what to do."""


@dataclass(frozen=True, slots=True)
class OperatorMark:
    """A marker or note."""

    time_s: float
    """Since the first sample."""
    text: str
    """``marker 3``, or what was typed."""


@dataclass(frozen=True, slots=True)
class GuideView:
    """Where a guided trial is."""

    number: int
    """Step, from 1."""
    n_steps: int
    title: str
    """What to do, in a few words."""
    hint: str
    """How, and how far it is."""
    progress: float = 0.0
    """Of this step, 0-1."""


@dataclass(frozen=True, slots=True)
class TrialState:
    """Everything a screen needs, at one moment."""

    title: str = "rotdrift"
    elapsed_s: float = 0.0
    """Of the capture."""
    target: TargetView = field(default_factory=TargetView)
    score: ScoreView = field(default_factory=ScoreView)
    motion: MotionView = field(default_factory=MotionView)
    sensor: SensorView = field(default_factory=SensorView)
    stream: StreamView = field(default_factory=StreamView)
    clock: ClockView = field(default_factory=ClockView)
    link: LinkView = field(default_factory=LinkView)
    recording: RecordingView = field(default_factory=RecordingView)
    warnings: tuple[str, ...] = ()
    """What a person should know, the newest last."""
    alarms: tuple[Alarm, ...] = ()
    """What is wrong now, the most urgent first."""
    marks: tuple[OperatorMark, ...] = ()
    """The last markers and notes."""
    guide: GuideView | None = None
    """Step of a guided trial; None without a guide."""

    def with_cycles(self, cycles: tuple[CycleRow, ...]) -> TrialState:
        """Return the same moment with other cycles: they may be hundreds, and travel to the screen only when new."""
        return replace(self, score=replace(self.score, cycles=cycles))
