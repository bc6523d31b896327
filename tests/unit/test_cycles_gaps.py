"""A gap anywhere in the first cycles: the live path goes on, whatever a new run starts with."""

import numpy as np
import pytest

from host.trial.live import Trial
from tests.recorded_trials import scenario, virtual_chunks


@pytest.fixture(scope="module")
def chunks():
    return virtual_chunks(scenario("default", motion={"cycles": 4}), chunk_s=0.04)[0]


@pytest.mark.parametrize("gap_s", [0.2, 0.6, 2.0])
def test_no_gap_ends_the_live_path(chunks, gap_s):
    start_ns = chunks[0].host_time_ns
    for at_s in np.arange(2.0, 14.0, 0.3):
        trial = Trial()
        for chunk in chunks:
            elapsed_s = (chunk.host_time_ns - start_ns) / 1e9
            if not at_s <= elapsed_s < at_s + gap_s:
                trial.feed(chunk)
        assert trial.period_s is None or trial.period_s > 0.0, (at_s, gap_s)
