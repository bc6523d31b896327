"""ClockUnwrapper: wraps, gaps of hours, resets and steps, against the unwrapped truth."""

import numpy as np
import pytest

from tests.clock_chunks import UnwrappedChunks as ClockUnwrapper

MODULUS = 2**32
S = 1_000_000  # us
START_NS = 987_654_321_000_000


def host_ns(seconds: float) -> int:
    return START_NS + round(1e9 * seconds)


def feed_at(unwrapper: ClockUnwrapper, truth_us: list[int], seconds: float) -> list[int]:
    return unwrapper.feed(np.array(truth_us, dtype=np.int64) % MODULUS, host_ns(seconds)).tolist()


def test_samples_pass_unchanged_before_the_wrap():
    unwrapper = ClockUnwrapper()
    assert feed_at(unwrapper, [10, 20, 30], 0.0) == [10, 20, 30]
    assert unwrapper.newest_us == 30
    assert unwrapper.take_steps() == []


def test_wrap_inside_a_chunk():
    unwrapper = ClockUnwrapper()
    truth = [MODULUS - 20_000, MODULUS - 10_000, MODULUS, MODULUS + 10_000]
    assert feed_at(unwrapper, truth, 0.0) == truth


def test_reordering_across_the_wrap_moves_nothing_and_adds_no_wrap():
    unwrapper = ClockUnwrapper()
    truth = [MODULUS - 5, MODULUS + 5, MODULUS - 3, MODULUS + 7]
    assert feed_at(unwrapper, truth, 0.0) == truth
    assert feed_at(unwrapper, [MODULUS - 1, MODULUS + 9], 0.001) == [MODULUS - 1, MODULUS + 9]
    assert unwrapper.segment == 0


@pytest.mark.parametrize("skew_ppm", [-200.0, 0.0, 200.0])
@pytest.mark.parametrize("gap_s", [0.01, 60.0, 2147.0, 2148.0, 4294.0, 4296.0, 3 * 3600.0, 9 * 3600.0])
def test_gaps_with_skew(gap_s: float, skew_ppm: float):
    unwrapper = ClockUnwrapper()
    for i in range(7):
        device = round(4_000 * S + 1e6 * i * gap_s * (1 + 1e-6 * skew_ppm))
        truth = [device, device + 10_000, device + 20_000]
        first_is_raw = 4_000 * S
        assert feed_at(unwrapper, truth, i * gap_s) == [t - 4_000 * S + first_is_raw for t in truth]
    assert unwrapper.take_steps() == []


def test_backlog_delivered_late_is_no_step():
    unwrapper = ClockUnwrapper()
    feed_at(unwrapper, [0], 0.0)
    for i in range(1, 100):
        feed_at(unwrapper, [100_000 * i], 0.1 * i)
    late = [S * 10 + 100_000 * i for i in range(400)]  # 40 s that come at once
    assert feed_at(unwrapper, late, 50.0) == late
    assert unwrapper.take_steps() == []


def test_backlog_at_the_start_that_drains_is_no_step():
    unwrapper = ClockUnwrapper()
    for i in range(100):  # read 20 s late at first, caught up within 2 s
        feed_at(unwrapper, [i * 220_000], 20 + 0.02 * i)
    assert unwrapper.take_steps() == []


def test_reset_starts_a_segment_and_says_by_how_much():
    unwrapper = ClockUnwrapper()
    feed_at(unwrapper, [500 * S], 0.0)
    assert feed_at(unwrapper, [501 * S, 3_000, 13_000], 1.0) == [501 * S, 3_000, 13_000]
    (step,) = unwrapper.take_steps()
    assert (step.index, step.segment, step.gap_ns) == (1, 1, 10**9)
    assert step.host_time_ns == host_ns(1.0)
    assert step.disagreement_us == 3_000 - 501 * S
    assert unwrapper.segment == 1
    assert feed_at(unwrapper, [1_003_000], 2.0) == [1_003_000]
    assert unwrapper.take_steps() == []


def test_forward_step_is_told():
    unwrapper = ClockUnwrapper()
    for i in range(100):
        feed_at(unwrapper, [i * 100_000], 0.1 * i)
    feed_at(unwrapper, [10 * S + 1_500_000], 10.0)
    (step,) = unwrapper.take_steps()
    assert step.index == 0
    assert step.disagreement_us == pytest.approx(1_500_000, abs=2)


def test_forward_step_within_the_bound_is_not():
    unwrapper = ClockUnwrapper()
    for i in range(100):
        feed_at(unwrapper, [i * 100_000], 0.1 * i)
    feed_at(unwrapper, [10 * S + 900_000], 10.0)
    assert unwrapper.take_steps() == []


@pytest.mark.parametrize(("ahead_s", "steps"), [(60 + 1.79, 0), (60 + 1.81, 1), (-1.81 - 60, 1), (-1.79 - 60, 0)])
def test_the_bound_grows_with_the_gap(ahead_s: float, steps: int):
    unwrapper = ClockUnwrapper()
    feed_at(unwrapper, [0], 0.0)
    feed_at(unwrapper, [round(S * (3600 + ahead_s))], 3600.0)  # 500 ppm of an hour are 1.8 s
    assert len(unwrapper.take_steps()) == steps


def test_reset_early_in_life_is_seen_although_lateness_could_explain_its_size():
    unwrapper = ClockUnwrapper()
    feed_at(unwrapper, [20 * S], 0.0)
    feed_at(unwrapper, [1_000], 1.0)
    assert [step.index for step in unwrapper.take_steps()] == [0]


def test_two_resets_in_one_chunk():
    unwrapper = ClockUnwrapper()
    ticks = [90 * S, 5, 10 * S, 7, 8]
    assert feed_at(unwrapper, ticks, 0.0) == ticks
    assert [(step.index, step.segment) for step in unwrapper.take_steps()] == [(1, 1), (3, 2)]


def test_new_segment_by_hand():
    unwrapper = ClockUnwrapper()
    assert unwrapper.new_segment() == 0  # nothing yet: still the first
    feed_at(unwrapper, [MODULUS + 500 * S], 0.0)
    assert unwrapper.new_segment() == 1
    assert unwrapper.newest_us is None
    assert feed_at(unwrapper, [10], 0.1) == [10]
    assert unwrapper.take_steps() == []


def test_slow_device_for_days_is_not_taken_for_lateness():
    unwrapper = ClockUnwrapper()
    for hour in range(24 * 10):
        device = round(3600e6 * hour * (1 - 200e-6))
        assert feed_at(unwrapper, [device], 3600.0 * hour) == [device]
    assert unwrapper.take_steps() == []


def test_a_slow_device_does_not_loosen_the_bound():
    unwrapper = ClockUnwrapper()
    for i in range(1440):  # two hours, a chunk every 5 s
        feed_at(unwrapper, [round(5e6 * i * (1 - 200e-6))], 5.0 * i)
    feed_at(unwrapper, [round(7200e6 * (1 - 200e-6)) + 1_100_000], 7200.0)
    assert len(unwrapper.take_steps()) == 1


def test_locate_changes_nothing():
    unwrapper = ClockUnwrapper()
    assert unwrapper.locate(5, START_NS) is None
    feed_at(unwrapper, [MODULUS - S], 0.0)
    feed_at(unwrapper, [MODULUS + 9 * S], 10.0)
    assert unwrapper.locate(9 * S + 500, host_ns(10.1)) == MODULUS + 9 * S + 500
    assert unwrapper.locate(7 * MODULUS + 9 * S, host_ns(10.1)) == MODULUS + 9 * S  # a u64 uptime
    assert unwrapper.locate(900 * S, host_ns(10.1)) is None
    assert unwrapper.newest_us == MODULUS + 9 * S


def test_empty_chunk_and_wrong_shape():
    unwrapper = ClockUnwrapper()
    assert unwrapper.feed(np.empty(0, np.uint32), START_NS).shape == (0,)
    assert unwrapper.newest_us is None
    with pytest.raises(ValueError, match="one-dimensional"):
        unwrapper.feed(np.zeros((2, 2), np.uint32), START_NS)
