"""The account at its bounds: counts of the object, runs that are filled and shared out, and what is said of losses."""

import numpy as np
import pytest

from analysis.scoring.recorded_parts import CycleLosses
from firmware_protocol.packets import SEQUENCE_MODULUS, Status
from host.losses.ledger import LossLedger, LossReport
from host.losses.object_counts import (
    LATE_SAMPLES,
    MAX_COUNT,
    MAX_PRODUCED_HZ,
    SPARE_SAMPLES,
    FirstCounts,
    ObjectCounts,
    Verdict,
    room_for,
)
from host.losses.runs import MissingRun, MissingRuns, missing_between
from host.losses.verdict import CYCLE_LOSS_LIMIT, GAP_CYCLES_LIMIT, LOSS_LIMIT, judge_losses


def status(produced, uptime_us=10**6, dropped=0):
    return Status(uptime_us, samples_produced=produced, samples_dropped=dropped)


@pytest.mark.parametrize(
    ("elapsed_us", "room"),
    [(-5.0, 0), (0.0, 0), (1e6, MAX_PRODUCED_HZ), (0.5e6, MAX_PRODUCED_HZ // 2), (99.0, 0), (100.0, 1)],
)
def test_room_is_what_the_fastest_object_produces_and_a_little_more(elapsed_us, room):
    assert room_for(elapsed_us) == SPARE_SAMPLES + room


@pytest.mark.parametrize(
    ("produced", "dropped", "room", "verdict"),
    [
        (100, 0, 50, Verdict.BELIEVED),
        (150, 0, 50, Verdict.BELIEVED),
        (151, 0, 50, Verdict.REFUSED),
        (99, 0, 50, Verdict.REFUSED),  # fell, although the object's clock went on
        (110, 10, 50, Verdict.BELIEVED),
        (110, 11, 50, Verdict.REFUSED),
        (100, 1, 50, Verdict.REFUSED),
    ],
)
def test_counts_before_the_first_sample_must_follow_those_before(produced, dropped, room, verdict):
    counts = FirstCounts()
    first = status(100, 10**6)
    assert counts.judge(first, 0) is Verdict.BELIEVED
    assert counts.judge(status(produced, 2 * 10**6, dropped), room) is verdict
    assert counts.first is first
    assert counts.start == (produced if verdict is Verdict.BELIEVED else 100)


def test_what_was_dropped_is_counted_from_the_status_before():
    counts = FirstCounts()
    counts.judge(status(100, 10**6, 5), 0)
    assert counts.judge(status(102, 2 * 10**6, 7), 50) is Verdict.BELIEVED
    assert counts.judge(status(102, 3 * 10**6, 8), 50) is Verdict.REFUSED
    assert counts.judge(status(102, 5, 9), 0) is Verdict.REFUSED  # the clock fell and the count did not


@pytest.mark.parametrize(("uptime_us", "produced"), [(10**6, 99), (999_999, 101), (10**6, 500)])
def test_only_a_fall_of_clock_and_count_is_a_reset(uptime_us, produced):
    counts = FirstCounts()
    counts.judge(status(100, 10**6), 0)
    assert counts.judge(status(produced, uptime_us), 0) is Verdict.REFUSED
    again = status(7, 5)
    assert counts.judge(again, 0) is Verdict.BELIEVED
    assert (counts.first, counts.last) == (again, again)


def test_two_refused_counts_that_agree_are_believed():
    counts = FirstCounts()
    counts.judge(status(10**6, 10**6), 0)  # the wrong one
    one, two = status(100, 2 * 10**6), status(110, 3 * 10**6)
    assert counts.judge(one, 50) is Verdict.REFUSED
    assert counts.judge(two, 50) is Verdict.BELIEVED
    assert (counts.first, counts.last) == (one, two)
    # A belief in between forgets the one refused.
    counts = FirstCounts()
    counts.judge(status(100, 10**6), 0)
    assert counts.judge(status(5000, 2 * 10**6), 50) is Verdict.REFUSED
    assert counts.judge(status(110, 3 * 10**6), 50) is Verdict.BELIEVED
    assert counts.judge(status(5010, 4 * 10**6), 50) is Verdict.REFUSED
    # And two that are refused but do not agree are not.
    assert counts.judge(status(9000, 5 * 10**6), 50) is Verdict.REFUSED
    assert counts.start == 110


@pytest.mark.parametrize(("produced", "dropped"), [(MAX_COUNT, 0), (5, 6)])
def test_counts_that_no_object_has_are_refused(produced, dropped):
    assert FirstCounts().judge(status(produced, dropped=dropped), 0) is Verdict.REFUSED
    assert ObjectCounts().judge(status(produced, dropped=dropped), 5, 10) is Verdict.REFUSED
    assert FirstCounts().judge(status(MAX_COUNT - 1, dropped=MAX_COUNT - 1), 0) is Verdict.BELIEVED


def test_a_first_sample_goes_on_from_what_was_counted_up_to_half_a_wrap():
    counts = FirstCounts()
    assert counts.before(5) is None
    counts.judge(status(100, 10**6, 2), 0)
    counts.judge(status(120, 2 * 10**6, 9), 50)
    assert counts.before(120) == (100, 120, 7)
    assert counts.before(120 + SEQUENCE_MODULUS // 2 - 1) == (100, 120, 7)
    assert counts.before(120 + SEQUENCE_MODULUS // 2) is None
    assert counts.before(119) is None


@pytest.mark.parametrize(
    ("ahead", "believed"), [(50, True), (51, False), (-LATE_SAMPLES, True), (-LATE_SAMPLES - 1, False)]
)
def test_counts_among_samples_must_be_near_the_next_number(ahead, believed):
    counts = ObjectCounts()
    assert counts.judge(status(1000 + 70_000), 1000, 50) is Verdict.REFUSED  # another wrap, and too far from it
    counts = ObjectCounts()
    verdict = counts.judge(status(SEQUENCE_MODULUS * 3 + 1000 + ahead), 1000, 50)
    assert verdict is (Verdict.BELIEVED if believed else Verdict.REFUSED)
    if believed:
        assert (counts.base, counts.end) == (SEQUENCE_MODULUS * 3, 1000 + ahead)


def test_an_older_status_adds_nothing_and_dropped_ones_are_among_the_new():
    counts = ObjectCounts()
    assert counts.judge(status(1000, 10**6, 5), 1000, 50) is Verdict.BELIEVED
    counts.dropped = 5  # as the ledger enters it
    assert counts.judge(status(1000, 10**6, 5), 1010, 50) is Verdict.STALE
    assert counts.judge(status(990, 900_000, 4), 1010, 50) is Verdict.STALE
    assert counts.judge(status(1020, 2 * 10**6, 26), 1020, 50) is Verdict.REFUSED
    counts = ObjectCounts()
    counts.judge(status(1000, 10**6, 5), 1000, 50)
    counts.dropped = 5
    assert counts.judge(status(1020, 2 * 10**6, 25), 1020, 50) is Verdict.BELIEVED


def test_damaged_frames_find_room_in_the_run_that_ends_where_they_came():
    runs = MissingRuns(10)
    assert runs.explain(5, 3) == 0
    runs.add(MissingRun(5, 4, 1))
    assert runs.explain(8, 2) == 0
    assert runs.newest.damaged == 1
    assert runs.explain(9, 2) == 2
    assert runs.explain(9, 2) == 1  # no room for more
    assert (runs.newest.damaged, runs.explain(9, 1)) == (4, 0)


def test_a_late_sample_splits_its_run_and_the_parts_keep_what_they_have_room_for():
    runs = MissingRuns(10)
    runs.add(MissingRun(10, 5, 2))
    for number in (9, 15):
        assert not runs.fill(number)
    assert runs.fill(12)
    assert [(run.first, run.missing, run.damaged) for run in runs.all_runs()] == [(10, 2, 2), (13, 2, 0)]
    assert not runs.fill(12)
    for number in (10, 11, 14, 13):
        assert runs.fill(number)
    assert runs.all_runs() == []
    assert runs.newest is None


def test_runs_between_bounds_are_cut_dropped_first_then_rejected_then_lost():
    runs = [MissingRun(10, 6, 3, 2), MissingRun(30, 4), MissingRun(40, 3, 1, 1)]  # 10-15, 30-33, 40-42
    bounds = [0, 10, 11, 12, 13, 14, 16, 31, 34, 41, 50]
    found = [(part.missing, part.dropped, part.rejected) for part in missing_between(runs, bounds)]
    assert found == [
        (0, 0, 0), (1, 1, 0), (1, 1, 0), (1, 0, 1), (1, 0, 1), (2, 0, 1), (1, 0, 0), (3, 0, 0), (1, 1, 0), (2, 0, 1),
    ]  # fmt: skip
    assert [part.missing for part in missing_between([], [0, 5, 9])] == [0, 0]


def test_the_number_of_the_next_sample_is_known_until_one_came():
    ledger = LossLedger()
    assert ledger.expected_start() is None
    ledger.status(status(100))
    assert ledger.expected_start() == 100
    ledger.feed(np.array([100]))
    assert ledger.expected_start() is None


def test_a_start_that_is_forgotten_is_counted_as_refused():
    ledger = LossLedger()
    for n in (1, 2, 3):
        ledger.status(status(100))
        ledger.forget_start()
        assert ledger.refused == n
        assert ledger.expected_start() is None
    ledger.feed(np.array([7]))
    assert ledger.report().produced == 1


def test_the_account_after_a_reset_has_runs_of_its_own():
    ledger = LossLedger(max_runs=2)
    ledger.feed(np.array([0, 2]))
    ledger.new_segment(10)
    ledger.feed(np.array([0, 3, 5, 7]))
    assert [(run.first, run.missing) for run in ledger.missing_runs(100)] == [(11, 1), (104, 1), (106, 1)]
    assert (ledger.report().missing, ledger.report().segments) == (5, 2)


def test_damage_between_two_accounts_is_that_of_the_first():
    ledger = LossLedger()
    ledger.feed(np.array([0]))
    ledger.status(status(4, 2 * 10**6))
    before = ledger.report()
    ledger.new_segment()
    ledger.damaged(2)
    report = ledger.report()
    assert (before.lost, before.rejected) == (3, 0)
    assert (report.lost, report.rejected, report.segments) == (1, 2, 1)
    ledger.feed(np.array([0]))
    assert (ledger.report().rejected, ledger.report().segments) == (2, 2)
    assert [(run.first, run.missing) for run in ledger.missing_runs()] == [(1, 3)]


def cycles(*missing, produced=1000):
    return [
        CycleLosses(
            produced=produced, missing=gone, rejected=0, dropped_by_device=0, received=produced - gone, lost=gone
        )
        for gone in missing
    ]


def losses(missing, produced=1000):
    return LossReport(produced, produced - missing, missing - 3 if missing > 2 else missing, 2, 1)


def test_losses_up_to_the_limits_are_no_reason_and_beyond_them_one_each():
    at = round(1000 * LOSS_LIMIT)
    assert judge_losses(losses(at), ()).reasons == ()
    assert judge_losses(losses(at), ()).degraded is False
    (reason,) = judge_losses(losses(at + 1), ()).reasons
    share = f"{100 * (at + 1) / 1000:.1f}"
    assert reason == (
        f"{share} % of the samples are missing ({at - 2} lost on the link, 2 damaged, 1 dropped by the object): "
        "the score is degraded"
    )
    assert judge_losses(losses(900), ()).reasons[0].startswith("90.0 % of the samples are missing (897 lost")
    edge = round(1000 * CYCLE_LOSS_LIMIT)
    assert judge_losses(losses(0), cycles(edge, edge + 1, 0)).cycles_with_gaps == (2,)


@pytest.mark.parametrize("n", [8, 9])
def test_cycles_with_gaps_are_named_up_to_eight(n):
    worst = round(1000 * CYCLE_LOSS_LIMIT) + 1
    quality = judge_losses(losses(0), cycles(*[worst] * n))
    named = ", ".join(map(str, range(1, 9))) + (", ..." if n > 8 else "")
    assert quality.degraded
    assert quality.reasons == (
        f"{n} of {n} cycles miss more than {100 * CYCLE_LOSS_LIMIT:.0f} % of their samples (cycle {named}): "
        "the score is degraded",
    )
    few = int(GAP_CYCLES_LIMIT * 20)
    assert judge_losses(losses(0), cycles(*[worst] * few, *[0] * (20 - few))).reasons == ()


@pytest.mark.parametrize(
    ("numbers", "received", "lost", "duplicates"),
    [
        ([1, 2, 3], 4, 0, 0),
        ([1, 1, 3], 3, 1, 1),  # as many as the last number tells, but not one after the other
        ([0, 1, 3], 3, 1, 1),
        ([1, 3, 3], 3, 1, 1),
        ([1], 2, 0, 0),
        ([0], 1, 0, 1),
    ],
)
def test_samples_count_on_only_where_each_follows_the_one_before(numbers, received, lost, duplicates):
    ledger = LossLedger()
    ledger.feed(np.array([0]))
    ledger.feed(np.array(numbers))
    report = ledger.report()
    assert (report.received, report.lost, report.duplicates) == (received, lost, duplicates)
