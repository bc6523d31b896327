"""Looking for the period of a trial: smoothed as little as noise allows, then in proportion to the period."""

from __future__ import annotations

import numpy as np

from analysis.angular_velocity import Motion
from analysis.cycle_analysis import CycleSettings
from analysis.period import Period, find_period
from analysis.usable_samples import Samples

_ROUNDS = 3


def search_period(motion: Motion, samples: Samples, settings: CycleSettings) -> tuple[Period | None, float]:
    """Find the period of a motion, smoothing ω further only where noise hides it.

    White noise of σ_q per sample, at f samples per second, leaves σ_q² / (4 √π f σ³) of variance about each axis in ω
    after a Gaussian of σ. Where that is much of ω, ripples of the noise would be taken for cycles.

    Parameters
    ----------
    motion
        The part in which the object moves.
    samples
        What it was made of: its noise.
    settings
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
    return _again(motion, *best, settings)


def _period_at(smooth: Motion, min_period_s: float, settings: CycleSettings) -> Period | None:
    return find_period(
        smooth.limited(settings.speed_limit).omega,
        smooth.rate_hz,
        min_period_s=max(settings.min_period_s, min_period_s),
        max_period_s=settings.max_period_s,
        peak_share=settings.peak_share,
    )


def _again(
    motion: Motion, period: Period | None, smooth_s: float, settings: CycleSettings
) -> tuple[Period | None, float]:
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
    return period, smooth_s
