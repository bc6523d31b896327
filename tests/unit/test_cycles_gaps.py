"""A gap anywhere in the first cycles: the live path goes on, whatever a new run starts with.

``python -m benchmarks.gaps`` sweeps every scenario; here is a slice of it.
"""

import pytest

from analysis.cycles.online.detector import OnlineCycleDetector
from benchmarks.gaps import GAPS_S, Gap, shortened, what_fails
from tests.recorded_trials import virtual_chunks


@pytest.fixture(scope="module")
def chunks():
    return virtual_chunks(shortened("default", 2), chunk_s=0.1)[0]


@pytest.mark.parametrize("gap_s", GAPS_S)
def test_no_gap_ends_the_live_path(chunks, gap_s):
    for tenths in range(20, 140, 5):
        left = list(Gap(tenths / 10.0, gap_s, reopened=tenths % 2 == 1).cut(chunks))
        assert not what_fails(left), (tenths, gap_s)


def test_a_part_that_fails_is_named(chunks, monkeypatch):
    monkeypatch.setattr(OnlineCycleDetector, "feed", lambda *_: 1 / 0)
    (sentence,) = what_fails(list(chunks))
    assert sentence.startswith("the cycle detector failed (ZeroDivisionError")


def test_a_gap_loses_what_it_should(chunks):
    left = list(Gap(3.0, 0.6, reopened=True).cut(chunks))
    assert len(chunks) - len(left) == 6 - 1  # and one empty chunk where the link was opened again
    assert sum(not chunk.data for chunk in left) == 1
