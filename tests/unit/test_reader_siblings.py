"""Tables as many programs write them, made here: of each kind more than any one file shows.

A motion is written in a variant and read again; it has to be that motion, or the sentence has to name the reason.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from analysis.formats import ReaderError, SeveralStreamsError, StreamChoice, read_series
from analysis.geometry import rotations
from tests import reader_files as files

N = 60
TIMES, POSES, POSITIONS = files.motion(N)
QUATS = POSES.as_quat(scalar_first=True)
_, OTHER_POSES, _ = files.motion(N, seed=2)
OTHER = rotations.multiply([0.9689124, 0.2474040, 0.0, 0.0], QUATS)
PARTS = ("qw", "qx", "qy", "qz")


def number(value):
    return f"{float(value):.9f}"


def table(rows, header, separator=","):
    lines = [separator.join(header)] if header else []
    return "\n".join([*lines, *(separator.join(row) for row in rows)]) + "\n"


def rows_of(times=TIMES, quats=QUATS, time=number):
    return [[time(t), *map(number, q)] for t, q in zip(times, quats, strict=True)]


def read(tmp_path, text, name="a.csv", **how):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_series(path, **how)


def assert_quats(series, quats=QUATS, within_rad=1e-7):
    assert len(series) == len(quats)
    assert rotations.distance(series.quats_wxyz, quats).max() < within_rad


def assert_times(series, times=TIMES, within_s=1e-6):
    np.testing.assert_allclose(series.times_s - series.times_s[0], times - times[0], atol=within_s)


# Several sensors in a column

SENSOR_NAMES = [
    "SensorId",
    "sensor",
    "Sensor ID",
    "Device",
    "device_id",
    "imu_id",
    "tracker",
    "frame_id",
    "header.frame_id",
    "%child_frame_id",
    "/imu/frame_id",
    "Rigid Body",
    "object",
    "node",
    "Serial Number",
    "id",
]


@pytest.mark.parametrize("separator", [",", ";", "\t", ", "])
@pytest.mark.parametrize("name", SENSOR_NAMES)
def test_sensors_in_a_column_are_never_one(tmp_path, name, separator):
    labels = ("1", "2") if "id" in name.lower() else ("hand", "cube 2")
    rows = [
        row
        for a, b in zip(rows_of(), rows_of(TIMES + 0.003, OTHER), strict=True)
        for row in ([labels[0], *a], [labels[1], *b])
    ]
    text = table(rows, [name, "time", *PARTS], separator)
    with pytest.raises(SeveralStreamsError, match=rf"^two sensors: .*{labels[0]}.*; choose with --sensor "):
        read(tmp_path, text)
    assert_quats(read(tmp_path, text, choice=StreamChoice(sensor=labels[0])))
    second = read(tmp_path, text, choice=StreamChoice(sensor=labels[1]))
    assert_quats(second, OTHER)
    assert second.index.tolist() == list(range(1, 2 * N, 2))
    with pytest.raises(ReaderError, match=r"no sensor 7; there is two sensors: "):
        read(tmp_path, text, choice=StreamChoice(sensor="7"))


@pytest.mark.parametrize("n_sensors", [2, 3, 5])
def test_sensors_one_behind_the_other(tmp_path, n_sensors):
    rows = [[f"s{k}", *row] for k in range(n_sensors) for row in rows_of()]
    with pytest.raises(SeveralStreamsError, match="sensors: s0, s1"):
        read(tmp_path, table(rows, ["sensor", "time", *PARTS]))


@pytest.mark.parametrize("prefixes", [("hand_", "cube_"), ("/a/orientation/", "/b/orientation/"), ("imu1.q", "imu2.q")])
def test_sensors_side_by_side(tmp_path, prefixes):
    header = ["time", *(prefix + part for prefix in prefixes for part in "wxyz")]
    rows = [[*a, *b[1:]] for a, b in zip(rows_of(), rows_of(quats=OTHER), strict=True)]
    with pytest.raises(SeveralStreamsError, match="two sensors: ") as seen:
        read(tmp_path, table(rows, header))
    assert_quats(read(tmp_path, table(rows, header), choice=StreamChoice(sensor=seen.value.names[1])), OTHER)


@pytest.mark.parametrize("apart_s", [0.0, 0.001, 0.005])
def test_two_sensors_of_other_rates_that_nothing_tells_apart(tmp_path, apart_s):
    rows = []
    for k, (row, other) in enumerate(zip(rows_of(), rows_of(TIMES + apart_s, OTHER), strict=True)):
        rows += [row, other] if k % 3 == 0 else [row]
    with pytest.raises(ReaderError, match=r"alternate between two orientations 2.*two sensors or two publishers"):
        read(tmp_path, table(rows, ["time", *PARTS]))


@pytest.mark.parametrize("share", [0.02, 0.08])
def test_a_tracker_that_errs_now_and_then_is_one_sensor(tmp_path, share):
    rng = np.random.default_rng(5)
    wrong = rng.random(N) < share
    rows = [other if bad else row for row, other, bad in zip(rows_of(), rows_of(quats=OTHER), wrong, strict=True)]
    assert len(read(tmp_path, table(rows, ["time", *PARTS]))) == N


@pytest.mark.parametrize("apart_s", [0.0, 0.001, 0.005])
def test_two_sensors_that_nothing_tells_apart(tmp_path, apart_s):
    rows = [row for pair in zip(rows_of(), rows_of(TIMES + apart_s, OTHER), strict=True) for row in pair]
    with pytest.raises(ReaderError, match=r"alternate between two orientations|do not increase|two sensors"):
        read(tmp_path, table(rows, ["time", *PARTS]))


@pytest.mark.parametrize(
    "column", [["moving" if 20 < k < 40 else "still" for k in range(N)], [str(k) for k in range(N)], ["a"] * N]
)
@pytest.mark.parametrize("name", ["phase", "frame", "remark"])
def test_other_columns_are_no_sensors(tmp_path, name, column):
    rows = [[cell, *row] for cell, row in zip(column, rows_of(), strict=True)]
    assert_quats(read(tmp_path, table(rows, [name, "time", *PARTS])))


# Several sessions in a file


def sessions(starts_s, unit=1.0, between=()):
    header = ["time" if unit == 1.0 else "time_ms", *PARTS]
    whole = ""
    for k, start_s in enumerate(starts_s):
        quats = QUATS if k % 2 == 0 else OTHER
        rows = rows_of(start_s * unit + (TIMES - TIMES[0]) * 10.0 * unit, quats)
        part = table(rows, header if k == 0 else None)
        whole += part if k == 0 else "".join(line + "\n" for line in between) + part
    return whole


@pytest.mark.parametrize("unit", [1.0, 1000.0])
@pytest.mark.parametrize(
    ("starts_s", "between"),
    [
        ((0.0, 0.0), ()),
        ((0.3, 0.307), ()),
        ((10.0, 2.0), ()),
        ((0.0, 0.0, 0.0), ()),
        ((5.0, 0.0, 2.5, 1.0), ()),
        ((0.0, 0.0), ("HEADER",)),
        ((0.0, 100.0), ("HEADER",)),
        ((0.0, 0.0), ("", "HEADER")),
        ((0.0, 0.0), ("Device:,unit-1", "Rate:,100", "HEADER")),
        ((1.7e9, 1.0), ()),
    ],
)
def test_sessions_are_apart(tmp_path, unit, starts_s, between):
    header = ",".join(["time" if unit == 1.0 else "time_ms", *PARTS])
    text = sessions(starts_s, unit, [header if line == "HEADER" else line for line in between])
    with pytest.raises(SeveralStreamsError, match=r"sessions: 1 \(rows 0 to 59\), 2 \(rows 60 to ") as seen:
        read(tmp_path, text)
    assert len(seen.value.names) == len(starts_s)
    for k in range(len(starts_s)):
        series = read(tmp_path, text, choice=StreamChoice(session=k + 1))
        assert_quats(series, OTHER if k % 2 else QUATS)
        assert series.index[0] == k * N
    with pytest.raises(ReaderError, match="no session 9"):
        read(tmp_path, text, choice=StreamChoice(session=9))


@pytest.mark.parametrize("late", [1, 3, 12])
@pytest.mark.parametrize("by_s", [0.05, 2.0, 500.0])
def test_rows_that_come_late_are_no_session(tmp_path, late, by_s):
    times = TIMES.copy()
    times[30 : 30 + late] -= by_s
    series = read(tmp_path, table(rows_of(times), ["time", *PARTS]))
    assert len(series) >= N - max(late, 6)
    assert any("goes backwards" in note for note in series.notes)


# Clocks that wrap

WRAPS = [
    (2.0**32, 1e-6, "us"),
    (2.0**24, 1e-6, "us"),
    (2.0**16, 1e-3, "ms"),
    (2.0**32, 1e-3, "ms"),
    (2.0**32, 1e-9, "ns"),
]


@pytest.mark.parametrize(("ticks", "tick_s", "unit"), WRAPS)
@pytest.mark.parametrize("before", [1, 7, 30, 59])
@pytest.mark.parametrize("step_ticks", [1, 3])
def test_a_counter_that_wraps_is_unwrapped(tmp_path, ticks, tick_s, unit, before, step_ticks):
    step = step_ticks * 0.01 / tick_s
    counts = np.round(ticks - step * before + step * np.arange(N)) % ticks
    text = table(rows_of(counts, time=lambda t: f"{t:.0f}"), [f"t_{unit}", *PARTS])
    series = read(tmp_path, text)
    assert_quats(series)
    np.testing.assert_allclose(np.diff(series.times_s), step * tick_s, atol=2 * tick_s)
    assert any("wraps once" in note for note in series.notes)
    assert series.warnings == () or all("left out" not in warning for warning in series.warnings)


def test_ticks_of_a_tenth_of_a_millisecond_wrap(tmp_path):
    counts = (2.0**32 - 2000 + 100 * np.arange(N)) % 2.0**32
    series = read(tmp_path, table(rows_of(counts * 1e-4, time=lambda t: f"{t:.4f}"), ["time", *PARTS]))
    np.testing.assert_allclose(np.diff(series.times_s), 0.01, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "spec"), [("SampleTime", ""), ("ticks", "t=ticks,time=100us,"), ("count", "t=count,")]
)
def test_ticks_of_ten_kilohertz(tmp_path, name, spec):
    counts = (2.0**32 - 2000 + 100 * np.arange(N)) % 2.0**32
    columns = spec + "qw=qw,qx=qx,qy=qy,qz=qz" if spec else None
    series = read(tmp_path, table(rows_of(counts, time=lambda t: f"{t:.0f}"), [name, *PARTS]), columns=columns)
    np.testing.assert_allclose(np.diff(series.times_s), 100.0 if name == "count" else 0.01, atol=1e-6)
    assert any("wraps once" in note for note in series.notes)


def test_a_short_counter_wraps_many_times(tmp_path):
    n = 400
    _, poses, _ = files.motion(n)
    counts = (250.0 * np.arange(n)) % 2.0**16
    text = table(rows_of(counts, poses.as_quat(scalar_first=True), lambda t: f"{t:.0f}"), ["t_ms", *PARTS])
    series = read(tmp_path, text)
    np.testing.assert_allclose(np.diff(series.times_s), 0.25)
    assert len(series) == n


def test_a_clock_passes_midnight(tmp_path):
    def clock(t):
        t %= 86_400.0
        return f"{int(t // 3600):02d}:{int(t % 3600 // 60):02d}:{t % 60:06.3f}"

    series = read(tmp_path, table(rows_of(86_399.7 + 0.01 * np.arange(N), time=clock), ["time", *PARTS]))
    np.testing.assert_allclose(np.diff(series.times_s), 0.01, atol=1e-6)


# Widths and quotes


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("name", ["Time, s", "Time; s", "Time (s), since start", "t,s", "Zeit;Time, s"])
def test_separators_in_quotes_are_part_of_the_name(tmp_path, name, separator):
    text = table(rows_of(), [f'"{name}"', *PARTS], separator)
    assert_quats(read(tmp_path, text, columns="t=#0,qw=qw,qx=qx,qy=qy,qz=qz"))
    quoted = table([[f'"{cell}"' for cell in row] for row in rows_of()], [f'"{name}"', *PARTS], separator)
    assert_quats(read(tmp_path, quoted, columns="t=#0,qw=qw,qx=qx,qy=qy,qz=qz"))


@pytest.mark.parametrize("quoted", [True, False])
@pytest.mark.parametrize("separator", [";", "\t", " "])
def test_decimal_commas_are_refused_with_what_to_do(tmp_path, separator, quoted):
    cells = [[cell.replace(".", ",") for cell in row] for row in rows_of()]
    rows = [[f'"{cell}"' for cell in row] for row in cells] if quoted else cells
    with pytest.raises(ReaderError, match="decimal points"):
        read(tmp_path, table(rows, ["time", *PARTS], separator))


def test_decimal_commas_between_commas_are_refused(tmp_path):
    rows = [[cell.replace(".", ",") for cell in row] for row in rows_of()]
    with pytest.raises(ReaderError, match="10 columns, but the header names 5: decimal commas"):
        read(tmp_path, table(rows, ["time", *PARTS]))
    quoted = [[f'"{cell}"' for cell in row] for row in rows]
    with pytest.raises(ReaderError, match="decimal points"):
        read(tmp_path, table(quoted, ["time", *PARTS]))


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize(
    ("line", "change"), [(2, "wider"), (30, "wider"), (61, "wider"), (2, "narrower"), (30, "narrower")]
)
def test_a_row_of_another_width_is_named(tmp_path, separator, line, change):
    rows = [[*row, "1"] for row in rows_of()]
    rows[line - 2] = [*rows[line - 2], "5"] if change == "wider" else rows[line - 2][:-1]
    with pytest.raises(ReaderError, match=rf"a\.csv line {line}: \d columns, but the header names 6"):
        read(tmp_path, table(rows, ["time", *PARTS, "more"], separator))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_empty_cells_at_the_end_count_for_nothing(tmp_path, separator):
    rows = [[*row, "", ""] if k % 2 else [*row, ""] for k, row in enumerate(rows_of())]
    assert_quats(read(tmp_path, table(rows, ["time", *PARTS, "remark"], separator)))


@pytest.mark.parametrize("place", [0, 2, 5])
@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_a_text_column_without_a_header(tmp_path, separator, place):
    rows = [[*row[:place], "cube", *row[place:]] for row in rows_of()]
    where = [k for k in range(6) if k != place]
    spec = ",".join(f"{key}=#{k}" for key, k in zip(("t", *PARTS), where, strict=True))
    series = read(tmp_path, table(rows, None, separator), columns=spec)
    assert_quats(series)
    assert series.index.tolist() == list(range(N))


# Lines before the header, units below it

HEADINGS = {
    "excel": ["sep=,"],
    "xsens dot": [
        "sep=,",
        "DeviceTag:,1",
        "FirmwareVersion:,2.0.0",
        "OutputRate:,60Hz",
        "StartTime:,2024-05-01_10:00:00",
        "",
    ],
    "mt manager": ["// General information:", "//  MT Manager version: 2022.2.0", "//  Update Rate: 100.0Hz"],
    "a title": ["Rotation trial of a cube"],
    "a title of two cells": ["Subject,3"],
    "key and value": ["Operator,anna", "Sampling rate,100,Hz", "Sensors,1", ""],
    "numbers among texts": ["Version,1.23,Take,trial,Rate,100.0,Type,Quaternion"],
    "ids above the names": [",1,1,1,1", ",Rotation,Rotation,Rotation,Rotation"],
    "percent": ["% written by a script", "% 2024-05-01"],
    "dashes": ["-----", "Recording 7", "-----"],
    "ten lines": [f"Line {k}: nothing,of,interest" for k in range(10)],
    "forty lines": [f"Setting {k},{k}" for k in range(40)],
}


@pytest.mark.parametrize("units", [None, "s,,,,", "[s],[-],[-],[-],[-]", "(s),n/a,n/a,n/a,n/a"])
@pytest.mark.parametrize("heading", HEADINGS)
def test_lines_before_the_header_are_passed_over(tmp_path, heading, units):
    lines = [*HEADINGS[heading], ",".join(["time", *PARTS]), *([units] if units else [])]
    series = read(tmp_path, "\n".join(lines) + "\n" + table(rows_of(), None))
    assert_quats(series)
    assert_times(series)
    bad = table(rows_of(), None).replace(number(QUATS[9, 1]), "oops", 1)
    with pytest.raises(ReaderError, match=rf"a\.csv line {len(lines) + 10}: 'oops' is not a number in column qx"):
        read(tmp_path, "\n".join(lines) + "\n" + bad)


@pytest.mark.parametrize(
    "line",
    [
        "Update Rate: 50.0Hz",
        "OutputRate:,50Hz",
        "Sample Rate:,50,Hz,,",
        "DataRate=50.000",
        "Capture Frame Rate,50.0",
        "sampling frequency: 50",
    ],
)
def test_a_rate_before_the_header_counts_where_there_are_no_times(tmp_path, line):
    text = line + "\n" + table([row[1:] for row in rows_of()], list(PARTS))
    series = read(tmp_path, text)
    np.testing.assert_allclose(np.diff(series.times_s), 0.02)
    assert any("50 Hz, as its heading states" in note for note in series.notes)
    assert read(tmp_path, text, rate_hz=100.0).interval_s == pytest.approx(0.01)


@pytest.mark.parametrize("n", [1, 2])
def test_opensim_orientations(tmp_path, n):
    head = "DataRate=100.0\nDataType=Quaternion\nversion=3\nendheader\n"
    names = "time\t" + "\t".join(f"imu{k}" for k in range(n)) + "\n"
    rows = "".join(
        "\t".join([number(t), *[",".join(map(number, q)) for q in (a, b)[:n]]]) + "\n"
        for t, a, b in zip(TIMES, QUATS, OTHER, strict=True)
    )
    if n == 1:
        assert_quats(read(tmp_path, head + names + rows, "a.sto"))
    else:
        with pytest.raises(SeveralStreamsError, match="two sensors: imu0, imu1"):
            read(tmp_path, head + names + rows, "a.sto")
        assert_quats(read(tmp_path, head + names + rows, "a.sto", choice=StreamChoice(sensor="imu1")), OTHER)


# Holes


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("hole", ["", "nan", "NaN", "NA", "null", "None", "-nan", "-", "nan(ind)"])
def test_rows_without_the_object_are_left_out_and_counted(tmp_path, hole, separator):
    rows = rows_of()
    for k in (20, 21):
        rows[k][1:] = [hole] * 4
    series = read(tmp_path, table(rows, ["time", *PARTS], separator))
    assert_quats(series, np.delete(QUATS, (20, 21), axis=0))
    assert series.index.tolist() == [k for k in range(N) if k not in (20, 21)]
    assert series.warnings[0].startswith("2 of 60 rows have no orientation and are left out, 3.4 %")


def test_rows_of_another_topic_cost_nothing(tmp_path):
    rows = [
        line
        for k, row in enumerate(rows_of())
        for line in ([*row, ""], *([[number(TIMES[k] + 0.004), "", "", "", "", "12.1"]] if k % 3 == 0 else []))
    ]
    series = read(tmp_path, table(rows, ["time", *PARTS, "/battery/voltage"]))
    assert_quats(series)
    assert series.warnings == ()
    assert any("20 of 80 rows have no orientation and are left out, 0 %" in note for note in series.notes)


@pytest.mark.parametrize(("missing", "valid_share"), [(3, True), (12, False), (30, False)])
def test_how_much_is_left_out_is_known(tmp_path, missing, valid_share):
    rows = rows_of()
    for k in range(10, 10 + missing):
        rows[k][1:] = [""] * 4
    series = read(tmp_path, table(rows, ["time", *PARTS]))
    (part,) = series.left_out
    assert (part.rows, part.of) == (missing, N)
    assert part.share == pytest.approx(missing / (N - 1), rel=1e-6)
    assert (part.share <= 0.1) is valid_share


# Times

TIME_COLUMNS = [
    ("SampleTimeFine", 1e6),
    ("elapsed (s)", 1.0),
    ("Elapsed Time", 1.0),
    ("Time (Seconds)", 1.0),
    ("TimeStamp (s)", 1.0),
    ("timestamp_us", 1e6),
    ("Timestamp (µs)", 1e6),
    ("time [ms]", 1e3),
    ("Time(ms)", 1e3),
    ("t_ns", 1e9),
    ("%time", 1e9),
    ("__time", 1.0),
    ("time, s", 1.0),
    ("Unix Time", 1.0),
    ("device_time_us", 1e6),
    ("millis", 1e3),
    ("seconds", 1.0),
    ("/imu/time", 1.0),
    ("rosbagTimestamp", 1e9),
    ("epoch_ms", 1e3),
    ("Time_msec", 1e3),
    ("host time (ns)", 1e9),
]


@pytest.mark.parametrize(("name", "per_s"), TIME_COLUMNS)
def test_times_go_by_many_names(tmp_path, name, per_s):
    text = table(rows_of(TIMES * per_s, time=lambda t: repr(float(t))), [f'"{name}"', *PARTS])
    series = read(tmp_path, text)
    assert series.times_measured
    assert_times(series, within_s=1e-5)


@pytest.mark.parametrize(
    "form",
    [
        "2024-05-01T12:00:{:06.3f}",
        "2024-05-01 12:00:{:06.3f}",
        "2024-05-01T12:00:{:06.3f}Z",
        "12:00:{:06.3f}",
        "2024-05-01T12:00:{:09.6f}+02:00",
        "2024/05/01 12:00:{:06.3f}",
        "01.05.2024 12:00:{:06.3f}",
        "00:{:06.3f}",
        "05/01/2024 12:00:{:06.3f} PM",
        "2024-05-01_12:00:{:06.3f}",
        "12:00:{:06.3f} am",
        "2024-05-01 12:00:{:06.3f} UTC",
    ],
)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_dates_and_clock_times_are_times(tmp_path, form, separator):
    text = table(rows_of(TIMES - 100.0, time=form.format), ["time", *PARTS], separator)
    series = read(tmp_path, text)
    assert_quats(series)
    assert_times(series, within_s=1e-5)


@pytest.mark.parametrize("prefix", ["", "header.stamp.", "/imu/header/stamp/", "stamp_"])
@pytest.mark.parametrize(("seconds", "nanoseconds"), [("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec")])
def test_seconds_and_nanoseconds_are_one_time(tmp_path, prefix, seconds, nanoseconds):
    rows = [[f"{t // 1:.0f}", f"{t % 1 * 1e9:.0f}", *row[1:]] for t, row in zip(TIMES + 0.7, rows_of(), strict=True)]
    series = read(tmp_path, table(rows, [prefix + seconds, prefix + nanoseconds, *PARTS]))
    assert_times(series)


def test_an_empty_time_column_is_none(tmp_path):
    rows = [["", *row[1:]] for row in rows_of()]
    with pytest.raises(ReaderError, match="no time stamps; give the sampling rate"):
        read(tmp_path, table(rows, ["SampleTimeFine", *PARTS]))
    assert read(tmp_path, table(rows, ["SampleTimeFine", *PARTS]), rate_hz=50.0).interval_s == pytest.approx(0.02)


# Layouts without names


def raw_sensor(kind, rng):
    quats = files.motion(400)[1].as_quat(scalar_first=True)
    gravity = rotations.rotate(rotations.conjugate(quats), np.array([0.0, 0.0, 1.0]))
    turn = np.gradient(quats[:, 1:], axis=0) * 200.0 * 57.3 + rng.normal(0.0, 0.5, (400, 3))
    scale = {"g": 1.0, "m/s²": 9.81, "mg": 1000.0, "magnetic field": 45.0}[kind]
    return gravity * scale * (1.0 + rng.normal(0.0, 0.004, (400, 1))), turn


@pytest.mark.parametrize("first", ["1", "running", "12"])
@pytest.mark.parametrize("kind", ["g", "m/s²", "mg", "magnetic field"])
@pytest.mark.parametrize("separator", [",", " ", "\t"])
def test_seven_numbers_of_a_bare_sensor_are_no_tracker(tmp_path, separator, kind, first):
    vectors, turn = raw_sensor(kind, np.random.default_rng(4))
    rows = [
        [str(k) if first == "running" else first, *map(number, (*a, *b))]
        for k, (a, b) in enumerate(zip(vectors, turn, strict=True))
    ]
    with pytest.raises(ReaderError, match="columns without names"):
        read(tmp_path, table(rows, None, separator))


@pytest.mark.parametrize("start", [0, 1, 700])
@pytest.mark.parametrize("separator", [",", ", ", " ", "\t"])
def test_a_running_number_in_front_of_a_tracker_s_row(tmp_path, start, separator):
    angles = POSES.as_euler("ZYX", degrees=True)
    rows = [
        [str(start + k), *map(number, (*(p / 0.0254 + 10.0), *a))]
        for k, (p, a) in enumerate(zip(POSITIONS, angles, strict=True))
    ]
    series = read(tmp_path, table(rows, None, separator))
    assert_quats(series, within_rad=1e-6)
    assert series.interval_s == pytest.approx(1 / 240)


@pytest.mark.parametrize("order", [p for p in itertools.permutations("wxyz") if p != tuple("xyzw")][::2])
@pytest.mark.parametrize("mark", ["# ", "#", ""])
def test_the_header_of_a_trajectory_decides_the_order(tmp_path, order, mark):
    quats = QUATS[:, ["wxyz".index(part) for part in order]]
    rows = [[number(t), *map(number, p), *map(number, q)] for t, p, q in zip(TIMES, POSITIONS, quats, strict=True)]
    header = mark + " ".join(["timestamp", "tx", "ty", "tz", *("q" + part for part in order)])
    assert_quats(read(tmp_path, header + "\n" + table(rows, None, " ")))


@pytest.mark.parametrize("unit", ["rad", "deg", None])
@pytest.mark.parametrize("names", [("rx", "ry", "rz"), ("rvec_0", "rvec_1", "rvec_2"), ("a", "b", "c")])
def test_a_rotation_vector_can_be_declared(tmp_path, names, unit):
    vectors = POSES.as_rotvec(degrees=unit == "deg")
    rows = [[number(t), *map(number, v)] for t, v in zip(TIMES, vectors, strict=True)]
    spec = (
        "t=time," + ",".join(f"rv{k + 1}={name}" for k, name in enumerate(names)) + (f",angle={unit}" if unit else "")
    )
    series = read(tmp_path, table(rows, ["time", *names]), columns=spec)
    assert_quats(series)
    assert "rotation vector" in series.convention


@pytest.mark.parametrize("time", ["time", "t", "timestamp", "stamp"])
def test_rx_ry_rz_are_not_taken_for_euler_angles(tmp_path, time):
    rows = [
        [number(t), *map(number, p), *map(number, v)]
        for t, p, v in zip(TIMES, POSITIONS, POSES.as_rotvec(), strict=True)
    ]
    with pytest.raises(ReaderError, match=r"rv1=rx,rv2=ry,rv3=rz .*or t=…,e1=rx"):
        read(tmp_path, table(rows, [time, "tx", "ty", "tz", "rx", "ry", "rz"]))


@pytest.mark.parametrize(
    "names",
    [
        ("yaw", "pitch", "roll"),
        ("Yaw (deg)", "Pitch (deg)", "Roll (deg)"),
        ("heading", "pitch", "roll"),
        ("Euler_X", "Euler_Y", "Euler_Z"),
        ("azimuth", "elevation", "roll"),
        ("psi", "theta", "phi"),
    ],
)
def test_euler_angles_are_asked_for_in_their_form(tmp_path, names):
    rows = [[number(t), *map(number, v)] for t, v in zip(TIMES, POSES.as_euler("ZYX", degrees=True), strict=True)]
    with pytest.raises(ReaderError, match=r"e1=.*,e2=.*,e3=.*angle=deg,euler=intrinsic-zyx"):
        read(tmp_path, table(rows, ["time", *names]))


@pytest.mark.parametrize("form", ["e1=a,e2=b,e3=c,euler=intrinsic-zyx", "rv1=a,rv2=b,rv3=c"])
def test_a_unit_that_gives_impossible_turning_is_refused(tmp_path, form):
    angles = POSES.as_euler("ZYX", degrees=True) * 5.0
    rows = [[number(t), *map(number, v)] for t, v in zip(TIMES, angles, strict=True)]
    with pytest.raises(ReaderError, match=r"turns by .*° a second, which no hand does: is it angle=deg"):
        read(tmp_path, table(rows, ["time", "a", "b", "c"]), columns=f"t=time,{form},angle=rad")


@pytest.mark.parametrize(
    ("magic", "name"),
    [
        (b"\x1f\x8b\x08\0", "gzip"),
        (b"\x28\xb5\x2f\xfd", "zstandard"),
        (b"PK\x03\x04", "zip"),
        (b"\xfd7zXZ\0", "xz"),
        (b"BZh9", "bzip2"),
    ],
)
def test_packed_files_are_named(tmp_path, magic, name):
    path = tmp_path / "a.log.gz"
    path.write_bytes(magic + b"anything")
    with pytest.raises(ReaderError, match=rf"is packed \({name}\): unpack it"):
        read_series(path)
