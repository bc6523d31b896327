"""No result changes by itself: every key and value of the authors' recordings and of emulated trials."""

import pytest

from tests import golden_results

RELATIVE = 1e-9
"""Another processor rounds sums and sines differently; on one machine the results are equal to the last bit."""


def assert_unchanged(name, results):
    expected = golden_results.stored(name)
    assert expected, f"nothing is stored for {name}"
    assert not list(golden_results.differences(expected, results, RELATIVE))


@pytest.mark.parametrize("name", golden_results.EMULATED)
def test_an_emulated_trial_scores_as_ever(name):
    assert_unchanged(name, golden_results.results_of_emulated(name))


@pytest.mark.recordings
@pytest.mark.skipif(not golden_results.recordings(), reason=f"no recordings at {golden_results.RECORDINGS}")
@pytest.mark.parametrize("path", golden_results.recordings(), ids=lambda path: path.stem)
def test_a_recording_of_the_authors_scores_as_ever(path):
    assert_unchanged(path.stem, golden_results.results_of_recording(path))


def test_a_changed_or_missing_value_is_found():
    before = {"a": [1.0, {"b": "x"}], "c": 2}
    assert list(golden_results.differences(before, {"a": [1.0, {"b": "x"}], "c": 2, "new": 1})) == []
    assert list(golden_results.differences(before, {"a": [1.0 + 1e-6, {"b": "x"}], "c": 2}, RELATIVE))
    assert list(golden_results.differences(before, {"a": [1.0, {}], "c": 2}))
    assert list(golden_results.differences(before, {"a": [1.0, {"b": "x"}, 3], "c": 2}))
