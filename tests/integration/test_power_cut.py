"""Power fails in mid-capture: on a disk that loses what was not flushed, all but the last moment is there, and scores.

The disk is a block device of a real kernel (a user-mode one, booted as an ordinary process) with a real file system
on it; what it loses is decided in ``tests/uml/volatile_disk.py``. A real capture of a real serial device writes to it,
while the wall clock of that kernel is set forward and back by an hour. How many seconds are lost depends on how busy
the machine is: ``python -m benchmarks.power_cut``.
"""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader

from analysis.scoring.trial import score_series
from host.recording.load import assemble, load_trial
from tests.uml.boot import missing
from tests.uml.cut_disk import PROGRAMS, CutDisk
from tests.uml.power_cut import LEAST_SYNCS

CAPTURE_S = 3.0


@pytest.fixture(scope="module")
def disk(tmp_path_factory: pytest.TempPathFactory) -> CutDisk:
    reason = missing(PROGRAMS, "nbd")
    if reason:
        pytest.skip(reason)
    disk = CutDisk(tmp_path_factory.mktemp("power"))
    disk.run(CAPTURE_S)
    if "CHECK" not in disk.printed:
        pytest.skip(f"the user-mode kernel does not run here: {disk.printed.strip().splitlines()[-1:]}")
    assert "CHECK captured 0" in disk.printed, disk.printed[-4000:]
    assert len(disk.batches) >= LEAST_SYNCS, "what is synchronised reaches the disk"
    return disk


@pytest.mark.parametrize("seed", [None, 1], ids=["nothing-unsynced-lasts", "some-of-it-lasts"])
def test_what_was_synchronised_survives_a_power_cut_and_scores_to_the_same_number(
    disk: CutDisk, seed: int | None
) -> None:
    scored = 0
    for cut in disk.cuts(seed, every=3):
        assert (0 if cut.recording is None else cut.recording.stat().st_size) >= cut.certain
        if not cut.received or cut.recording is None:
            continue
        received = b"".join(chunk.data for chunk in cut.received)
        recorded = b"".join(chunk.data for chunk in cut.recorded)
        # The log of the link is written as the data are read, the recording a moment later: neither is always ahead.
        assert received.startswith(recorded) or recorded.startswith(received)
        if len(recorded) > len(received) or len(cut.kept) < 100:  # too short for a score
            continue
        left, expected = load_trial(cut.recording).series, assemble(cut.kept, "log").series
        assert left.index.tolist() == expected.index.tolist()
        assert score_series(left).theta_bar_deg == score_series(expected).theta_bar_deg
        scored += score_series(left).theta_bar_deg is not None
    assert scored >= 1


def test_a_capture_that_has_ended_is_on_the_disk_whole(disk: CutDisk) -> None:
    *_, last = disk.cuts(every=10**6)
    assert last.recording is not None
    assert last.kept == last.received or last.lost_s == 0.0
    assert load_trial(last.recording).damage == ()


def test_steps_of_the_wall_clock_do_not_reach_the_recording(disk: CutDisk) -> None:
    """The scores are compared above; the log of the link, which they are compared with, has no wall clock in it."""
    assert [f"CHECK wall clock stepped by {by_s} s" in disk.printed for by_s in (3600, -7200)] == [True, True]
    *_, last = disk.cuts(every=10**6)
    assert last.recording is not None
    times_ns = [np.array([chunk.host_time_ns for chunk in chunks]) for chunks in (last.recorded, last.kept)]
    recorded_ns, logged_ns = times_ns[0][: len(times_ns[1])], times_ns[1]
    assert np.abs((recorded_ns - recorded_ns[0]) - (logged_ns - logged_ns[0])).max() <= 1000  # the log has microseconds
    with last.recording.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    dated_s = (summary.statistics.message_end_time - summary.statistics.message_start_time) / 1e9
    assert abs(dated_s - (logged_ns[-1] - logged_ns[0]) / 1e9) < 60.0  # an hour would show; a busy machine does not
