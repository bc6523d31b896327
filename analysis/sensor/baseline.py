"""The static baseline: what the sensor reports while nothing moves.

A 6-axis IMU turns by itself about the vertical, 0.4 to 6 degrees a minute; at periods of seconds that is as large as
the scores. So a score without the sensor's own drift is not a measurement. :func:`measure_baseline` needs a recording
of the object at rest (a minute or more, on a table, warmed up), :mod:`analysis.sensor.baseline_file` writes it as
TOML, and the score uses it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.geometry import rotations
from analysis.sensor.still_holds import Creep, block_orientations, measure_creep
from analysis.series import BaselineError, FloatArray, OrientationSeries

MIN_DURATION_S = 10.0
"""A shorter rest makes no baseline."""
ADVISED_DURATION_S = 60.0
"""From here on the rate is good to a few hundredths of a degree a minute with usual parts."""
MAX_RATE_DEG_PER_MIN = 30.0
"""Faster than this it is the object that turns, not the sensor's heading."""
MAX_GAP_SHARE = 0.5
"""A gap of more than this share of the time makes no baseline."""
MAX_DAYS = 10
"""The Allan figure is made of every second of a rest."""
MIN_ALLAN_S = 60.0
"""A shorter rest makes no Allan figure."""
_MOVE_DEG = 0.1  # a step of this size between one-second means, ten times the usual, is a touch ...
_MAX_USUAL_MOVE_DEG = 1.0  # ... and one of this size is, however usual: an object in a moving hand moves all the time


@dataclass(frozen=True)
class AllanPoint:
    """Allan deviation of the heading rate at one averaging time, all axes together."""

    tau_s: float
    """Averaging time."""
    deviation_deg_per_min: float
    """Allan deviation of the rate at it, length over the three axes."""


@dataclass(frozen=True)
class StaticBaseline:
    """The sensor at rest. World axes; root mean squares are of the rotation angle."""

    rate_deg_per_min: tuple[float, float, float]
    """Heading drift about each world axis."""
    rate_error_deg_per_min: tuple[float, float, float]
    """Its standard error: from the noise, and from the random walk where the rest was long enough to see it."""
    noise_deg: float
    """Noise of one sample, root mean square."""
    walk_deg_per_sqrt_s: float
    """Random walk, root mean square after one second; 0 where the rest was too short to see it."""
    duration_s: float
    """Length of the rest."""
    n_samples: int
    """Samples in it."""
    allan: tuple[AllanPoint, ...] = ()
    """Empty where the rest was shorter than ``MIN_ALLAN_S``."""
    temperature_c: tuple[float, float] | None = None
    """Lowest and highest sensor temperature meanwhile, where known."""
    source: str = ""
    """What it was measured from."""
    notes: tuple[str, ...] = ()
    """What is odd about it."""

    @property
    def total_rate_deg_per_min(self) -> float:
        """Heading drift, length over the three axes, deg/min."""
        return float(np.linalg.norm(self.rate_deg_per_min))

    def per_cycle_deg(self, period_s: float) -> float:
        """Return the rotation drift per cycle that this sensor can fake at a period, deg: rate × T."""
        return self.total_rate_deg_per_min * period_s / 60.0

    def detectable_deg(self, period_s: float, n_endpoints: int) -> float:
        """Return the minimal detectable drift: the 95th percentile of θ̄ of an object at rest, when cut every T.

        A static object scores θ̄ = |ω T + e|. The error e is the difference of the first and the last pose over n − 1
        steps: per axis its variance is (2 σ² + w² (n − 1) T)/(n − 1)², with σ the noise of a pose and w the random
        walk. So θ̄² is noncentral χ² with 3 degrees of freedom, whose quantile this returns. Heading drift keeps its
        size but not its direction between trials, so it counts in full.

        Parameters
        ----------
        period_s : float
            Length of a cycle T, s.
        n_endpoints : int
            End points of the trial n.

        Returns
        -------
        deg per cycle.
        """
        from scipy import special

        steps = max(n_endpoints - 1, 1)
        offset = self.per_cycle_deg(period_s)
        variance = (2.0 * self.noise_deg**2 + self.walk_deg_per_sqrt_s**2 * steps * period_s) / 3.0 / steps**2
        if variance <= 0.0 or offset**2 / variance > 1e8:
            return offset
        return float(np.sqrt(variance * special.chndtrix(0.95, 3, offset**2 / variance)))


def measure_baseline(series: OrientationSeries, temperatures_c: Sequence[float] = ()) -> StaticBaseline:
    """Return what the sensor does while the object lies still for at least ``MIN_DURATION_S``.

    ``temperatures_c`` are those of the sensor streamed meanwhile, °C.

    Raises
    ------
    BaselineError
        Too short, or the object moved; names when and by how much.
    """
    if len(series) < 20 or series.duration_s < MIN_DURATION_S:
        raise BaselineError(
            f"a baseline needs at least {MIN_DURATION_S:.0f} s at rest ({ADVISED_DURATION_S:.0f} s or more is good), "
            f"got {series.duration_s:.1f} s with {len(series)} samples"
        )
    widest_s = float(np.diff(series.times_s).max())
    if widest_s > MAX_GAP_SHARE * series.duration_s:
        raise BaselineError(
            f"nothing is known of {widest_s:.3g} of {series.duration_s:.3g} s: was the clock set there?"
        )
    if series.duration_s > MAX_DAYS * 86400.0:
        raise BaselineError(
            f"a baseline has at most {MAX_DAYS} days, not {series.duration_s / 86400.0:.3g}: is the unit of time right?"
        )
    _refuse_motion(series)
    creep = measure_creep(series.times_s, series.quats_wxyz)
    allan, walk = _allan(series)
    known = [float(t) for t in temperatures_c if math.isfinite(t)]
    notes = []
    if series.duration_s < ADVISED_DURATION_S:
        notes.append(
            f"only {series.duration_s:.0f} s at rest: too short to tell a random walk, which would make the rate's "
            f"error larger; {ADVISED_DURATION_S:.0f} s or more make it firmer"
        )
    if len(series.gaps()):
        notes.append(f"{len(series.gaps())} gaps in the recording")
    return StaticBaseline(
        rate_deg_per_min=_triple(creep.rate_deg_per_min),
        rate_error_deg_per_min=_triple(np.hypot(creep.rate_error_deg_per_min, _walk_error(walk, series.duration_s))),
        noise_deg=creep.noise_deg,
        walk_deg_per_sqrt_s=walk,
        duration_s=series.duration_s,
        n_samples=len(series),
        allan=allan,
        temperature_c=(min(known), max(known)) if known else None,
        source=series.source,
        notes=tuple(notes),
    )


def baseline_from_holds(holds: Sequence[Creep]) -> StaticBaseline | None:
    """Return a baseline made of the rests inside a trial, weighted by their precision; None without rests."""
    if not holds:
        return None
    rates = np.array([hold.rate_deg_per_min for hold in holds])
    weights = np.array([hold.duration_s**3 for hold in holds])  # variance of a slope falls with length cubed
    weights /= weights.sum()
    rate = weights @ rates
    errors = np.array([hold.rate_error_deg_per_min for hold in holds])
    within = np.sqrt(weights**2 @ errors**2)
    between = np.sqrt(weights @ (rates - rate) ** 2 / max(len(holds) - 1, 1)) if len(holds) > 1 else np.zeros(3)
    samples = np.array([hold.n_samples for hold in holds])
    noise = np.array([hold.noise_deg for hold in holds])
    lengths = ", ".join(f"{hold.duration_s:.1f} s" for hold in holds)
    return StaticBaseline(
        rate_deg_per_min=_triple(rate),
        rate_error_deg_per_min=_triple(np.maximum(within, between)),
        noise_deg=float(np.sqrt(samples @ noise**2 / samples.sum())),
        walk_deg_per_sqrt_s=0.0,
        duration_s=float(sum(hold.duration_s for hold in holds)),
        n_samples=int(samples.sum()),
        source=f"rests inside the trial ({lengths})",
        notes=("in the hand at rest: an upper bound, the object may creep as well",),
    )


def _walk_error(walk_deg_per_sqrt_s: float, duration_s: float) -> float:
    """Return the standard error per axis of a line fitted to a random walk: variance 6 N²/(5 T) for N along it."""
    return float(np.sqrt(6.0 / 5.0 / duration_s) * walk_deg_per_sqrt_s / np.sqrt(3.0) * 60.0)


def _triple(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _refuse_motion(series: OrientationSeries) -> None:
    blocks = block_orientations(series.times_s, series.quats_wxyz, 1.0)
    steps = np.diff(blocks.path_deg, axis=0)
    spacing_s = np.diff(blocks.at_s)
    rates = steps / spacing_s[:, None]
    usual = np.median(rates, axis=0)
    rate = float(np.linalg.norm(usual)) * 60.0
    if rate > MAX_RATE_DEG_PER_MIN:
        raise BaselineError(
            f"the object turns at {rate:.0f}°/min, a resting sensor at most {MAX_RATE_DEG_PER_MIN:.0f}; "
            "lay it down and measure again"
        )
    off = np.linalg.norm((rates - usual) * spacing_s[:, None], axis=1)
    noise_deg = np.degrees(np.median(rotations.distance(series.quats_wxyz[1:], series.quats_wxyz[:-1])))
    jitter_deg = float(noise_deg) / np.sqrt(max(len(series) / len(blocks.at_s), 1.0))
    limit = max(_MOVE_DEG, 10.0 * jitter_deg, min(10.0 * float(np.median(off)), _MAX_USUAL_MOVE_DEG))
    if off.max() > limit:
        first = int(np.argmax(off > limit))
        raise BaselineError(
            f"the object moved by {off.max():.2f}° (first {blocks.at_s[first] - series.times_s[0]:.0f} s after the "
            "start); lay it down, do not touch it, and measure again"
        )


def _allan(series: OrientationSeries) -> tuple[tuple[AllanPoint, ...], float]:
    """Return the overlapping Allan deviation of the rate from the orientation, and the random walk in it.

    τ²σ²(τ) = 3 σ_θ² + N² τ where noise of the orientation and random walk rule: N² is the slope.
    Source: IEEE Std 952, annex C.
    """
    if series.duration_s < MIN_ALLAN_S:
        return (), 0.0
    blocks = block_orientations(series.times_s, series.quats_wxyz, 1.0)
    grid = np.arange(blocks.at_s[0], blocks.at_s[-1], 1.0)
    path = np.stack([np.interp(grid, blocks.at_s, blocks.path_deg[:, k]) for k in range(3)], axis=1)
    points, power = [], []
    m = 1
    while 4 * m < len(path):
        second = path[2 * m :] - 2.0 * path[m:-m] + path[: -2 * m]
        power.append(float(np.mean(np.sum(second**2, axis=1))) / 2.0)
        points.append(AllanPoint(float(m), float(np.sqrt(power[-1])) / m * 60.0))
        m *= 2
    tau_s = np.array([point.tau_s for point in points if point.tau_s <= 32.0])
    if len(tau_s) < 3:
        return tuple(points), 0.0
    short = np.array(power[: len(tau_s)])
    # Relative weights: the power grows with τ and so does its uncertainty.
    slope = np.polyfit(tau_s, short, 1, w=1.0 / np.maximum(short, 1e-30))[0]
    return tuple(points), float(np.sqrt(max(slope, 0.0)))
