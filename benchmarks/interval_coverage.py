"""Coverage of the confidence interval of θ̄, by seeded simulation.

    python benchmarks/interval_coverage.py [--trials 2000] [--seed 1]

Steps are a true drift θ about a random axis plus isotropic noise of 0.6 degrees (root mean square angle), independent
or AR(0.3), chained into orientations from a random start and scored by the same code as a real trial.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from analysis.geometry import rotations
from analysis.scoring.card import rotation_drift
from analysis.scoring.interval import drift_interval

STEPS = (5, 8, 20, 50)
THETAS_DEG = (0.0, 0.3, 1.0, 3.0)
NOISE_DEG = 0.6


@dataclass(frozen=True)
class Coverage:
    """What one cell of the table found."""

    n_steps: int
    theta_deg: float
    correlation: float
    trials: int
    covered: float
    """Share of intervals that hold the true θ."""
    mean_theta_bar_deg: float
    mean_width_deg: float

    @property
    def error(self) -> float:
        """Monte-Carlo standard error of ``covered``."""
        return float(np.sqrt(max(self.covered * (1 - self.covered), 1e-4) / self.trials))


def noisy_steps(
    rng: np.random.Generator, trials: int, n_steps: int, theta_deg: float, correlation: float
) -> np.ndarray:
    """Draw (trials, n_steps, 3) rotation vectors in rad."""
    axis = rng.normal(size=(trials, 1, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    white = rng.normal(scale=NOISE_DEG / np.sqrt(3.0), size=(trials, n_steps, 3))
    noise = np.empty_like(white)
    noise[:, 0] = white[:, 0]
    for k in range(1, n_steps):
        noise[:, k] = correlation * noise[:, k - 1] + np.sqrt(1.0 - correlation**2) * white[:, k]
    return np.radians(theta_deg * axis + noise)


def coverage(n_steps: int, theta_deg: float, correlation: float, trials: int, seed: int) -> Coverage:
    """Simulate one cell."""
    rng = np.random.default_rng([seed, n_steps, round(theta_deg * 1000), round(correlation * 1000)])
    steps = rotations.exp(noisy_steps(rng, trials, n_steps, theta_deg, correlation))
    quats = [rotations.exp(rng.normal(size=(trials, 3)))]
    for k in range(n_steps):
        quats.append(rotations.multiply(steps[:, k], quats[-1]))
    hits, thetas, widths = 0, [], []
    for trial in np.stack(quats, axis=1):
        drift = rotation_drift(trial)
        interval = drift_interval(drift.step_rotations_wxyz)
        assert interval is not None
        hits += interval.low_deg <= theta_deg <= interval.high_deg
        thetas.append(drift.theta_bar_deg)
        widths.append(interval.high_deg - interval.low_deg)
    return Coverage(
        n_steps, theta_deg, correlation, trials, hits / trials, float(np.mean(thetas)), float(np.mean(widths))
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    print(f"{args.trials} trials a cell, seed {args.seed}, step noise {NOISE_DEG} deg; coverage of the 95 % interval")
    print("| steps | correlation | θ (deg) | coverage | ± (Monte Carlo) | mean θ̄ (deg) | mean width (deg) |")
    print("|---|---|---|---|---|---|---|")
    for correlation in (0.0, 0.3):
        for n_steps in STEPS:
            for theta_deg in THETAS_DEG:
                cell = coverage(n_steps, theta_deg, correlation, args.trials, args.seed)
                print(
                    f"| {n_steps} | {correlation:g} | {theta_deg:g} | {cell.covered:.3f} | {cell.error:.3f} "
                    f"| {cell.mean_theta_bar_deg:.3f} | {cell.mean_width_deg:.3f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
