"""Bad and hostile files: one sentence, with the line, and nothing worse."""

import time

import numpy as np
import pytest

from analysis.formats import ReaderError, read_series
from analysis.formats.source import plain
from analysis.formats.text_table import MAX_LINE_BYTES
from tests import reader_files as files
from tests.waiting import SLOW_S


def damage(path, line, old, new):
    lines = path.read_text().splitlines()
    assert old is None or old in lines[line - 1]
    lines[line - 1] = new if old is None else lines[line - 1].replace(old, new, 1)
    path.write_text("\n".join(lines) + "\n")


def cell(path, line, column, new):
    lines = path.read_text().splitlines()
    cells = lines[line - 1].split(",")
    cells[column] = new
    lines[line - 1] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("bad", ["abc", "inf", "-inf", "1_0", "0x1p3", "1e999", "--1", "1 2"])
@pytest.mark.parametrize("line", [2, 17, 401])
def test_the_bad_cell_is_named(tmp_path, bad, line):
    path = tmp_path / "a.csv"
    files.t42(path)
    cell(path, line, 5, bad)
    with pytest.raises(ReaderError, match=rf"a\.csv line {line}: '{bad}' is not a number in column rx"):
        read_series(path)


@pytest.mark.parametrize("hole", ["", "nan", "NaN", " ", "null", "N/A"])
def test_a_row_with_a_hole_is_left_out_and_counted(tmp_path, hole):
    path = tmp_path / "a.csv"
    files.t42(path)
    cell(path, 9, 6, hole)
    series = read_series(path)
    assert series.index.tolist() == [k for k in range(400) if k != 7]
    assert any("1 of 400 rows have no orientation and are left out, 0.25 %" in note for note in series.notes)


@pytest.mark.parametrize("write", [files.t42, files.ndx, files.named, files.tum])
@pytest.mark.parametrize("missing", [30, 45, 60])
def test_a_last_line_that_is_cut_off_is_left_out_and_said(tmp_path, write, missing):
    path = tmp_path / "a.csv"
    write(path)
    whole = read_series(path)
    path.write_text(path.read_text()[:-missing])
    cut = read_series(path)
    np.testing.assert_array_equal(cut.quats_wxyz, whole.quats_wxyz[:-1])
    assert "the last line is cut off and left out" in cut.notes


def test_a_bad_cell_is_named_in_a_file_that_is_cut_off_too(tmp_path):
    path = tmp_path / "a.csv"
    files.named(path)
    cell(path, 9, 2, "x")
    path.write_text(path.read_text()[:-60])
    with pytest.raises(ReaderError, match=r"line 9: 'x' is not a number in column x"):
        read_series(path)


def test_a_comment_at_the_end_is_no_line_that_is_cut_off(tmp_path):
    path = tmp_path / "a.csv"
    files.named(path)
    path.write_text(path.read_text() + "# that was all")
    series = read_series(path)
    assert len(series) == 400
    assert not any("cut off" in note for note in series.notes)


def test_lines_across_blocks_of_reading_are_whole(tmp_path):
    path = tmp_path / "a.csv"
    files.named(path, n=4000)
    assert path.stat().st_size > 3 * MAX_LINE_BYTES  # several blocks
    _, poses, _ = files.motion(4000)
    np.testing.assert_allclose(np.abs(read_series(path).quats_wxyz), np.abs(poses.as_quat(scalar_first=True)))


@pytest.mark.parametrize("before", [300, MAX_LINE_BYTES - 50, MAX_LINE_BYTES, 3 * MAX_LINE_BYTES + 7])
def test_the_longest_line_is_as_long_wherever_it_stands(tmp_path, before):
    path = tmp_path / "a.csv"
    rows = "t,w,x,y,z,remark\n" + "".join(f"{k},1,0,0,0,\n" for k in range(before // 12))
    path.write_text(rows + f"9e9,1,0,0,0,{'9' * (MAX_LINE_BYTES - 12)}\n")
    assert len(read_series(path)) == before // 12 + 1
    path.write_text(rows + f"9e9,1,0,0,0,{'9' * (MAX_LINE_BYTES - 11)}\n")
    with pytest.raises(ReaderError, match="line longer than"):
        read_series(path)


def test_a_short_line_within_the_file_is_named(tmp_path):
    path = tmp_path / "a.csv"
    files.t42(path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:40], lines[40][:30], *lines[41:]]))
    with pytest.raises(ReaderError, match=r"line 41: .* columns, but"):
        read_series(path)


def test_ndx_text_in_a_row(tmp_path):
    path = tmp_path / "a.csv"
    files.ndx(path)
    cell(path, 17, 4, " oops")
    with pytest.raises(ReaderError, match="line 17: 'oops' is not a number in column azimuth"):
        read_series(path)


def test_line_numbers_count_blank_lines(tmp_path):
    path = tmp_path / "a.csv"
    files.t42(path)
    damage(path, 5, None, "\n\n" + path.read_text().splitlines()[4])
    cell(path, 30, 5, "x")
    with pytest.raises(ReaderError, match="line 30: 'x'"):
        read_series(path)


def test_other_columns_may_hold_anything(tmp_path):
    path = tmp_path / "a.csv"
    files.t42(path)
    cell(path, 17, 8, "motor stalled")
    assert len(read_series(path)) == 400


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\n\n", "has no lines of text"),
        (b"hello world\n", "is not a file known here"),
        (b"1,2,3\n4,5,6\n", "columns without names"),
        (b"\x00\x01\x02" * 100, "is not text"),
        (b",ts,tx,ty,tz,rx,ry,rz\n", "has no data rows"),
        (b"PAR1nonsense", "not a sound parquet"),
        (b"#ROSBAG V2.0\nnonsense", "a\\.csv"),
        (b"\xff" * 300, "is not a file known here"),
        (b"\x1b[31mred\x07,1\n", r"starts with '\?\[31mred\?,1'"),
        (b"a" * 1_000_000, "not a table of numbers"),
        (b",".join(b"c%d" % k for k in range(5000)) + b"\n", "5000 columns"),
        (b",ts,tx,ty,tz,rx,ry,rz\n" + b"0,1,0,0,0,0,0,0\n" * 50 + b"9" * 200_000 + b"\n", "line longer than"),
    ],
)
def test_files_that_are_none(tmp_path, content, message):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(ReaderError, match=message):
        read_series(path)


def test_folders_that_are_no_bag(tmp_path):
    with pytest.raises(ReaderError, match=r"so no ROS 2 bag: give a file"):
        read_series(tmp_path)


def test_a_missing_file_is_the_system_s_own_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_series(tmp_path / "nothing.csv")


def test_names_like_addresses_are_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OSError, match="No such file"):
        read_series("http://localhost:9/a.csv")


def test_text_of_files_is_tamed():
    assert plain("a\x1b]0;evil\x07b\nc") == "a?]0;evil?b?c"
    assert plain("x" * 100, 10) == "x" * 10 + "…"
    assert plain("right\u202eleft") == "right?left"


# Time stamps


def quaternion_file(path, times):
    n = len(times)
    files.named(path, "time,qw,qx,qy,qz", n=n, times=np.asarray(times))
    return path


def test_repeated_time_stamps_are_set_aside_and_said(tmp_path):
    times = np.arange(100) / 100.0
    times[[10, 50]] = times[[9, 49]]
    series = read_series(quaternion_file(tmp_path / "a.csv", times))
    assert len(series) == 98
    assert series.index.tolist() == [k for k in range(100) if k not in (10, 50)]
    assert series.set_aside.index.tolist() == [10, 50]
    assert any("2 rows repeat the time stamp" in note for note in series.notes)
    assert series.sample(50).time_s == pytest.approx(0.49)


def test_one_wild_time_stamp_costs_one_row(tmp_path):
    times = np.arange(100) / 100.0
    times[30] = 1e6
    series = read_series(quaternion_file(tmp_path / "a.csv", times))
    assert len(series) == 99
    assert series.set_aside.index.tolist() == [30]
    assert any("goes backwards 1 times, first at row 31" in note for note in series.notes)


def test_a_repeated_time_stamp_beside_a_backward_one_is_set_aside_too(tmp_path):
    times = np.arange(100) / 100.0
    times[30], times[60] = 1e6, times[59]
    series = read_series(quaternion_file(tmp_path / "a.csv", times))
    assert len(series) == 98
    assert set(series.set_aside.index.tolist()) <= {30, 59, 60}


def test_stamps_a_nanosecond_apart_are_kept(tmp_path):
    times = np.arange(100) / 100.0
    times[30], times[60] = 1e6, times[59] + 1e-9
    assert len(read_series(quaternion_file(tmp_path / "a.csv", times))) == 99


def test_swapped_rows(tmp_path):
    times = np.arange(100) / 100.0
    times[[40, 41]] = times[[41, 40]]
    assert len(read_series(quaternion_file(tmp_path / "a.csv", times))) == 99


def test_a_column_that_is_no_time_is_refused(tmp_path):
    with pytest.raises(ReaderError, match="is the time column the right one"):
        read_series(quaternion_file(tmp_path / "a.csv", np.linspace(5.0, 0.0, 100)))
    with pytest.raises(ReaderError, match="is the time column the right one"):
        read_series(quaternion_file(tmp_path / "a.csv", np.zeros(100)))


def test_gaps_are_said(tmp_path):
    times = np.arange(100) / 100.0
    times[60:] += 0.5
    notes = read_series(quaternion_file(tmp_path / "a.csv", times)).notes
    assert any("1 gaps longer than 5 times the usual 10 ms, longest 0.51 s at 0.590 s" in note for note in notes)


def test_missing_time_needs_a_rate(tmp_path):
    path = tmp_path / "a.csv"
    files.named(path, "foo,qw,qx,qy,qz")
    with pytest.raises(ReaderError, match="give the sampling rate with --rate"):
        read_series(path)
    assert read_series(path, rate_hz=200.0).interval_s == pytest.approx(0.005)
    with pytest.raises(ReaderError, match="makes no sense"):
        read_series(path, rate_hz=0.0)
    files.t42(path)
    assert any("rate given (50 Hz) was not used" in note for note in read_series(path, rate_hz=50.0).notes)


def test_impossible_norms_are_refused_with_the_row(tmp_path):
    path = tmp_path / "a.csv"
    quats = files.motion()[1].as_quat(scalar_first=True)
    quats[7] = 0.0
    files.named(path, quats=quats)
    with pytest.raises(ReaderError, match="row 7: the quaternion has norm 0, not 1"):
        read_series(path)


def test_wrong_units_are_suspected(tmp_path):
    path = tmp_path / "a.csv"
    times, poses, _ = files.motion()
    path.write_text(files.rows_text(np.column_stack((times * 1e3, poses.as_euler("ZYX"))), "t,a,b,c"))
    series = read_series(path, columns="t=t,e1=a,e2=b,e3=c,euler=intrinsic-zyx,angle=deg")
    assert any("are they radians" in warning for warning in series.warnings)
    assert any("is the time really in s" in warning for warning in series.warnings)


def test_the_cost_of_forty_thousand_rows_does_not_grow_with_their_square(tmp_path):
    path = tmp_path / "a.csv"
    files.t42(path, quaternion=True, n=40_000)
    start = time.process_time()
    assert len(read_series(path)) == 40_000
    assert time.process_time() - start < SLOW_S
