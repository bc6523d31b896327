"""Few large steps that make θ̄: named, with how much of it they make; and left out after the fact."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.scoring.card import rotation_drift
from analysis.scoring.interval import NO_DRIFT
from analysis.scoring.result_parts import ExcludedCycle
from analysis.scoring.slip import find_slip
from analysis.scoring.summary import doubt_text, result_html, slip_of, trust_rows
from analysis.scoring.trial import score_series
from analysis.series import SeriesError
from tests.simulated_motion import from_rotation_vectors, simulate


def drift_of(steps_deg, left_out=()):
    """Steps about one axis."""
    angles = np.concatenate(([0.0], np.cumsum(steps_deg)))
    quats = Rotation.from_rotvec(np.radians(angles)[:, None] * [0.0, 0.6, 0.8]).as_quat(scalar_first=True)
    return rotation_drift(quats, left_out)


def test_one_large_step_is_named_with_its_share_and_the_rest():
    slip = find_slip(drift_of([0.4, 0.5, 0.4, 8.0, 0.45, 0.4, 0.5, 0.35]))
    assert slip is not None
    assert slip.steps == (3,)
    assert slip.largest_deg == pytest.approx(8.0)
    assert slip.share == pytest.approx(8.0 / 11.0)
    assert slip.theta_bar_deg == pytest.approx(11.0 / 8.0, rel=2e-3)
    assert slip.rest_deg == pytest.approx(3.0 / 7.0)
    assert "the step of cycle 4 is 8.00°" in slip.sentence
    assert "makes 73% of θ̄ (1.37°, 0.43° without it): no steady creep" in slip.sentence


def test_two_large_steps_are_named_together():
    slip = find_slip(drift_of([0.4, 6.0, 0.4, 0.5, 5.0, 0.4, 0.5, 0.4]))
    assert slip is not None
    assert slip.steps == (1, 4)
    assert "the steps of cycles 2, 5 are up to 6.00°" in slip.sentence
    assert "make 81% of θ̄" in slip.sentence


def test_a_slip_against_the_drift_is_reported_as_such():
    slip = find_slip(drift_of([1.0, 1.0, 1.1, -4.0, 1.0, 0.9, 1.0, 1.0]))
    assert slip is not None
    assert slip.share < 0.0
    assert "works against the other steps: θ̄ is 0.38°, 1.00° without it" in slip.sentence


@pytest.mark.parametrize(
    "steps_deg",
    [
        [0.4, 0.4, 0.4, 0.4, 0.4],
        [0.4, 0.6, 0.5, 0.9, 0.45, 0.4],  # below 2.5 times the median
        [0.1, 2.0, 0.3, 3.0, 1.0, 2.5],  # all differ
        [0.001, 0.001, 0.001, 0.05, 0.001],  # next to nothing
        [0.4, 9.0, 0.4],  # too few to know what is usual
    ],
)
def test_no_slip(steps_deg):
    assert find_slip(drift_of(steps_deg)) is None


def test_a_slip_that_is_left_out_is_none_and_turns_no_number():
    assert find_slip(drift_of([0.4, 0.5, 8.0, 0.4, 0.45, 0.4], left_out=(2,))) is None
    slip = find_slip(drift_of([0.4, 5.0, 0.5, 0.4, 8.0, 0.4, 0.45, 0.4], left_out=(1,)))
    assert slip is not None
    assert slip.steps == (4,)


@pytest.fixture(scope="module")
def slipped():
    return simulate(cycles=12, drift_deg=0.4, slip_deg=8.0, slip_cycle=5)


def test_text_table_and_notebook_name_the_slip(slipped):
    result = score_series(slipped.series)
    (warning,) = [text for text in result.warnings if text.startswith("slip: ")]
    assert "cycle 6 is 8." in warning
    slip = slip_of(result)
    assert slip is not None
    assert slip.sentence == warning
    rows = {name: (value, meaning) for name, value, meaning in trust_rows(result)}
    assert rows["slip"][0].startswith("cycle 6: 8.")
    assert f"{slip.share:.0%} of θ̄" in rows["slip"][1]
    assert "steady creep" not in rows["share along that axis"][1]
    assert "no steady creep" in result_html(result)
    steady = score_series(simulate().series)
    assert "a steady creep" in {name: meaning for name, _, meaning in trust_rows(steady)}["share along that axis"]
    assert not any("slip" in warning for warning in steady.warnings)


def test_a_cycle_left_out_by_its_number_is_the_one_that_the_live_key_leaves_out(slipped):
    plain = score_series(slipped.series)
    by_number = score_series(slipped.series, excluded=[ExcludedCycle.numbered(6, "the table was bumped")])
    live = ExcludedCycle(plain.endpoints[5].time_s, plain.endpoints[6].time_s, "the table was bumped")
    assert by_number == score_series(slipped.series, excluded=[live])
    (left_out,) = by_number.excluded_cycles
    assert (left_out.step, left_out.reason) == (5, "the table was bumped")
    assert by_number.theta_bar_deg == pytest.approx(0.4, abs=0.01)
    assert by_number.n_endpoints == plain.n_endpoints
    assert by_number.endpoints[6].flags == (*plain.endpoints[6].flags, "left out")


def test_a_cycle_that_there_is_not_cannot_be_left_out(slipped):
    with pytest.raises(SeriesError, match="no cycle 12 to leave out: the cycles of this trial are 1 to 11"):
        score_series(slipped.series, excluded=[ExcludedCycle.numbered(12, "none")])


def test_an_interval_that_touches_zero_is_put_into_words():
    rng = np.random.default_rng(0)
    t = np.arange(4400) / 100.0
    angle = np.radians(20.0) * (0.5 - 0.5 * np.cos(np.pi * t / 2.0))
    place = np.radians(0.5) * rng.normal(size=(12, 3))[(t / 4.0).astype(int)]
    result = score_series(from_rotation_vectors(angle[:, None] * [0.0, 0.6, 0.8] + place))
    assert result.interval_deg is not None
    assert result.interval_deg[0] == 0.0
    assert doubt_text(result) == NO_DRIFT == "cannot be distinguished from no drift"
    assert f"θ̄ {NO_DRIFT}: the interval touches 0" in result.warnings
    assert NO_DRIFT in result_html(result)
    steady = score_series(simulate().series)
    assert doubt_text(steady) == ""
    assert NO_DRIFT not in result_html(steady)
