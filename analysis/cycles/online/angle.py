"""The angle about the motion axis, sample by sample: causal, constant work per sample, constant memory.

Plain floats and tuples on purpose: chunks of a live stream hold a few samples, where numpy costs more than it saves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

BIN_S = 0.01
"""Samples this close together are averaged into one, s: faster streams cost no more than 100 Hz."""

_SPEED_S = 0.1
_MIN_AXIS_S = 3.0
_AXIS_PERIODS = 1.5


@dataclass(frozen=True, slots=True)
class AnglePoint:
    """One binned moment of the stream."""

    time_s: float
    """Mean time of the samples in it, s."""
    angle_rad: float
    """s: rotation about the motion axis since the start, rad; not cut at ±180°."""
    quat_wxyz: Quaternion
    """Mean orientation, unit, scalar first."""
    index: int
    """Name of the sample in the middle of it."""


class OnlineAngle:
    """Follow the motion axis and the angle about it.

    ω is smoothed over 0.1 s and ωωᵀ over max(3 s, 1.5 periods), both exponentially; the axis moves by two steps of
    power iteration per moment; s grows by n·dr.
    """

    def __init__(self) -> None:
        self.axis: Vector = (0.0, 0.0, 1.0)
        """Unit motion axis, world frame."""
        self.speed = 0.0
        """|ω| smoothed over 0.1 s as a vector, rad/s."""
        self.noise_rad = 0.0
        """Noise of s from moment to moment, standard deviation, rad."""
        self._last: AnglePoint | None = None
        self._omega: Vector = (0.0, 0.0, 0.0)
        self._tensor = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # xx, xy, xz, yy, yz, zz
        self._count = 0
        self._steps = (0.0, 0.0)  # the last step of s and its smoothed squared second difference

    @property
    def axis_share(self) -> float:
        """Share of the recent motion about the motion axis; 1 before anything moved."""
        xx, xy, xz, yy, yz, zz = self._tensor
        x, y, z = self.axis
        total = xx + yy + zz
        along = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
        return along / total if total > 0.0 else 1.0

    def add(self, time_s: float, quat_wxyz: Quaternion, index: int, period_s: float) -> AnglePoint:
        """Receive one moment, later than the one before, and return the angle there.

        ``period_s`` is the period as far as known, 0 where not.
        """
        last = self._last
        if last is None:
            self._last = AnglePoint(time_s, 0.0, quat_wxyz, index)
            return self._last
        step_s = time_s - last.time_s
        turn = _rotation_vector(quat_wxyz, last.quat_wxyz)
        self._follow(turn, step_s, period_s)
        step = turn[0] * self.axis[0] + turn[1] * self.axis[1] + turn[2] * self.axis[2]
        before, spread = self._steps
        bend = step - before
        self._count += 1
        spread += max(min(step_s / _MIN_AXIS_S, 1.0), 1.0 / self._count) * (bend * bend - spread)
        self._steps = (step, spread)
        self.noise_rad = math.sqrt(spread / 6.0)  # the second difference of independent noise has 6 times its variance
        self._last = AnglePoint(time_s, last.angle_rad + step, quat_wxyz, index)
        return self._last

    def _follow(self, turn: Vector, step_s: float, period_s: float) -> None:
        """Turn the axis towards that of the newest motion."""
        part = -math.expm1(-step_s / max(_SPEED_S, 0.03 * period_s))
        ox, oy, oz = self._omega
        ox += part * (turn[0] / step_s - ox)
        oy += part * (turn[1] / step_s - oy)
        oz += part * (turn[2] / step_s - oz)
        self._omega = (ox, oy, oz)
        self.speed = math.sqrt(ox * ox + oy * oy + oz * oz)
        part = -math.expm1(-step_s / max(_MIN_AXIS_S, _AXIS_PERIODS * period_s))
        xx, xy, xz, yy, yz, zz = self._tensor
        xx += part * (ox * ox - xx)
        xy += part * (ox * oy - xy)
        xz += part * (ox * oz - xz)
        yy += part * (oy * oy - yy)
        yz += part * (oy * oz - yz)
        zz += part * (oz * oz - zz)
        self._tensor = (xx, xy, xz, yy, yz, zz)
        # Power iteration: each product with the tensor turns the axis towards its largest eigenvector. As the tensor
        # changes little from moment to moment, two steps keep up with it.
        x, y, z = self.axis
        for _ in range(2):
            x, y, z = xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z
            length = math.sqrt(x * x + y * y + z * z)
            if length < 1e-30:  # at rest, or square to the only axis so far: start with the largest component
                diagonal = (xx, yy, zz)
                k = diagonal.index(max(diagonal))
                x, y, z = (float(k == 0), float(k == 1), float(k == 2))
                continue
            x, y, z = x / length, y / length, z / length
        self.axis = (x, y, z)


def _rotation_vector(later: Quaternion, earlier: Quaternion) -> Vector:
    """Return log(q_later ⊗ q_earlier⁻¹) by the shorter way, rad, world axes."""
    aw, ax, ay, az = later
    bw, bx, by, bz = earlier
    w = aw * bw + ax * bx + ay * by + az * bz
    x = -aw * bx + ax * bw - ay * bz + az * by
    y = -aw * by + ax * bz + ay * bw - az * bx
    z = -aw * bz - ax * by + ay * bx + az * bw
    length = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if length < 1e-9 else 2.0 * math.atan2(length, abs(w)) / length
    if w < 0.0:
        scale = -scale
    return (x * scale, y * scale, z * scale)
