"""Every sample is accounted for, whatever the link does."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.scoring.recorded_parts import CycleLosses, Quality
from firmware_protocol.packets import Status
from host.losses.ledger import LossLedger, LossReport
from host.losses.object_counts import ANY_ROOM
from host.losses.runs import MissingTotals, missing_between
from host.losses.verdict import judge_losses
from host.stream.numbers import SequenceUnwrapper


def status(produced, dropped=0):
    return Status(uptime_us=0, samples_produced=produced, samples_dropped=dropped)


def entered(*runs):
    ledger = LossLedger()
    for run in runs:
        if isinstance(run, Status):
            ledger.status(run)
        else:
            ledger.feed(np.array(list(run), dtype=np.int64))
    return ledger


def parts(report):
    return report.produced, report.received, report.lost, report.rejected, report.dropped


def test_nothing_missing():
    report = entered(range(10), range(10, 30)).report()
    assert parts(report) == (30, 30, 0, 0, 0)
    assert report.exact


def test_gaps_are_lost_unless_the_device_says_it_dropped_them():
    ledger = entered(range(10), status(10, 0), range(15, 20), range(22, 30))
    assert parts(ledger.report()) == (30, 23, 7, 0, 0)
    assert not ledger.report().exact
    ledger.status(status(30, 5))
    assert parts(ledger.report()) == (30, 23, 2, 0, 5)
    assert ledger.report().exact


def test_damaged_frames_explain_what_is_missing_in_their_place_and_nothing_else():
    ledger = entered(range(10))
    ledger.damaged(5)
    ledger.feed(np.arange(12, 20))
    assert parts(ledger.report()) == (20, 18, 0, 2, 0)
    ledger.feed(np.array([20, 23, 24]), np.array([1, 1, 1]))  # noise, one of two, noise
    assert parts(ledger.report()) == (25, 21, 1, 3, 0)
    ledger.damaged(1)
    assert parts(ledger.report()) == (25, 21, 1, 3, 0)
    ledger.status(status(27))
    assert parts(ledger.report()) == (27, 21, 2, 4, 0)


def test_each_run_of_missing_samples_has_its_reason():
    ledger = entered(range(10), status(10, 0), range(15, 20), range(22, 30), status(30, 5))
    ledger.damaged(1)
    ledger.feed(np.arange(31, 41))
    ledger.status(status(44, 7))
    runs = [(run.first, run.missing, run.lost, run.rejected, run.dropped) for run in ledger.missing_runs(shift=100)]
    assert runs == [(110, 5, 0, 0, 5), (120, 2, 2, 0, 0), (130, 1, 0, 1, 0), (141, 3, 1, 0, 2)]
    totals = list(missing_between(ledger.missing_runs(), [0, 12, 21, 31, 45]))
    assert totals == [MissingTotals(2, 0, 2), MissingTotals(4, 0, 3), MissingTotals(2, 1, 0), MissingTotals(3, 0, 2)]


def test_samples_lost_at_both_ends_are_known_from_status():
    ledger = entered(status(100, 3), range(104, 110), status(115, 4))
    assert parts(ledger.report()) == (15, 6, 8, 0, 1)
    assert ledger.report().exact


def test_drops_before_we_listened_are_not_ours():
    ledger = entered(range(5000, 5100), status(5100, 777), range(5100, 5110), status(5112, 778))
    assert parts(ledger.report()) == (112, 110, 1, 0, 1)


def test_a_status_counts_beyond_the_16_bits_of_a_sample_number():
    ledger = entered(range(10), status(70000 - 70000 % 65536 + 10), status(70000 - 70000 % 65536 + 10 + 40000))
    assert ledger.report().produced == 40010


def test_repeated_samples_are_refused_and_late_ones_fill_their_gap_once():
    ledger = LossLedger()
    assert ledger.feed(np.array([0, 1, 2, 5, 6])).tolist() == [True] * 5
    assert ledger.feed(np.array([6, 4, 4, 7, 3, 1])).tolist() == [False, True, False, True, True, False]
    report = ledger.report()
    assert parts(report) == (8, 8, 0, 0, 0)
    assert (report.duplicates, report.reordered) == (3, 2)


def test_a_reset_opens_another_account():
    ledger = entered(range(10), range(11, 20))
    ledger.new_segment()
    ledger.feed(np.arange(5))
    report = ledger.report()
    assert parts(report) == (25, 24, 1, 0, 0)
    assert report.segments == 2


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 70000),
    st.lists(st.sampled_from(["take", "lose", "drop", "damage", "repeat", "status"]), min_size=1, max_size=120),
    st.integers(1, 9),
)
def test_the_account_is_what_happened(start, deeds, cut):
    """A link model that knows what it does to each sample, against the ledger that sees only the result."""
    produced, dropped, damaged, lost, received, repeated = start, 0, 0, 0, 0, 0
    ledger = LossLedger()
    ledger.status(status(start, 0))
    run, hits = [], [0]  # samples, and the damaged frames before each and behind the last
    for deed in [*deeds, "status"]:
        if deed == "status":
            for at in range(0, len(run), cut):
                piece = slice(at, min(at + cut, len(run)))
                ledger.feed(np.array(run[piece], dtype=np.int64), np.array(hits[piece], dtype=np.int64))
            ledger.damaged(hits[-1])
            run, hits = [], [0]
            ledger.status(status(produced, dropped))
        elif deed == "repeat":
            if run and not hits[-1]:
                run.append(run[-1])
                hits.append(0)
                repeated += 1
        else:
            if deed == "take":
                run.append(produced)
                hits.append(0)
                received += 1
            dropped += deed == "drop"
            damaged += deed == "damage"
            hits[-1] += deed == "damage"
            lost += deed == "lose"
            produced += 1
    report = ledger.report()
    assert report.produced == report.received + report.lost + report.rejected + report.dropped
    assert report.duplicates == repeated
    if received:
        assert parts(report) == (produced - start, received, lost, damaged, dropped)
        assert report.exact
        runs = ledger.missing_runs()
        assert [run.first for run in runs] == sorted({run.first for run in runs})
        (total,) = missing_between(runs, [start, produced])
        assert total == MissingTotals(report.missing, damaged, dropped)


def test_wraps_are_counted_over_gaps_longer_than_a_wrap():
    unwrapper = SequenceUnwrapper()
    period_us = 1000
    numbers = np.concatenate([np.arange(65000, 66000), np.arange(300_000, 300_100), [300_100 + 5 * 65536 + 40000]])
    times_us = numbers * period_us
    skewed_us = (times_us * (1 + 200e-6)).astype(np.int64)
    got = []
    for at in range(0, len(numbers), 37):
        piece = slice(at, at + 37)
        got.append(unwrapper.feed((numbers[piece] % 65536).astype(np.uint16), skewed_us[piece]))
    np.testing.assert_array_equal(np.concatenate(got), numbers)


@settings(max_examples=200, deadline=None)
@given(
    st.integers(0, 65535),
    st.lists(st.integers(1, 60), min_size=2, max_size=60),
    st.lists(st.integers(-3, 3), min_size=60, max_size=60),
    st.integers(1, 10),
)
def test_repeated_and_late_samples_do_not_move_the_count(start, gaps, shuffles, cut):
    numbers = start + np.cumsum([0, 1, *gaps])
    order = np.argsort(np.arange(len(numbers)) + np.array([0, 0, *shuffles[: len(numbers) - 2]]), kind="stable")
    sent = numbers[order]
    first_two = np.sort(sent[:2])
    unwrapper = SequenceUnwrapper()
    got = [unwrapper.feed((first_two % 65536).astype(np.uint16), first_two * 5000)]
    for at in range(0, len(sent), cut):
        piece = sent[at : at + cut]
        got.append(unwrapper.feed((piece % 65536).astype(np.uint16), piece * 5000))
    expected = np.concatenate([first_two, sent])
    difference = np.concatenate(got) - expected
    assert (difference == difference[0]).all()
    assert difference[0] % 65536 == 0


def test_a_known_start_anchors_the_first_number():
    unwrapper = SequenceUnwrapper()
    unwrapper.restart(start=131_072)
    assert unwrapper.feed(np.array([3, 4], dtype=np.uint16), np.array([0, 1])).tolist() == [131_075, 131_076]


def cycles(*missing):
    """Return the accounts of cycles of 100 samples that miss so many."""
    return tuple(
        CycleLosses(produced=100, missing=n, rejected=0, dropped_by_device=0, received=100 - n, lost=n) for n in missing
    )


def test_what_makes_a_score_degraded():
    good = LossReport(produced=10_000, received=9_950, lost=50)
    verdict = judge_losses(good, cycles(0, 4, 6, 0))
    assert (verdict.degraded, verdict.reasons, verdict.cycles_with_gaps) == (False, (), (3,))
    bad = LossReport(produced=10_000, received=9_850, lost=100, rejected=20, dropped=30)
    verdict = judge_losses(bad, cycles(10, 10, 0, 0))
    assert verdict.degraded
    assert "1.5 % of the samples are missing (100 lost on the link, 20 damaged, 30 dropped" in verdict.reasons[0]
    assert "2 of 4 cycles miss more than 5 % of their samples (cycle 1, 2)" in verdict.reasons[1]
    assert judge_losses(LossReport(), ()) == Quality(False, (), (), (0.01, 0.05, 0.25))


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=150)
def test_status_among_samples_counts_as_if_each_came_by_itself(data):
    n = data.draw(st.integers(1, 60))
    steps = data.draw(st.lists(st.sampled_from([1, 1, 1, 1, 1, 1, 3, 0, -2]), min_size=n, max_size=n))
    numbers = 5 + np.cumsum(np.array(steps, dtype=np.int64))
    hits = data.draw(st.none() | st.lists(st.sampled_from([0, 0, 0, 1]), min_size=n, max_size=n))
    damaged = None if hits is None else np.array(hits, dtype=np.int64)
    places = sorted(data.draw(st.lists(st.integers(0, n), max_size=5)))
    told = [status(int(numbers[:place].max(initial=4)) + 1 + ahead, ahead) for ahead, place in enumerate(places)]
    together, single = LossLedger(), LossLedger()
    for ledger in (together, single):
        ledger.feed(np.arange(5, dtype=np.int64))
    kept = together.feed(
        numbers, damaged, [(place, packet, ANY_ROOM) for place, packet in zip(places, told, strict=True)]
    )
    expected = []
    for start, stop, packet in zip([0, *places], [*places, n], [*told, None], strict=True):
        if stop > start:
            hit = None if damaged is None else damaged[start:stop]
            expected += single.feed(numbers[start:stop], hit).tolist()
        if packet is not None:
            single.status(packet)
    assert kept.tolist() == expected
    assert together.report() == single.report()
    assert together.missing_runs() == single.missing_runs()
