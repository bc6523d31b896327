"""Lost, repeated and late samples, told by their numbers."""

import numpy as np
import pytest

from firmware_protocol.sequence import LATE_WINDOW, SequenceCounters, SequenceTracker
from tests.wire_streams import follow_slowly

CASES = {
    "nothing": ([], {}),
    "one": ([5], {}),
    "in order": ([5, 6, 7], {}),
    "wrap": ([65534, 65535, 0, 1], {}),
    "gap": ([1, 2, 5, 6], {"sequence_gaps": 1, "samples_lost": 2}),
    "gap over the wrap": ([65534, 3], {"sequence_gaps": 1, "samples_lost": 4}),
    "duplicate": ([1, 2, 2, 3], {"duplicates": 1}),
    "older duplicate": ([1, 2, 3, 1, 4], {"duplicates": 1}),
    "swapped": ([1, 2, 4, 3, 5], {"sequence_gaps": 1, "reordered": 1}),
    "late twice": ([1, 2, 4, 3, 3, 5], {"sequence_gaps": 1, "reordered": 1, "duplicates": 1}),
    "late over the wrap": ([65534, 0, 65535, 1], {"sequence_gaps": 1, "reordered": 1}),
    "run repeated": ([1, 2, 3, 1, 2, 3, 4], {"duplicates": 3}),
    "largest gap": ([0, 32767], {"sequence_gaps": 1, "samples_lost": 32766}),
    "restart": ([0, 32768, 32769], {"sequence_restarts": 1}),
    "edge of late": ([LATE_WINDOW, 0], {"duplicates": 1}),
    "beyond late": ([LATE_WINDOW + 1, 0, 1], {"sequence_restarts": 1}),
    "late after a long gap": (
        [0, 1000, 1000 - LATE_WINDOW, 1000 - LATE_WINDOW],
        {"sequence_gaps": 1, "samples_lost": 998, "reordered": 1, "duplicates": 1},
    ),
}


def followed(feed):
    tracker = SequenceTracker()
    feed(tracker)
    return tracker.counters


@pytest.mark.parametrize("name", CASES)
def test_counters(name):
    sequences, expected = CASES[name]
    array = np.array(sequences, dtype=np.uint16)
    assert followed(lambda tracker: tracker.feed(sequences)) == SequenceCounters(**expected)
    assert followed(lambda tracker: tracker.feed_array(array)) == SequenceCounters(**expected)
    assert followed(lambda tracker: [tracker.feed_array(array[k : k + 1]) for k in range(len(array))]) == (
        SequenceCounters(**expected)
    )
    assert {k: v for k, v in follow_slowly(sequences).items() if v} == expected


def test_restart_compares_nothing():
    tracker = SequenceTracker()
    tracker.feed([1, 2])
    tracker.restart()
    tracker.feed_array(np.array([900, 901], dtype=np.uint16))
    assert tracker.counters == SequenceCounters()


def test_what_was_lost_is_forgotten_before_its_number_comes_again():
    tracker = SequenceTracker()
    tracker.feed([0, 2])  # 1 is lost
    for start in range(3, 3 + 65536, 8192):
        tracker.feed_array((start + np.arange(8192)).astype(np.uint16))
    assert tracker.counters.samples_lost == 1
    tracker.feed([1])  # a duplicate of the second round, not the one lost in the first
    assert tracker.counters == SequenceCounters(sequence_gaps=1, samples_lost=1, duplicates=1)
