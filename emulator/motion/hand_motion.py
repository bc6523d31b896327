"""The hand's motion and the object's true drift, in closed form.

Time runs from the moment at which the hand's timeline starts: an idle lead-in, ``cycles`` cycles, an idle lead-out,
then rest for ever. The object's orientation is::

    q(t) = D(p) ⊗ exp(a(p) · axis) ⊗ E

``p`` is the phase in cycles, 0 at the first primary extreme. ``a`` is the excursion *from the primary extreme*: it is
zero at every primary end point, and amplitude variation shows only at the other extreme. ``D`` is the drift, a product
of world-frame rotations, one per cycle, each released in proportion to the path travelled in that cycle::

    D(p) = exp(path · w_k) ⊗ exp(w_{k−1}) ⊗ … ⊗ exp(w_0),   p in [k − 1, k]

Drift therefore stands still where the hand does, its rate is zero at both extremes, and r_i = q_{i+1} ⊗ q_i⁻¹ between
primary end points is exactly exp(w_i). ``E`` makes the pose at rest before the motion the initial pose.

The *primary* extreme is the one first reached after the start pose; both extremes are reached ``cycles`` times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from emulator import ScenarioError
from emulator.motion import cycle_shape
from emulator.motion.rotation import FloatArray, conjugate, from_rotation_vector, multiply, rotate
from emulator.settings import Settings, choice, integer, number, vector

IntArray = npt.NDArray[np.int64]

_TEMPO_STREAM, _AMPLITUDE_STREAM, _DRIFT_STREAM = 11, 12, 13


@dataclass(frozen=True)
class MotionSettings(Settings):
    """Scenario table ``[motion]``: what the hand does."""

    shape: str = choice("cosine", "cosine", "trapezoid", "two-hump", "double-peak")
    """Shape of a cycle: there and back; with a rest at both extremes; with a second peak; with it half a cycle on."""
    period_s: float = number(4.0, 0.2, 600.0)
    """Nominal duration of a cycle, s."""
    swing_deg: float = number(40.0, 0.1, 170.0)
    """Range of motion, degrees; negative is not needed: turn the axis around."""
    cycles: int = integer(12, 0, 100_000)
    """How many cycles; 0 is an object that never moves."""
    axis: tuple[float, float, float] = vector((1.0, 0.0, 0.0), unit=True)
    """Motion axis, world frame, unit."""
    lead_in_s: float = number(2.0, 0.0, 3600.0)
    """Rest before the motion, s."""
    lead_out_s: float = number(2.0, 0.0, 86_400.0)
    """Rest after the motion, s; then the scenario is over."""
    start_phase: float = number(0.0, 0.0, 0.999)
    """Where in the cycle the hand rests and starts: 0 is the near extreme."""
    dwell: float = number(0.2, 0.0, 0.45)
    """Trapezoid: rest at each extreme as a fraction of the cycle."""
    second_height: float = number(0.7, 0.05, 1.0)
    """Two-hump and double-peak: height of the second peak as a fraction of the swing."""
    saddle_height: float = number(0.35, 0.0, 0.9)
    """Two-hump and double-peak: height of the turn between the peaks; below ``second_height``."""
    tempo_variation: float = number(0.0, 0.0, 0.3)
    """Standard deviation of the cycle's duration as a fraction of the period; cut at 3 standard deviations."""
    tempo_trend: float = number(0.0, -0.9, 0.9)
    """Change of the cycle's duration from the first to the last cycle as a fraction of the period."""
    amplitude_variation: float = number(0.0, 0.0, 0.3)
    """Standard deviation of a cycle's swing as a fraction of it, at the extreme that is not primary."""
    amplitude_trend: float = number(0.0, -0.9, 0.9)
    """Change of the swing from the first to the last cycle as a fraction of it, at the extreme that is not primary."""
    pause_every: int = integer(0, 0, 100_000)
    """Rest at the extreme that is not primary after each so many primary end points; 0 never."""
    pause_s: float = number(0.0, 0.0, 3600.0)
    """How long each of these rests is, s."""
    initial_q_wxyz: tuple[float, float, float, float] = vector((1.0, 0.0, 0.0, 0.0), unit=True)
    """Pose at rest before the motion, body to world."""
    begins: str = choice("on-start", "on-start", "at-power-up")
    """The timeline starts with the first START the object gets, or when the object powers up."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shape in {"two-hump", "double-peak"} and self.saddle_height >= self.second_height:
            raise ScenarioError(f"saddle_height must be below second_height ({self.second_height:g})")

    @property
    def cycle(self) -> cycle_shape.CycleShape:
        """The shape of one cycle."""
        if self.shape == "trapezoid":
            return cycle_shape.trapezoid(self.dwell)
        if self.shape == "two-hump":
            return cycle_shape.two_hump(self.second_height, self.saddle_height)
        if self.shape == "double-peak":
            return cycle_shape.double_peak(self.second_height, self.saddle_height)
        return cycle_shape.cosine()


@dataclass(frozen=True)
class DriftSettings(Settings):
    """Scenario table ``[drift]``: how far the object turns in the hand in each cycle."""

    mode: str = choice("constant", "none", "constant", "alternating", "slip", "random-walk")
    """The same in each cycle; its sign changing each cycle; constant with one slip; constant plus random."""
    angle_deg: float = number(0.8, 0.0, 90.0)
    """Drift per cycle, degrees."""
    axis: tuple[float, float, float] = vector((0.0, 0.6, 0.8), unit=True)
    """Drift axis, world frame, unit."""
    slip_cycle: int = integer(6, 1, 100_000)
    """Slip: which step it is, 1 being the step from the first primary end point to the second."""
    slip_deg: float = number(8.0, 0.0, 90.0)
    """Slip: angle of that step about the drift axis, in place of ``angle_deg``."""
    scatter_deg: float = number(0.3, 0.0, 30.0)
    """Random walk: standard deviation about each axis of what is added to each step, degrees."""

    def check_slip(self, cycles: int) -> None:
        """Raise ScenarioError for a slip that is not a step between the end points of so many cycles."""
        if self.mode == "slip" and self.slip_cycle >= cycles:
            raise ScenarioError(
                f"drift.slip_cycle must be below motion.cycles ({cycles}): it is a step between end points"
            )


@dataclass(frozen=True, eq=False)
class Extremes:
    """The end points of one kind: one per cycle, always at the same phase."""

    kind: str
    """``"near"`` or ``"far"``."""
    times_s: FloatArray
    """(n,) since the timeline started, s."""
    quats_wxyz: FloatArray
    """(n, 4) true orientation, body to world."""


def drift_vectors(settings: DriftSettings, cycles: int, seed: int) -> FloatArray:
    """Return the drift of each interval of n cycles as world-frame rotation vectors.

    Returns
    -------
    numpy.ndarray
        (n + 1, 3) rad. Rows 1 … n−1 are the steps between primary end points; row 0 acts before the first primary end
        point and row n after the last, both in part only.
    """
    vectors = np.tile(np.radians(settings.angle_deg) * np.array(settings.axis), (cycles + 1, 1))
    if settings.mode == "none":
        vectors[:] = 0.0
    elif settings.mode == "alternating":
        vectors[0::2] *= -1.0
    elif settings.mode == "slip":
        settings.check_slip(cycles)
        vectors[settings.slip_cycle] = np.radians(settings.slip_deg) * np.array(settings.axis)
    elif settings.mode == "random-walk":
        rng = np.random.default_rng([seed, _DRIFT_STREAM])
        vectors += rng.normal(0.0, np.radians(settings.scatter_deg), vectors.shape)
    return vectors


class HandMotion:
    """The true orientation of the object as a function of time; tempo, amplitude and drift are seeded."""

    def __init__(self, motion: MotionSettings, drift: DriftSettings, seed: int) -> None:
        self.motion = motion
        n = motion.cycles
        self._shape = motion.cycle
        self._axis = np.array(motion.axis)
        near_first = motion.start_phase >= self._shape.far_phase
        self.primary_kind = "near" if near_first else "far"
        self._primary_phase = 1.0 if near_first else self._shape.far_phase
        other_phase = self._shape.far_phase if near_first else 0.0
        self._other_offset = (other_phase - self._primary_phase) % 1.0

        self._drift_vectors = drift_vectors(drift, n, seed)
        self._drift_before = np.empty((n + 1, 4))  # product of the drifts of all earlier intervals
        total = np.array([1.0, 0.0, 0.0, 0.0])
        for k, step in enumerate(from_rotation_vector(self._drift_vectors)):
            self._drift_before[k] = total
            total = multiply(step, total)
            total /= np.linalg.norm(total)

        wobble = np.random.default_rng([seed, _AMPLITUDE_STREAM]).standard_normal(n + 1).clip(-3.0, 3.0)
        trend = motion.amplitude_trend * (np.arange(n + 1) / max(n, 1) - 0.5)
        scale = np.maximum(1.0 + trend + motion.amplitude_variation * wobble, 0.2)
        self._swings_rad = np.radians(motion.swing_deg) * scale
        self.periods_s = self._durations(seed)
        self._phase_knots, self._time_knots = self._knots()
        self._settle = np.array([1.0, 0.0, 0.0, 0.0])
        if n:
            start = self._pose(self._phase_knots[:1])[0]
            self._settle = multiply(conjugate(start), np.array(motion.initial_q_wxyz))

    def _durations(self, seed: int) -> FloatArray:
        """Duration of each of the n + 1 intervals between primary extremes, s; the outer two happen in part only."""
        motion, n = self.motion, self.motion.cycles
        noise = np.random.default_rng([seed, _TEMPO_STREAM]).standard_normal(n + 1).clip(-3.0, 3.0)
        trend = motion.tempo_trend * (np.arange(n + 1) / max(n, 1) - 0.5)
        return motion.period_s * np.maximum(1.0 + trend + motion.tempo_variation * noise, 0.3)

    def _knots(self) -> tuple[FloatArray, FloatArray]:
        """Phases and times between which phase is linear in time: start, every primary extreme, pauses, end."""
        n = self.motion.cycles
        first = self.motion.start_phase - self._primary_phase
        if n == 0:
            return np.array([first, first]), np.array([self.motion.lead_in_s] * 2)
        phases = np.concatenate([[first], np.arange(n, dtype=np.float64), [first + n]])
        durations = np.diff(phases) * self.periods_s
        times_s = self.motion.lead_in_s + np.concatenate([[0.0], np.cumsum(durations)])
        every = self.motion.pause_every
        if every == 0 or self.motion.pause_s == 0.0:
            return phases, times_s
        # A pause is one phase at two moments, its start and its end.
        paused = np.arange(every - 1, n - 1, every) + self._other_offset
        before = np.arange(len(paused))
        knots = np.concatenate([phases, paused, paused])
        held = np.concatenate([np.searchsorted(paused, phases), before, before + 1])
        order = np.lexsort((held, knots))
        knots, held = knots[order], held[order]
        return knots, np.interp(knots, phases, times_s) + self.motion.pause_s * held

    @property
    def duration_s(self) -> float:
        """From the start of the timeline to the end of the lead-out, s."""
        return float(self._time_knots[-1] + self.motion.lead_out_s)

    def phase(self, times_s: FloatArray) -> FloatArray:
        """Return the phase in cycles at times since the timeline started, (n,); it rests outside the motion."""
        return np.interp(times_s, self._time_knots, self._phase_knots).astype(np.float64)

    def orientation(self, times_s: FloatArray) -> FloatArray:
        """Return the true orientation (n, 4), unit, body to world, at any times (n,) s since the timeline started.

        The sign of the quaternions is continuous.
        """
        times_s = np.asarray(times_s, dtype=np.float64)
        if self.motion.cycles == 0:
            return np.tile(np.array(self.motion.initial_q_wxyz), (len(times_s), 1))
        return multiply(self._pose(self.phase(times_s)), self._settle)

    def angular_velocity(self, times_s: FloatArray) -> FloatArray:
        """Return the true rate of turn (n, 3), world frame, rad/s, at times (n,) s since the timeline started."""
        times_s = np.asarray(times_s, dtype=np.float64)
        if self.motion.cycles == 0:
            return np.zeros((len(times_s), 3))
        phase = self.phase(times_s)
        moving = (times_s > self._time_knots[0]) & (times_s < self._time_knots[-1])
        k, _, rate, path, path_rate = self._state(phase)
        phase_rate = np.where(moving, 1.0 / self.periods_s[k], 0.0)[:, None]
        drift = multiply(from_rotation_vector(path[:, None] * self._drift_vectors[k]), self._drift_before[k])
        swinging = rotate(drift, (rate * self._swings_rad[k])[:, None] * self._axis)
        rate_rad_s: FloatArray = phase_rate * (path_rate[:, None] * self._drift_vectors[k] + swinging)
        return rate_rad_s

    def primary(self) -> Extremes:
        """Return the primary end points: the extreme first reached after the start pose."""
        return self._extremes(self.primary_kind, np.arange(self.motion.cycles, dtype=np.float64))

    def other(self) -> Extremes:
        """Return the end points at the other extreme; a start pose there is not one of them."""
        phases = np.arange(-1, self.motion.cycles) + self._other_offset
        reached = (phases > self._phase_knots[0] + 1e-9) & (phases <= self._phase_knots[-1] + 1e-9)
        return self._extremes("far" if self.primary_kind == "near" else "near", phases[reached])

    def _extremes(self, kind: str, phases: FloatArray) -> Extremes:
        if len(phases) == 0:
            return Extremes(kind, np.empty(0), np.empty((0, 4)))
        # Where the hand pauses at an extreme, its moment is the middle of the pause.
        knots, times_s = self._phase_knots, self._time_knots
        ends_s = np.interp(phases, knots, times_s)
        first = np.searchsorted(knots, phases).clip(max=len(knots) - 1)
        starts_s = np.where(knots[first] == phases, times_s[first], ends_s)
        times_s = 0.5 * (starts_s + ends_s)
        return Extremes(kind, times_s, multiply(self._pose(phases), self._settle))

    def _state(self, phase: FloatArray) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Interval number, excursion from the primary extreme in swings, its rate, path in the interval, its rate."""
        k = np.clip(np.floor(phase).astype(np.int64) + 1, 0, self.motion.cycles)
        height, rate, path, path_rate = self._shape.evaluate(phase - (k - 1) + self._primary_phase)
        top, _, path_start, _ = self._shape.evaluate(np.array([self._primary_phase]))
        return k, height - top, rate, path - path_start, path_rate

    def _pose(self, phase: FloatArray) -> FloatArray:
        """D(p) ⊗ exp(a(p) · axis)."""
        k, excursion, _, path, _ = self._state(phase)
        drift = multiply(from_rotation_vector(path[:, None] * self._drift_vectors[k]), self._drift_before[k])
        return multiply(drift, from_rotation_vector((excursion * self._swings_rad[k])[:, None] * self._axis))
