"""The period of a motion from the autocorrelation of its angular velocity, taken as a vector.

The velocity is smoothed as little as noise allows first, then in proportion to the period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.cycles.motion import Motion
from analysis.cycles.settings import CycleSettings
from analysis.cycles.usable_samples import Samples
from analysis.series import FloatArray

_ROUNDS = 3
_MAX_ONE_WAY = 0.5
"""Largest sum of the autocorrelation up to a period, share of that of its size: 0 there and back, 1 one way."""


@dataclass(frozen=True)
class Period:
    """A period and how sure it is."""

    seconds: float
    """Length of one cycle, s."""
    confidence: float
    """Normalised autocorrelation at that lag: 1 for cycles that repeat exactly, near 0 for none."""


def vector_autocorrelation(omega: FloatArray, max_lag: int) -> FloatArray:
    """A(k) = Σ ω_i · ω_{i+k} / √(Σ |ω_i|² Σ |ω_{i+k}|²), both sums over the overlap.

    Parameters
    ----------
    omega : array of float
        (m, 3).
    max_lag : int
        Largest lag wanted, below m.

    Returns
    -------
    (max_lag + 1,) in [−1, 1], A(0) = 1; zeros where nothing moves.
    """
    from scipy import fft  # slow to import

    m = len(omega)
    size = fft.next_fast_len(m + max_lag + 1, real=True)
    # Wiener-Khinchin: the transform of the power spectrum is the autocorrelation; padded, so that nothing wraps round.
    # The sum over the axes does not depend on how these lie.
    power = np.zeros(size // 2 + 1)
    for axis in range(3):
        spectrum = fft.rfft(omega[:, axis], size)
        power += spectrum.real**2 + spectrum.imag**2
    total = fft.irfft(power, size)[: max_lag + 1]
    energy = np.concatenate(([0.0], np.cumsum(np.einsum("ij,ij->i", omega, omega))))
    lags = np.arange(max_lag + 1)
    norm = np.sqrt(energy[m - lags] * (energy[m] - energy[lags]))
    tiny = 1e-12 * max(float(energy[m]), 1e-300)
    return np.where(norm > tiny, total / np.maximum(norm, tiny), 0.0)


def find_period(
    omega: FloatArray, rate_hz: float, *, min_period_s: float, max_period_s: float, peak_share: float
) -> Period | None:
    """Find the first peak of the autocorrelation that comes near the largest one.

    Parameters
    ----------
    omega : array of float
        (m, 3) angular velocity while the object moves, rad/s.
    rate_hz : float
        Its rate.
    min_period_s, max_period_s : float
        Range searched; the upper end is also bounded by half the length.
    peak_share : float
        How near: a peak counts from this share of the largest.

    Returns
    -------
    None where there is no peak above zero at which the motion has come back.
    """
    first = max(int(min_period_s * rate_hz), 1)
    last = min(int(max_period_s * rate_hz), len(omega) // 2)
    if last - first < 3:
        return None
    curve = vector_autocorrelation(omega, last)
    middle = curve[1:-1]
    peaks = 1 + np.flatnonzero((middle > curve[:-2]) & (middle >= curve[2:]) & (middle > 0.0))
    # Over a cycle that comes back ω sums to nearly nothing, and so does its autocorrelation. Over one of many strokes
    # in the same direction, a stick-slip or a finger's push, it is above zero throughout.
    net, gross = np.cumsum(curve), np.cumsum(np.abs(curve))
    peaks = peaks[(peaks >= first) & (net[peaks] < _MAX_ONE_WAY * gross[peaks])]
    if len(peaks) == 0:
        return None
    # Two cycles repeat as well as one does: the first peak near the largest, not the largest, is one cycle. A parabola
    # through it and its neighbours places it between the lags.
    peak = int(peaks[np.argmax(curve[peaks] >= peak_share * curve[peaks].max())])
    before, here, after = curve[peak - 1 : peak + 2]
    bend = before - 2.0 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return Period((peak + float(shift)) / rate_hz, float(here))


def search_period(motion: Motion, samples: Samples, settings: CycleSettings) -> tuple[Period | None, float]:
    """Find the period of a motion, smoothing ω further only where noise hides it.

    White noise of σ_q per sample, at f samples per second, leaves σ_q² / (4 √π f σ³) of variance about each axis in ω
    after a Gaussian of σ. Where that is much of ω, ripples of the noise would pass for cycles.

    Parameters
    ----------
    motion : Motion
        The part in which the object moves.
    samples : Samples
        What it was made of: its noise.
    settings : CycleSettings
        Ranges, smoothing, limits.

    Returns
    -------
    period, smooth_s
        None where there is none; σ of the further smoothing, s.
    """
    best: tuple[Period | None, float] = (None, 0.0)
    sigmas_s = (0.0, *settings.more_sigma_s)
    for sigma_s in sigmas_s:
        smooth = motion.smoothed(sigma_s)
        total_s = float(np.hypot(sigma_s, settings.sigma_s))
        noise = 3.0 * samples.noise_rad**2 * samples.usual_step_s / (4.0 * np.sqrt(np.pi) * total_s**3)
        power = float(np.mean(np.einsum("ij,ij->i", smooth.omega, smooth.omega)))
        if noise > settings.max_noise_share * power and sigma_s < sigmas_s[-1]:
            continue
        period = _period_at(smooth, settings.min_sigmas * sigma_s, settings)
        if period is not None and (best[0] is None or period.confidence > best[0].confidence):
            best = (period, sigma_s)
        if period is not None and period.confidence >= settings.sure_confidence:
            break
    return _refined(motion, *best, settings), best[1]


def _period_at(smooth: Motion, min_period_s: float, settings: CycleSettings) -> Period | None:
    """Find the period in ω as smoothed, single fast strokes limited."""
    return find_period(
        smooth.limited(settings.speed_limit).omega,
        smooth.rate_hz,
        min_period_s=max(settings.min_period_s, min_period_s),
        max_period_s=settings.max_period_s,
        peak_share=settings.peak_share,
    )


def _refined(motion: Motion, period: Period | None, smooth_s: float, settings: CycleSettings) -> Period | None:
    """Look again with ω smoothed in proportion to the period found.

    Short strokes whose tempo changes by a few hundredths overlap little from cycle to cycle, and a few of them may
    overlap better three cycles on.
    """
    for _ in range(_ROUNDS):
        sigma_s = 0.0 if period is None else settings.period_sigma * period.seconds
        if period is None or sigma_s <= max(smooth_s, settings.sigma_s):
            break
        found = _period_at(motion.smoothed(sigma_s), 0.0, settings)
        if found is None or found.confidence < period.confidence:
            break
        settled = found.seconds > settings.spacing[0] * period.seconds
        period = found
        if settled:
            break
    return period


def confidence_at(motion: Motion, seconds: float, settings: CycleSettings) -> float:
    """Return the largest autocorrelation within a tenth of a period known from elsewhere, 0 or more."""
    smooth = motion.smoothed(settings.period_sigma * seconds).limited(settings.speed_limit)
    lag = seconds * motion.rate_hz
    last = min(int(1.1 * lag) + 1, len(smooth.omega) - 1)
    curve = vector_autocorrelation(smooth.omega, last)[int(0.9 * lag) :]
    return max(float(curve.max(initial=0.0)), 0.0)
