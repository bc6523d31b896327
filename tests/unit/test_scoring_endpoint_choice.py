"""End points chosen by a person: on the command line and in a CSV."""

import numpy as np
import pytest

from analysis.scoring.choice import EndpointChoice, load_endpoints, parse_endpoints
from analysis.scoring.trial import score_series
from analysis.series import OrientationSeries, ReaderError, SeriesError


def test_rows_and_times_on_the_command_line():
    assert parse_endpoints("1175, 1639,2099") == EndpointChoice("index", (1175.0, 1639.0, 2099.0))
    assert parse_endpoints("1.5s,2s").kind == "time_s"
    assert parse_endpoints("1.5,2.25").values == (1.5, 2.25)
    assert parse_endpoints("0").values == (0.0,)
    assert parse_endpoints("[10 20\t30]") == EndpointChoice("index", (10.0, 20.0, 30.0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no end points given"),
        (",,", "no end points given"),
        ("nothing.csv", "is neither a file of end points nor a list"),
        ("1,two,3", "is neither a file of end points nor a list"),
        ("1,2.5s", "either rows"),
        ("5,4", "number 2 .*does not; put them in order"),
        ("5,5", "must increase"),
        ("nan,1", "which is not a valid index"),
        ("1e999,1", "which is not a valid index"),
        ("\x1b[31m,1", r"'\?\[31m,1' is neither a file"),
    ],
)
def test_command_line_that_is_neither(text, message):
    with pytest.raises(ReaderError, match=message):
        parse_endpoints(text)


def test_csv_with_reasons(tmp_path):
    path = tmp_path / "ends.csv"
    path.write_text('\ufeffrow,reason\n10,\n20,"hand paused, moved"\n\n30\n', encoding="utf-8")
    choice = parse_endpoints(str(path))
    assert choice == EndpointChoice("row", (10.0, 20.0, 30.0), ("", "hand paused, moved", ""), str(path))
    assert choice.reason(1) == "hand paused, moved"
    assert EndpointChoice("row", (1.0,)).reason(0) == ""


@pytest.mark.parametrize("text", ["10\n20\n30\n", "10,20,30", "10 20 30\r\n", "[10, 20, 30]\n", "\ufeff10;20;30"])
def test_bare_lists_in_a_file(tmp_path, text):
    path = tmp_path / "rows.txt"
    path.write_text(text, encoding="utf-8")
    assert parse_endpoints(str(path)) == EndpointChoice("index", (10.0, 20.0, 30.0), source=str(path))
    path.write_text(text.replace("30", "30.5"), encoding="utf-8")
    with pytest.raises(ReaderError, match="either rows"):
        load_endpoints(path)


@pytest.mark.parametrize("kind", ["row", "sequence", "time_s"])
def test_csv_kinds(tmp_path, kind):
    path = tmp_path / "ends.csv"
    path.write_text(f"reason,{kind}\nx,1\ny,2\n")
    assert load_endpoints(path).kind == kind


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "needs a header"),
        ("time\n1\n", "needs a header"),
        ("row,time_s\n1,2\n", "needs a header with one of"),
        ("row\n1\nx\n", "line 3: 'x' is not a number in column row"),
        ("reason,row\nonly\n", "line 2: '' is not a number"),
        ("row\n1.5\n", "which is not a valid row"),
        ('row\n"' + "9" * 200_000 + '"\n', "not a CSV"),
    ],
)
def test_csv_that_is_none(tmp_path, text, message):
    path = tmp_path / "ends.csv"
    path.write_text(text)
    with pytest.raises(ReaderError, match=message):
        load_endpoints(path)


def test_a_choice_checks_itself():
    with pytest.raises(ReaderError, match="named by row"):
        EndpointChoice("line", (1.0,))
    with pytest.raises(ReaderError, match="2 reasons do not fit 1"):
        EndpointChoice("row", (1.0,), ("a", "b"))


@pytest.mark.parametrize(
    ("kind", "message"), [("time_s", "no samples to choose end points in"), ("index", "there is no sequence 1")]
)
def test_in_a_recording_without_samples_no_end_point_can_be_chosen(kind, message):
    empty = OrientationSeries(np.empty(0), np.empty((0, 4)), np.empty(0, np.int64), "sequence", source="empty.mcap")
    with pytest.raises(SeriesError, match=message):
        score_series(empty, endpoints=EndpointChoice(kind, (1.0, 2.0)))
