"""The authors' layouts as other programs and other days write them: the motion read must be the same."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.formats import ReaderError, read_series
from analysis.geometry import rotations
from tests import reader_files as files

NAMES = ",ts,tx,ty,tz,rx,ry,rz,qx,qy,qz,qw,motor0,motor1"


def assert_motion(path, **how):
    _, poses, positions = files.motion()
    series = read_series(path, **how)
    assert rotations.distance(series.quats_wxyz, poses.as_quat(scalar_first=True)).max() < 1e-9
    np.testing.assert_allclose(series.positions_m, positions, atol=1e-12)
    return series


def rewritten(path, change):
    lines = path.read_text().splitlines()
    path.write_text("\n".join(change(lines)) + "\n")


def columns(lines, *wanted):
    rows = [line.split(",") for line in lines]
    places = [rows[0].index(name) for name in wanted]
    return [",".join(row[k] for k in places) for row in rows]


def header(old, new):
    return lambda lines: [lines[0].replace(old, new), *lines[1:]]


T42_VARIANTS = {
    "no index": lambda x: columns(x, *NAMES.split(",")[1:]),
    "no motors": lambda x: columns(x, *NAMES.split(",")[:-2]),
    "reversed": lambda x: columns(x, *NAMES.split(",")[::-1]),
    "no quaternion": lambda x: columns(x, "", "ts", "tx", "ty", "tz", "rx", "ry", "rz", "motor0"),
    "upper case": lambda x: [x[0].upper(), *x[1:]],
    "spaces": lambda x: [x[0].replace(",", ", "), *x[1:]],
    "quotes": lambda x: [",".join(f'"{cell}"' for cell in line.split(",")) for line in x],
    "time": header("ts", "Time"),
    "units": lambda x: [x[0].replace("ts", "ts (s)").replace("rx", "rx [rad]").replace("ty", "ty (m)"), *x[1:]],
    "trailing commas in the rows": lambda x: [x[0], *(line + "," for line in x[1:])],
    "semicolons": lambda x: [line.replace(",", ";") for line in x],
    "tabs": lambda x: [line.replace(",", "\t") for line in x],
    "comments": lambda x: ["# recorded on a Tuesday", "", *x[:7], "# a remark", *x[7:]],
    "header in a comment": lambda x: ["# first trial", "# " + x[0], *x[1:]],
    "blank lines": lambda x: ["", " ", *x[:5], "", *x[5:], "  ", ",,,,,,,,,,,,,", "\0\0", "\x1a"],
    "line ends of DOS": lambda x: [line + "\r" for line in x],
    "motors without values": lambda x: [x[0], *(line.rsplit(",", 2)[0] + ",,nan" for line in x[1:])],
}


@pytest.mark.parametrize("variant", T42_VARIANTS)
def test_t42_written_otherwise(tmp_path, variant):
    path = tmp_path / "T42_cube_power_GR_1.csv"
    files.t42(path, quaternion=True)
    rewritten(path, T42_VARIANTS[variant])
    series = assert_motion(path)
    assert "extrinsic x-y-z" in series.convention
    assert series.warnings == ()
    assert series.index.tolist() == list(range(400))


def test_t42_with_angles_in_degrees_by_its_header_is_not_read_as_radians(tmp_path):
    files.t42(tmp_path / "a.csv", degrees=True)
    rewritten(tmp_path / "a.csv", lambda x: [x[0].replace("rx", "rx (deg)"), *x[1:]])
    with pytest.raises(ReaderError, match="name the columns with --columns"):
        read_series(tmp_path / "a.csv")


def test_t42_whose_quaternion_has_holes_is_read_by_its_angles(tmp_path):
    path = tmp_path / "a.csv"
    files.t42(path, quaternion=True)
    rewritten(path, lambda x: [*x[:9], ",".join([*x[9].split(",")[:8], "", "", "", "", "1", "2"]), *x[10:]])
    series = assert_motion(path)
    assert any("not compared" in warning and "line 10" in warning for warning in series.warnings)


@pytest.mark.parametrize("ends", ["\r\n", "\r\r\n", "\r"])
@pytest.mark.parametrize("write", [files.t42, files.ndx, files.named, files.tum])
def test_line_ends_of_any_system(tmp_path, write, ends):
    path = tmp_path / "a.csv"
    write(path)
    whole = read_series(path)
    path.write_bytes(path.read_bytes().replace(b"\n", ends.encode()))
    series = read_series(path)
    np.testing.assert_array_equal(series.quats_wxyz, whole.quats_wxyz)
    assert series.notes == whole.notes


NDX_VARIANTS = {
    "no trailing comma": lambda x: [line.rstrip(",") for line in x],
    "some trailing commas": lambda x: [line.rstrip(",") if k % 3 else line for k, line in enumerate(x)],
    "two trailing commas": lambda x: [line + "," for line in x],
    "station 12": lambda x: ["12" + line[1:] for line in x],
    "station as 1.0": lambda x: ["1.0" + line[1:] for line in x],
    "white space": lambda x: [line.replace(",", " ") for line in x],
    "tabs": lambda x: [line.replace(",", "\t") for line in x],
    "semicolons": lambda x: [line.replace(",", ";") for line in x],
    "quotes": lambda x: [",".join(f'"{cell}"' for cell in line.rstrip(",").split(",")) for line in x],
    "exponents": lambda x: [",".join(f"{float(c):.15e}" for c in line.rstrip(",").split(",")) for line in x],
    "header": lambda x: ["Station, X, Y, Z, Azimuth, Elevation, Roll,", *x],
    "blank lines": lambda x: ["", *x, "", "   ", ",,,,,,,"],
}


@pytest.mark.parametrize("variant", NDX_VARIANTS)
def test_ndx_written_otherwise(tmp_path, variant):
    path = tmp_path / "a.csv"
    files.ndx(path)
    rewritten(path, NDX_VARIANTS[variant])
    series = assert_motion(path)
    assert series.interval_s == pytest.approx(1 / 240)
    assert series.warnings == ()


def test_ndx_of_whole_numbers(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("".join(f"1, 10, 3, 4, {k % 20}, -9, 151,\n" for k in range(60)))
    series = read_series(path)
    angles = Rotation.from_euler("ZYX", [3, -9, 151], degrees=True).as_quat(scalar_first=True)
    assert rotations.distance(series.quats_wxyz[3], angles) < 1e-12


@pytest.mark.parametrize("moving", [1, 2])
def test_of_several_stations_the_one_that_turns_is_taken(tmp_path, moving):
    path = tmp_path / "a.csv"
    files.ndx(path)
    still = f"{3 - moving}, 10.0, 3.0, 3.0, 10.0, 20.0, 30.0,"
    rewritten(path, lambda x: [row for line in x for row in (f"{moving}{line[1:]}", still)])
    series = assert_motion(path)
    assert series.index.tolist() == list(range(0, 800, 2))
    assert any(f"stations 1, 2; {moving}, which turns most" in warning for warning in series.warnings)
    assert_motion(path, topic=str(moving))
    assert np.ptp(read_series(path, topic=str(3 - moving)).quats_wxyz, axis=0).max() == 0.0
    with pytest.raises(ReaderError, match="no station 7 in the file; --topic takes one of 1, 2"):
        read_series(path, topic="7")


def test_a_few_rows_of_another_station_do_not_count(tmp_path):
    path = tmp_path / "a.csv"
    files.ndx(path)
    rewritten(path, lambda x: [*x[:200], "2, 0, 0, 0, 0, 0, 0,", "2, 0, 0, 0, 170, 0, 90,", *x[200:]])
    assert len(assert_motion(path)) == 400


def test_a_damaged_station_is_named(tmp_path):
    path = tmp_path / "a.csv"
    files.ndx(path)
    rewritten(path, lambda x: [*x[:100], "1.5" + x[100][1:], *x[101:]])
    with pytest.raises(ReaderError, match=r"row 100: 1\.5 is not a valid station"):
        read_series(path)


def test_ndx_in_radians_is_suspected(tmp_path):
    _, poses, positions = files.motion()
    path = tmp_path / "a.csv"
    table = np.column_stack((np.ones(400), positions / 0.0254, poses.as_euler("ZYX")))
    path.write_text("\n".join("1," + ",".join(f"{v:.9f}" for v in row[1:]) for row in table))
    assert any("are they radians" in warning for warning in read_series(path).warnings)


def test_a_decimal_comma_is_named(tmp_path):
    path = tmp_path / "a.csv"
    files.named(path)
    path.write_text(path.read_text().replace(",", ";").replace(".", ","))
    with pytest.raises(ReaderError, match=r"line 2: '100,0' is not a number in column time; .* decimal points"):
        read_series(path)


def test_columns_that_numpy_named(tmp_path):
    times, poses, _ = files.motion()
    table = np.column_stack((times, poses.as_quat(scalar_first=True)))
    for delimiter in (",", " ", "\t"):
        path = tmp_path / "a.csv"
        np.savetxt(
            path, table, delimiter=delimiter, header=delimiter.join(["time", "qw", "qx", "qy", "qz"]), fmt="%.17g"
        )
        series = read_series(path)
        assert rotations.distance(series.quats_wxyz, table[:, 1:]).max() < 1e-9
        np.testing.assert_allclose(series.times_s, times, atol=0)
