"""Many recordings at once: a file that takes its process down costs only itself."""

import os
import signal
import threading
from multiprocessing import active_children
from pathlib import Path

import pytest

from host.results import batch
from host.results.any_file import SeveralInFileError
from tests.waiting import HANG_S


def deadly(path, *_how):
    """Score a file, as far as the batch can tell; one name kills the process."""
    if path.name == "deadly.csv":
        os.kill(os.getpid(), signal.SIGKILL)
    return (batch.BatchRow(path, {"theta_bar_deg": 1.0}, None, 0),)


def endless(path, *_how):
    """Score the first file at once and none of the others ever; Ctrl-C must not reach this process."""
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    if path.name != "first.csv":
        threading.Event().wait(HANG_S)
    return (batch.BatchRow(path, None, None, 0),)


def test_an_interrupt_ends_the_processes(monkeypatch):
    monkeypatch.setattr(batch, "score_rows", endless)
    others = active_children()

    def interrupted(row):
        assert row.exit_code == 0
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch.score_many([Path(name) for name in ("first.csv", "b.csv", "c.csv")], interrupted, workers=2)
    assert not set(active_children()) - set(others)
    assert signal.getsignal(signal.SIGINT) != signal.SIG_IGN


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_process_that_is_killed_costs_one_file(monkeypatch):
    monkeypatch.setattr(batch, "score_rows", deadly)
    paths = [Path(name) for name in ("a.csv", "deadly.csv", "b.csv", "c.csv", "d.csv")]
    told = []
    rows = batch.score_many(paths, told.append, workers=2)
    assert [row.path for row in rows] == paths
    assert sorted(told, key=lambda row: str(row.path)) == sorted(rows, key=lambda row: str(row.path))
    assert [row.exit_code for row in rows] == [0, 4, 0, 0, 0]
    assert "was killed" in rows[1].error


def test_of_more_sessions_than_make_sense_one_is_to_be_chosen(tmp_path, monkeypatch):
    names = [str(number) for number in range(1, 52)]

    def several(path, *_):
        raise SeveralInFileError(f"{path.name} holds sessions", "session", tuple(names))

    monkeypatch.setattr(batch, "score_recording", several)
    (row,) = batch.score_rows(tmp_path / "log.asc", None, None)
    assert row.result is None
    assert row.error == "log.asc holds 51 sessions, more than 50: choose one with --session"
