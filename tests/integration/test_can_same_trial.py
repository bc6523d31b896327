"""One emulated trial, sent over every link: the same samples, the same end points, the same score."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.geometry.rotations import distance
from analysis.scoring.trial import score_series
from firmware_protocol.quantization import SMALLEST_THREE_MAX_ERROR_DEG
from host.recording.load import assemble
from tests.can_link_run import LINKS, over
from tests.emulated_packets import trial_packets

SECONDS = 50.5
"""Over 10,000 samples at 200 Hz."""


@pytest.fixture(scope="module")
def packets() -> list[bytes]:
    """What the object says in a trial that is started at once."""
    return trial_packets("fast", SECONDS)


def test_every_link_gives_the_same_end_points_and_score(packets: list[bytes], request: pytest.FixtureRequest) -> None:
    trials = {
        name: assemble(over(address.format(name=request.node.name), packets), name) for name, address in LINKS.items()
    }
    reference = trials["pty"]
    expected = score_series(reference.series).to_json()
    assert expected["valid"], expected["reasons"]
    assert expected["n_endpoints"] >= 30
    assert len(reference.series) >= 10_000
    for name, trial in trials.items():
        series = trial.series
        assert trial.losses.lost == trial.losses.rejected == 0, name
        assert len(series) == len(reference.series), name
        assert np.array_equal(series.index, reference.series.index), name
        assert np.array_equal(series.times_s, reference.series.times_s), name
        classic = name in ("slcan-pty", "slcan-socket", "socketcand", "virtual")
        bound_deg = SMALLEST_THREE_MAX_ERROR_DEG if classic else 1e-9
        angles = np.degrees(distance(series.quats_wxyz, reference.series.quats_wxyz))
        assert angles.max() <= bound_deg, name
        assert (angles.max() > 1e-5) == classic, name
        score = score_series(series).to_json()
        ends = [point["sequence"] for point in score["endpoints"]]
        assert ends == [point["sequence"] for point in expected["endpoints"]], name
        # Each end point is off by at most the bound, and the score by its difference over all steps.
        assert score["theta_bar_deg"] == pytest.approx(expected["theta_bar_deg"], abs=2 * bound_deg), name
