"""The known truth of a run: true end points, true steps, true θ̄, and what was done to the data; written as JSON.

``theta_bar_deg`` follows the benchmark card from the true orientation at the primary end points: r_i = q_{i+1} ⊗ q_i⁻¹,
the unit eigenvector of the largest eigenvalue of M = Σ r_i r_iᵀ, θ̄ = 2·atan2(|v|, |a|). It is computed here, by itself,
and shares no code with the analysis that is tested against it. For constant drift it is the programmed angle.

``endpoints`` are those of the *primary* extreme, the one first reached after the start pose; ``other_extreme`` has the
other's. Each end point has its true time since power-up (``time_s``), what the object's clock shows then
(``device_time_us``, wrapped), the true orientation, and the sample nearest in time: its ``sequence`` counted since boot
without wrap, the ``boot`` it belongs to, and ``sample_dt_s``, how much later it was measured. They are null for what
has not happened yet.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from emulator.device.clock import DeviceClock
from emulator.device.sample_stream import SampleBlock
from emulator.motion.hand_motion import Extremes
from emulator.motion.rotation import FloatArray, conjugate, multiply, to_rotation_vector
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US

FORMAT = "rotdrift-truth-1"
_NEAR_S = 0.11  # a sample further from an end point than a period of the slowest rate is not its sample


def _steps(quats_wxyz: FloatArray) -> FloatArray:
    return multiply(quats_wxyz[1:], conjugate(quats_wxyz[:-1]))


def step_angles_deg(quats_wxyz: FloatArray) -> list[float]:
    """Return the angle of each step between end points (n, 4), degrees, n − 1 of them."""
    angles: list[float] = np.degrees(np.linalg.norm(to_rotation_vector(_steps(quats_wxyz)), axis=1)).tolist()
    return angles


def mean_drift(quats_wxyz: FloatArray) -> tuple[float | None, list[float] | None]:
    """Return θ̄ of the card and the axis of the mean rotation.

    Parameters
    ----------
    quats_wxyz : (n, 4)
        Orientation at the end points.

    Returns
    -------
    theta_bar_deg : float or None
        Degrees, in [0, 180]; None with fewer than two end points.
    axis : list or None
        Unit, world frame; None where the angle is too small to have one.
    """
    if len(quats_wxyz) < 2:
        return None, None
    steps = _steps(quats_wxyz)
    _, vectors = np.linalg.eigh(steps.T @ steps)
    mean = vectors[:, -1] if vectors[0, -1] >= 0.0 else -vectors[:, -1]
    sine = float(np.linalg.norm(mean[1:]))
    theta_bar_deg = float(np.degrees(2.0 * np.arctan2(sine, abs(mean[0]))))
    return theta_bar_deg, (mean[1:] / sine).tolist() if theta_bar_deg > 1e-9 else None


class EndpointWatch:
    """Finds the sample nearest to each end point of one kind while samples are produced."""

    def __init__(self, extremes: Extremes, clock: DeviceClock) -> None:
        self._extremes, self._clock = extremes, clock
        self._times_s: FloatArray | None = None
        n = len(extremes.times_s)
        self._dt_s = np.full(n, np.inf)
        self._sequence = np.full(n, -1, dtype=np.int64)
        self._boot = np.full(n, -1, dtype=np.int64)
        self._uptime_us = np.full(n, np.nan)

    def start(self, hand_start_s: float) -> None:
        """Fix the end points in time: the hand's timeline starts."""
        self._times_s = self._extremes.times_s + hand_start_s

    def feed(self, block: SampleBlock, boot: int) -> int:
        """Process a run of samples; return how many end points it came near to."""
        if self._times_s is None:
            return 0
        low = int(np.searchsorted(self._times_s, block.times_s[0] - _NEAR_S))
        high = int(np.searchsorted(self._times_s, block.times_s[-1] + _NEAR_S))
        for k in range(low, high):
            nearest = int(np.argmin(np.abs(block.times_s - self._times_s[k])))
            dt_s = block.times_s[nearest] - self._times_s[k]
            if abs(dt_s) < min(abs(self._dt_s[k]), _NEAR_S):
                self._dt_s[k], self._boot[k], self._sequence[k] = dt_s, boot, block.first + nearest
                self._uptime_us[k] = self._clock.uptime_us(self._times_s[k : k + 1])[0]
        return high - low

    def document(self) -> dict[str, Any]:
        """Return kind, θ̄, axis, steps and end points, ready for JSON."""
        quats = self._extremes.quats_wxyz
        theta_bar_deg, axis = mean_drift(quats)
        return {
            "kind": self._extremes.kind,
            "theta_bar_deg": theta_bar_deg,
            "axis": axis,
            "steps_deg": step_angles_deg(quats),
            "endpoints": [self._endpoint(k) for k in range(len(quats))],
        }

    def _endpoint(self, k: int) -> dict[str, Any]:
        time_s = None if self._times_s is None else float(self._times_s[k])
        met = self._boot[k] >= 0
        uptime_us = self._uptime_us[k]
        if time_s is not None and not met:
            uptime_us = self._clock.uptime_us(np.array([time_s]))[0]
        return {
            "motion_time_s": float(self._extremes.times_s[k]),
            "time_s": time_s,
            "device_time_us": None if np.isnan(uptime_us) else int(uptime_us) % DEVICE_CLOCK_MODULUS_US,
            "sequence": int(self._sequence[k]) if met else None,
            "boot": int(self._boot[k]) if met else None,
            "sample_dt_s": float(self._dt_s[k]) if met else None,
            "quat_wxyz": self._extremes.quats_wxyz[k].tolist(),
        }


def write_truth(path: Path, document: dict[str, Any]) -> None:
    """Write a truth document so that a reader finds the old one or the new one, never a part.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n")
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)
