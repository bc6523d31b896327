"""The offline search on simulated trials whose end points are known."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.cycles import find_cycles
from tests.simulated_motion import cosine, sawtooth, simulate, theta_bar_deg, trapezoid, triangle


@pytest.mark.parametrize("period_s", [0.7, 4.0, 15.0])
@pytest.mark.parametrize("shape", [cosine, trapezoid, triangle, sawtooth])
def test_every_end_point_is_found_at_one_phase(shape, period_s):
    trial = simulate(shape, period_s=period_s)
    found = find_cycles(trial.series)
    assert found.valid, found.reasons
    assert found.period_s == pytest.approx(period_s, rel=1e-3)
    assert found.period_confidence > 0.85
    assert len(found.endpoints) == len(trial.endpoint_s)
    assert len(found.other_endpoints) == len(trial.endpoint_s) - 1
    offset = (np.array([point.time_s for point in found.endpoints]) - trial.endpoint_s) / period_s
    assert np.abs(offset - np.median(offset)).max() < 0.01
    assert abs(np.median(offset)) < 0.08
    theta = theta_bar_deg(np.array([point.quat_wxyz for point in found.endpoints]))
    assert theta == pytest.approx(trial.theta_bar_deg, abs=0.006)
