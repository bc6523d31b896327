"""Many recordings at once: a file that takes its process down costs only itself."""

import os
import signal
from pathlib import Path

import pytest

from host.scoring import batch


def deadly(path, *_how):
    """Score a file, as far as the batch can tell; one name kills the process."""
    if path.name == "deadly.csv":
        os.kill(os.getpid(), signal.SIGKILL)
    return batch.BatchRow(path, {"theta_bar_deg": 1.0}, None, 0)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_process_that_is_killed_costs_one_file(monkeypatch):
    monkeypatch.setattr(batch, "score_row", deadly)
    paths = [Path(name) for name in ("a.csv", "deadly.csv", "b.csv", "c.csv", "d.csv")]
    told = []
    rows = batch.score_many(paths, told.append, workers=2)
    assert [row.path for row in rows] == paths
    assert sorted(told, key=lambda row: str(row.path)) == sorted(rows, key=lambda row: str(row.path))
    assert [row.exit_code for row in rows] == [0, 4, 0, 0, 0]
    assert "was killed" in rows[1].error
