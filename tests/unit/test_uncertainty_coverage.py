"""The interval holds the true drift as often as it says; a small version of benchmarks/interval_coverage.py."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

TRIALS = 150
FOUR_SIGMA = 4.0


@pytest.fixture(scope="module")
def benchmark():
    path = Path(__file__).parents[2] / "benchmarks" / "interval_coverage.py"
    spec = importlib.util.spec_from_file_location("interval_coverage", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks itself up there
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def bounds(low, high):
    """Widen by four standard errors of the simulation itself."""
    return (
        low - FOUR_SIGMA * np.sqrt(low * (1 - low) / TRIALS),
        min(high + FOUR_SIGMA * np.sqrt(high * (1 - high) / TRIALS), 1.0),
    )


@pytest.mark.parametrize("n_steps", [5, 8, 20, 50])
@pytest.mark.parametrize("theta_deg", [0.0, 0.3, 1.0, 3.0])
def test_coverage_of_independent_steps(benchmark, n_steps, theta_deg):
    low, high = bounds(0.92, 0.99)
    assert low <= benchmark.coverage(n_steps, theta_deg, 0.0, TRIALS, seed=7).covered <= high


@pytest.mark.parametrize("n_steps", [5, 8, 20, 50])
@pytest.mark.parametrize("theta_deg", [0.3, 1.0, 3.0])
def test_coverage_of_correlated_steps(benchmark, n_steps, theta_deg):
    low, _ = bounds(0.90, 0.99)
    assert benchmark.coverage(n_steps, theta_deg, 0.3, TRIALS, seed=7).covered >= low


@pytest.mark.parametrize(("n_steps", "expected_deg"), [(5, 0.24), (8, 0.19), (20, 0.12), (50, 0.08)])
def test_zero_drift_never_scores_zero(benchmark, n_steps, expected_deg):
    cell = benchmark.coverage(n_steps, 0.0, 0.0, TRIALS, seed=8)
    assert cell.mean_theta_bar_deg == pytest.approx(expected_deg, abs=0.02)
