"""How often random motion is taken for a trial: 400 seeded trials of each kind.

``python -m benchmarks.random_motion [TRIALS]``; the exit code is 1 where more than 2 % of the smooth random motions
give 5 end points or more. Band-limited noise is shown for comparison: over half an octave it is nearly periodic.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import signal

from analysis.cycles.search import find_cycles
from analysis.series import OrientationSeries
from tests.simulated_motion import from_angular_velocity, from_rotation_vectors, random_smooth

LIMIT = 0.02


def velocity_noise(seed: int, *, correlation_s: float) -> OrientationSeries:
    """An angular velocity that forgets itself exponentially, for 20 s: the pose wanders without bound."""
    rng = np.random.default_rng(seed)
    raw = signal.lfilter([1.0], [1.0, -(1.0 - 0.01 / correlation_s)], rng.standard_normal((2000, 3)), axis=0)
    return from_angular_velocity(np.radians(30.0) * raw / raw.std())


def band_noise(seed: int, *, width: float) -> OrientationSeries:
    """Noise around 0.25 Hz with a band of ``width`` times that, about all axes, for 60 s."""
    rng = np.random.default_rng(seed)
    band = signal.butter(2, [0.25 * (1.0 - width / 2.0), 0.25 * (1.0 + width / 2.0)], "band", fs=100.0, output="sos")
    raw = signal.sosfiltfilt(band, rng.standard_normal((10_000, 3)), axis=0)[2000:-2000]
    return from_rotation_vectors(np.radians(20.0) * raw / raw.std())


def kinds() -> dict[str, tuple[bool, Callable[[int], OrientationSeries]]]:
    """Name to (whether the limit holds for it, maker)."""
    made: dict[str, tuple[bool, Callable[[int], OrientationSeries]]] = {}
    for one_axis in (False, True):
        for bandwidth_s in (0.2, 0.5, 1.0, 2.0):
            for duration_s in (20.0, 60.0, 180.0):
                name = f"smooth, {'one axis' if one_axis else 'all axes'}, σ {bandwidth_s} s, {duration_s:.0f} s"
                make = partial(random_smooth, bandwidth_s=bandwidth_s, duration_s=duration_s, one_axis=one_axis)
                made[name] = (True, make)
    made["wandering, correlation 1 s"] = (True, partial(velocity_noise, correlation_s=1.0))
    made["band of one octave and a half"] = (False, partial(band_noise, width=1.0))
    made["band of half an octave"] = (False, partial(band_noise, width=0.5))
    return made


def share_accepted(make: Callable[[int], OrientationSeries], trials: int) -> tuple[float, float]:
    """Shares of the trials that are valid with 5 end points or more, and valid at all."""
    found = [find_cycles(make(seed)) for seed in range(trials)]
    return (
        sum(item.valid and len(item.endpoints) >= 5 for item in found) / trials,
        sum(item.valid for item in found) / trials,
    )


def main(trials: int = 400) -> int:
    total, worst = [], 0.0
    print(f"{'motion':44}{'≥ 5 end points':>16}{'valid':>9}")
    for name, (limited, make) in kinds().items():
        five, any_number = share_accepted(make, trials)
        print(f"{name:44}{five:>15.1%} {any_number:>8.1%}{'' if limited else '   (no limit)'}", flush=True)
        if limited:
            total.append(five)
            worst = max(worst, five)
    mean = float(np.mean(total))
    print(f"\nsmooth random motion: {mean:.2%} over all kinds, worst kind {worst:.1%}; limit {LIMIT:.0%} over all")
    return 0 if mean <= LIMIT else 1


if __name__ == "__main__":
    sys.exit(main(*(int(text) for text in sys.argv[1:2])))
