"""Regimes that the search for cycles finds hard, as the emulator's hand moves them: scored against its truth."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.cycles.search import CycleAnalysis, find_cycles
from analysis.geometry import rotations
from analysis.series import OrientationSeries
from emulator.motion.hand_motion import HandMotion
from emulator.scenario import load_scenario


def hand_of(name: str) -> HandMotion:
    scenario = load_scenario(name)
    return HandMotion(scenario.motion, scenario.drift, seed=scenario.seed)


def found_in(hand: HandMotion) -> CycleAnalysis:
    times_s = np.arange(0.0, hand.duration_s, 0.01)
    return find_cycles(OrientationSeries(times_s, hand.orientation(times_s), np.arange(len(times_s))))


@pytest.mark.parametrize("name", ["equal-peaks", "pauses", "decay", "tempo", "uneven-tempo", "two-hump"])
def test_every_end_point_of_the_regime_is_found(name):
    hand = hand_of(name)
    found = found_in(hand)
    assert found.valid, found.reasons
    extremes = {extremes.kind: extremes for extremes in (hand.primary(), hand.other())}
    best = min(
        extremes.values(),
        key=lambda e: abs(len(e.times_s) - len(found.endpoints)) + abs(e.times_s[0] - found.endpoints[0].time_s),
    )
    # The gates may take one end point off at either end of a trial whose first or last cycle is irregular.
    truth_s = best.times_s[best.times_s < hand.duration_s - hand.motion.lead_out_s - 0.01]
    ends_s = np.array([point.time_s for point in found.endpoints])
    assert len(truth_s) - 2 <= len(ends_s) <= len(truth_s)
    nearest = np.abs(truth_s[:, None] - ends_s).argmin(axis=0)
    assert np.diff(nearest).tolist() == [1] * (len(ends_s) - 1)
    assert np.abs(truth_s[nearest] - ends_s).max() < 0.06 * found.period_s
    steps = rotations.distance(best.quats_wxyz[nearest][1:], best.quats_wxyz[nearest][:-1])
    assert found.theta_bar_deg == pytest.approx(np.degrees(steps.mean()), abs=0.05)


def test_a_pause_is_flagged_and_no_part_of_the_period():
    found = found_in(hand_of("pauses"))
    assert sum("after a pause" in point.flags for point in found.endpoints) == 4
    assert found.period_s == pytest.approx(4.0, abs=0.02)


def test_a_decaying_swing_is_named_and_the_extreme_that_stays_is_scored():
    found = found_in(hand_of("decay"))
    assert any("the swing shrinks by" in warning for warning in found.warnings)
    assert found.theta_bar_deg < 0.05


def test_the_hand_rests_in_a_pause_and_its_moment_is_the_middle():
    hand = hand_of("pauses")
    other = hand.other().times_s
    gaps = np.diff(hand.primary().times_s)
    assert np.flatnonzero(gaps > 10.0).tolist() == [2, 5, 8, 11]
    assert gaps[gaps > 10.0] == pytest.approx(11.0)
    middle_s = other[np.abs(other - (hand.primary().times_s[2] + 5.5)).argmin()]
    assert middle_s == pytest.approx(hand.primary().times_s[2] + 5.5)
    during = middle_s + np.linspace(-3.49, 3.49, 50)
    assert np.abs(hand.angular_velocity(during)).max() < 1e-9
    assert np.ptp(hand.orientation(during), axis=0) == pytest.approx(np.zeros(4), abs=1e-12)
    assert np.abs(hand.angular_velocity(np.array([middle_s + 3.6]))).max() > 0.01
