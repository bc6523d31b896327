"""Results as CSV: read back by Python's csv module, equal to the results, and harmless in a spreadsheet."""

import csv
import io
from pathlib import Path

import pytest

from analysis.scoring.trial import score_series
from host.results.batch import BatchRow
from host.results.csv_rows import COLUMNS, results_csv
from tests.simulated_motion import simulate


def table(*rows):
    return list(csv.DictReader(io.StringIO(results_csv(rows))))


def test_a_row_has_the_numbers_of_its_result():
    result = score_series(simulate(cycles=9, slip_deg=4.0, slip_cycle=4).series)
    (row,) = table(BatchRow(Path("a.csv"), result, None, 0))
    assert tuple(row) == COLUMNS
    assert (row["file"], row["valid"], row["cycles"]) == ("a.csv", "true", str(result.n_endpoints - 1))
    assert float(row["theta_bar_deg"]) == result.theta_bar_deg
    assert (float(row["interval_low_deg"]), float(row["interval_high_deg"])) == result.interval_deg
    assert [float(row[f"axis_{name}"]) for name in "xyz"] == list(result.axis)
    assert int(row["flagged_cycles"]) == sum(map(bool, result.flags))
    assert row["missing_share"] == ""


def test_what_has_no_score_has_its_reason():
    result = score_series(simulate(cycles=1).series)
    invalid, failed = table(BatchRow(Path("a.csv"), result, None, 1), BatchRow(Path("b.csv"), None, "no file", 4))
    assert (invalid["valid"], invalid["theta_bar_deg"]) == ("false", "")
    assert invalid["reasons"] == "; ".join(result.reasons)
    assert (failed["valid"], failed["reasons"]) == ("false", "no file")


@pytest.mark.parametrize("name", ["=1+1.csv", "@x.csv", "-a.csv", 'a,"b".csv', "a\nb.csv", "a\x1b[2Jb.csv"])
def test_no_name_breaks_a_row_or_runs_as_a_formula(name):
    (row,) = table(BatchRow(Path(name), None, "why", 4))
    assert row["reasons"] == "why"
    assert row["file"][0] not in "=@-+"
    assert row["file"].isprintable()
