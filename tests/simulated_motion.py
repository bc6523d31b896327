"""Simulated trials with a known answer, and motions that are no trials, for the tests of the search for cycles.

Independent of the code under test: rotations come from scipy. Everything is a pure function of its arguments.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from analysis.series import FloatArray, OrientationSeries

Shape = Callable[[FloatArray], FloatArray]

BODY = Rotation.from_rotvec([0.3, -1.1, 0.7])


def cosine(phase: FloatArray) -> FloatArray:
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * phase)


def trapezoid(phase: FloatArray) -> FloatArray:
    """Ramp up in 0.3 of a cycle, dwell 0.2, ramp down 0.3, dwell 0.2; corners rounded by a cosine."""
    distance = np.abs((phase % 1.0) - 0.5)
    return 0.5 - 0.5 * np.cos(np.pi * np.clip((0.4 - distance) / 0.3, 0.0, 1.0))


def triangle(phase: FloatArray) -> FloatArray:
    return 1.0 - 2.0 * np.abs((phase % 1.0) - 0.5)


def sawtooth(phase: FloatArray) -> FloatArray:
    """Up in three quarters of a cycle, down in one; the far end is still at phase 0.5."""
    shifted = (phase + 0.25) % 1.0
    return np.where(
        shifted < 0.75, 0.5 - 0.5 * np.cos(np.pi * shifted / 0.75), 0.5 + 0.5 * np.cos(np.pi * (shifted - 0.75) / 0.25)
    )


def two_humps(phase: FloatArray) -> FloatArray:
    """A lower peak, a deep dip, a higher peak at phase 0.5, and back."""
    part = phase % 1.0
    points = np.array([0.0, 0.22, 0.34, 0.5, 0.75, 1.0])
    values = np.array([0.0, 0.7, 0.15, 1.0, 0.25, 0.0])
    k = np.clip(np.searchsorted(points, part, side="right") - 1, 0, len(points) - 2)
    inside = (part - points[k]) / (points[k + 1] - points[k])
    return values[k] + (values[k + 1] - values[k]) * (0.5 - 0.5 * np.cos(np.pi * inside))


def equal_peaks(phase: FloatArray) -> FloatArray:
    """Two peaks of one height half a cycle apart; the turn between them is a sixth of the swing above the other one."""
    part = phase % 1.0
    low = 1.0 / 6.0 * (0.5 - 0.5 * np.cos(2.0 * np.pi * part))
    return low + (1.0 - low) * (0.5 - 0.5 * np.cos(4.0 * np.pi * part))


def staircase(phase: FloatArray) -> FloatArray:
    """Up in nine quick steps with rests between them, and down in nine: a hand that sticks and slips."""
    height = 9.0 * (1.0 - 2.0 * np.abs((phase % 1.0) - 0.5))
    step = np.floor(height)
    return (step + 0.5 - 0.5 * np.cos(np.pi * np.clip((height - step - 0.4) / 0.2, 0.0, 1.0))) / 9.0


@dataclass(frozen=True)
class Trial:
    """A simulated trial and its truth: one end point per cycle, at the far extreme (phase 0.5)."""

    series: OrientationSeries
    endpoint_s: FloatArray
    quats_wxyz: FloatArray = field(repr=False)

    @property
    def theta_bar_deg(self) -> float:
        return theta_bar_deg(self.quats_wxyz)


def theta_bar_deg(quats_wxyz: FloatArray) -> float:
    """Card steps 2 to 4, by scipy and numpy alone."""
    poses = Rotation.from_quat(quats_wxyz, scalar_first=True)
    steps = (poses[1:] * poses[:-1].inv()).as_quat(scalar_first=True)
    mean = np.linalg.eigh(steps.T @ steps)[1][:, -1]
    return float(np.degrees(2.0 * np.arctan2(np.linalg.norm(mean[1:]), abs(mean[0]))))


def simulate(
    shape: Shape = cosine,
    *,
    cycles: int = 10,
    period_s: float = 4.0,
    swing_deg: float = 40.0,
    drift_deg: float = 0.8,
    axis: tuple[float, float, float] = (0.2, 0.9, -0.4),
    drift_axis: tuple[float, float, float] = (0.5, 0.5, 0.7),
    rate_hz: float = 100.0,
    lead_s: float = 3.0,
    tempo: FloatArray | None = None,
    amplitude: FloatArray | None = None,
    slip_deg: float = 0.0,
    slip_cycle: int = 0,
    wobble_deg: float = 0.0,
    noise_deg: float = 0.0,
    pause_after: int | None = None,
    pause_s: float = 0.0,
    seed: int = 0,
) -> Trial:
    """Idle, ``cycles`` cycles, idle.

    ``tempo`` and ``amplitude`` (cycles,) scale each cycle's duration and swing. Drift happens on the way back (phase
    0.6 to 0.9). A slip happens at phase 0.75 of ``slip_cycle`` within a twentieth of a period. ``wobble_deg`` tilts
    about a second axis at twice the frequency. ``pause_after`` holds still after that cycle.
    """
    rng = np.random.default_rng(seed)
    durations = period_s * (np.ones(cycles) if tempo is None else np.asarray(tempo))
    scale = np.ones(cycles) if amplitude is None else np.asarray(amplitude)
    starts = np.concatenate(([0.0], np.cumsum(durations)))
    holds = np.zeros(cycles + 1)
    if pause_after is not None:
        holds[pause_after:] = pause_s
    begin_s, end_s = starts + holds, starts[1:] + holds[:-1]
    total_s = end_s[-1] + 2.0 * lead_s
    times_s = np.arange(int(total_s * rate_hz) + 1) / rate_hz

    def pose(t: FloatArray) -> Rotation:
        local = t - lead_s
        k = np.clip(np.searchsorted(begin_s[:-1], local, side="right") - 1, 0, cycles - 1)
        part = np.clip((local - begin_s[k]) / durations[k], 0.0, 1.0)
        swing = np.radians(swing_deg) * scale[k] * shape(part)
        ramp = np.clip((part - 0.6) / 0.3, 0.0, 1.0)
        drift = np.radians(drift_deg) * (k + ramp * ramp * (3.0 - 2.0 * ramp))
        if slip_deg:
            drift += np.radians(slip_deg) * np.clip((k + part - slip_cycle - 0.75) / 0.05, 0.0, 1.0)
        wobble = np.radians(wobble_deg) * np.sin(4.0 * np.pi * part) * (shape(part) if wobble_deg else 0.0)
        main = np.asarray(axis) / np.linalg.norm(axis)
        side = np.cross(main, [0.0, 0.0, 1.0])
        creep = np.asarray(drift_axis) / np.linalg.norm(drift_axis)
        return (
            Rotation.from_rotvec(drift[:, None] * creep)
            * Rotation.from_rotvec(swing[:, None] * main + wobble[:, None] * side)
            * BODY
        )

    poses = pose(times_s)
    if noise_deg:
        poses = Rotation.from_rotvec(np.radians(noise_deg) * rng.standard_normal((len(times_s), 3))) * poses
    ends_s = begin_s[:-1] + 0.5 * durations + lead_s
    quats = poses.as_quat(scalar_first=True)
    series = OrientationSeries(times_s, quats, np.arange(len(times_s)))
    return Trial(series, ends_s, pose(ends_s).as_quat(scalar_first=True))


def from_rotation_vectors(rotvecs: FloatArray, rate_hz: float = 100.0) -> OrientationSeries:
    """A series of absolute rotation vectors, rad."""
    quats = (Rotation.from_rotvec(rotvecs) * BODY).as_quat(scalar_first=True)
    return OrientationSeries(np.arange(len(quats)) / rate_hz, quats, np.arange(len(quats)))


def from_angular_velocity(omega: FloatArray, rate_hz: float = 100.0) -> OrientationSeries:
    """Integrate ω in world axes, rad/s."""
    pose = BODY
    quats = [pose.as_quat(scalar_first=True)]
    for step in Rotation.from_rotvec(omega / rate_hz):
        pose = step * pose
        quats.append(pose.as_quat(scalar_first=True))
    return OrientationSeries(np.arange(len(quats)) / rate_hz, np.array(quats), np.arange(len(quats)))


def random_smooth(
    seed: int,
    *,
    duration_s: float = 60.0,
    bandwidth_s: float = 0.5,
    swing_deg: float = 20.0,
    one_axis: bool = False,
) -> OrientationSeries:
    """Random motion smoothed by a Gaussian of ``bandwidth_s``, ``swing_deg`` its standard deviation."""
    rng = np.random.default_rng(seed)
    raw = rng.standard_normal((int(duration_s * 100), 1 if one_axis else 3))
    smooth = gaussian_filter1d(raw, bandwidth_s * 100.0, axis=0, mode="wrap")
    axes = np.array([[0.2, 0.9, -0.4]]) / np.linalg.norm([0.2, 0.9, -0.4]) if one_axis else np.eye(3)
    return from_rotation_vectors(np.radians(swing_deg) * (smooth / smooth.std()) @ axes)
