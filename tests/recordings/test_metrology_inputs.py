"""Small recordings with a known truth, most of them of real hands: each is judged by what its README has as right."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import analysis
from analysis.cycles.online.detector import OnlineCycleDetector
from analysis.cycles.search import find_cycles
from analysis.scoring.result import Result
from analysis.series import OrientationSeries

FOLDER = Path(os.environ.get("ROTDRIFT_INPUTS", Path(__file__).parents[3] / "shared" / "inputs")) / "metrology"

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(not FOLDER.is_dir(), reason="the inputs are not here; ROTDRIFT_INPUTS names their folder"),
]


def read(name: str) -> OrientationSeries:
    return analysis.load(FOLDER / f"{name}.csv")


def scored(name: str) -> Result:
    result = analysis.score(read(name))
    assert result.valid, result.reasons
    return result


@pytest.mark.parametrize(("name", "theta_deg"), [("two-humps-half-period", 3.0), ("two-humps-equal-half-period", 1.0)])
def test_of_two_peaks_a_cycle_the_drift_is_that_of_the_whole_cycle(name, theta_deg):
    result = scored(name)
    assert result.theta_bar_deg == pytest.approx(theta_deg, rel=0.1)
    assert result.interval_deg is not None
    assert result.interval_deg[0] <= theta_deg <= result.interval_deg[1]


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("real-press-five-reps-scored-as-nine", 5, 5),
        ("tempo20-eight-cycles-scored-as-four", 8, 8),
        ("tempo20-five-cycles-refused", 5, 5),
        ("real-row-nineteen-reps-refused", 19, 20),
        ("regrasp-pauses-refused", 8, 8),
    ],
)
def test_every_repetition_is_one_end_point(name, least, most):
    assert least <= scored(name).n_endpoints <= most


@pytest.mark.parametrize("name", ["three-humps-refused", "two-humps-speeding-up-refused"])
def test_what_is_periodic_is_not_refused(name):
    assert scored(name).n_endpoints >= 5


def test_where_both_periods_are_possible_both_are_reported():
    (both,) = [text for text in scored("two-humps-equal-half-period").warnings if "two periods are possible" in text]
    assert both.count("θ̄") == 2


def test_steps_across_a_regrasp_are_flagged():
    result = scored("regrasp-pauses-refused")
    assert sum("after a pause" in flags for flags in result.flags) >= 2


def test_a_swing_that_shrinks_is_named_and_is_no_drift():
    result = scored("swing-decays-no-warning")
    assert any("the swing shrinks by" in text for text in result.warnings)
    assert result.interval_deg is not None
    assert result.interval_deg[0] == 0.0
    assert result.theta_bar_deg is not None
    assert result.theta_bar_deg < 0.2


def test_turning_that_repeats_nothing_claims_nothing():
    result = analysis.score(read("real-arbitrary-turning-accepted"))
    assert not result.valid
    assert result.theta_bar_deg is None


def test_a_tremor_makes_no_end_points_live():
    series = read("tremor-8hz-online-extras")
    offline = find_cycles(series)
    detector = OnlineCycleDetector()
    live = []
    for time_s, quat in zip(series.times_s.tolist(), series.quats_wxyz, strict=True):
        withdrawn = detector.state.withdrawn
        new = detector.feed([time_s], quat[None])
        live = list(new) if detector.state.withdrawn > withdrawn else [*live, *new]
    assert offline.valid, offline.reasons
    ends = np.array([point.time_s for point in offline.endpoints])
    inside = [p.time_s for p in live if ends[0] - 0.5 <= p.time_s <= ends[-1] + 0.5]
    assert inside == pytest.approx(ends.tolist(), abs=0.1 * offline.period_s)


def test_a_filter_and_optics_see_the_same_cycles_and_drifts_that_differ_by_the_sensor_s_error():
    """The sensor errs by 0.096° a cycle; by about as much do the two scores differ, of the same 21 cycles."""
    imu, optics = scored("real-imu-vqf"), scored("real-optics-truth")
    assert imu.n_endpoints == optics.n_endpoints == 21
    spacing = [np.diff(result.endpoint_times_s) for result in (imu, optics)]
    assert spacing[0] == pytest.approx(spacing[1], abs=0.2)
    assert imu.theta_bar_deg == pytest.approx(optics.theta_bar_deg, abs=0.15)
