"""Every text format against the motion that the file was written from."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.formats import ReaderError, is_mcap, read_series
from analysis.geometry import rotations
from tests import reader_files as files


def assert_poses(series, poses, tolerance_rad=1e-9):
    expected = poses.as_quat(scalar_first=True)
    assert rotations.distance(series.quats_wxyz, expected).max() < tolerance_rad


@pytest.mark.parametrize("quaternion", [False, True])
def test_t42(tmp_path, quaternion):
    times, poses, positions = files.t42(tmp_path / "a.csv", quaternion=quaternion)
    series = read_series(tmp_path / "a.csv")
    assert_poses(series, poses)
    np.testing.assert_allclose(series.times_s, times, atol=0)
    np.testing.assert_allclose(series.positions_m, positions, atol=0)
    assert series.index.tolist() == list(range(400))
    assert "extrinsic x-y-z" in series.convention
    assert series.warnings == ()
    assert any("agree" in note for note in series.notes) == quaternion


@pytest.mark.parametrize("quaternion", [["0", "0", "0", "1"], ["1e308", "1e308", "0", "0"], ["0", "0", "0", "0"]])
def test_t42_whose_quaternion_disagrees(tmp_path, quaternion):
    path = tmp_path / "a.csv"
    files.t42(path, quaternion=True)
    lines = path.read_text().splitlines()
    cells = lines[1].split(",")
    cells[8:12] = quaternion
    path.write_text("\n".join([lines[0], ",".join(cells), *lines[2:]]))
    assert any("differ by up to" in warning for warning in read_series(path).warnings)


def test_t42_in_degrees_is_suspected(tmp_path):
    files.t42(tmp_path / "a.csv", degrees=True)
    assert any("degrees" in warning for warning in read_series(tmp_path / "a.csv").warnings)


@pytest.mark.parametrize("trailing_comma", [True, False])
def test_ndx_whatever_its_name(tmp_path, trailing_comma):
    path = tmp_path / "T42_cube_power_GR_1.csv"  # as one of the authors' files is called
    times, poses, positions = files.ndx(path, trailing_comma=trailing_comma)
    series = read_series(path)
    assert_poses(series, poses)
    np.testing.assert_allclose(series.positions_m, positions, atol=1e-12)
    assert series.interval_s == pytest.approx(1 / 240)
    assert not series.times_measured
    assert any("240 Hz, assumed" in note for note in series.notes)
    assert "intrinsic z-y-x" in series.convention
    given = read_series(path, rate_hz=100.0)
    np.testing.assert_allclose(given.times_s, times - 100.0, atol=1e-9)
    assert any("100 Hz, as given" in note for note in given.notes)


def test_tum(tmp_path):
    times, poses, positions = files.tum(tmp_path / "trajectory.txt")
    series = read_series(tmp_path / "trajectory.txt")
    assert_poses(series, poses)
    np.testing.assert_allclose(series.times_s, times, atol=0)
    np.testing.assert_allclose(series.positions_m, positions, atol=0)


def test_ximu3_with_accelerometer_beside_it(tmp_path):
    times, poses, _ = files.motion()
    quats = poses.as_quat(scalar_first=True)
    up = poses.inv().apply([0.0, 0.0, 1.0])
    stamps = np.round(times * 1e6)
    (tmp_path / "Quaternion.csv").write_text(
        files.rows_text(np.column_stack((stamps, quats)), "Timestamp (us),W,X,Y,Z")
    )
    gyro = np.zeros((len(times), 3))
    (tmp_path / "Inertial.csv").write_text(
        files.rows_text(
            np.column_stack((stamps, gyro, up)),
            "Timestamp (us),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),"
            "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)",
        )
    )
    series = read_series(tmp_path / "Quaternion.csv")
    assert_poses(series, poses)
    np.testing.assert_allclose(series.times_s, times, atol=1e-6)
    np.testing.assert_allclose(series.accelerations_mps2, 9.80665 * up, atol=1e-9)
    assert series.warnings == ()
    with pytest.raises(ReaderError, match=r"give the Quaternion\.csv"):
        read_series(tmp_path / "Inertial.csv")
    (tmp_path / "Inertial.csv").write_text("broken")
    assert read_series(tmp_path / "Quaternion.csv").accelerations_mps2 is None


@pytest.mark.parametrize("header", ["time,w,x,y,z", "timestamp,qw,qx,qy,qz", "t (s),q_w,q_x,q_y,q_z", "time_s,W,X,Y,Z"])
def test_names_that_need_no_declaration(tmp_path, header):
    _, poses, _ = files.named(tmp_path / "a.csv", header)
    series = read_series(tmp_path / "a.csv")
    assert_poses(series, poses)
    assert any("recognised by their names" in note for note in series.notes)


def test_time_unit_in_the_name(tmp_path):
    times, _, _ = files.motion()
    files.named(tmp_path / "a.csv", "time_ms,qw,qx,qy,qz", times=times * 1e3)
    np.testing.assert_allclose(read_series(tmp_path / "a.csv").times_s, times, atol=1e-9)


@pytest.mark.parametrize("header", ["time,w,x,y,z,w", "time,a,b,c,d", "time,qw,qx,qy,x2"])
def test_names_that_do(tmp_path, header):
    poses = files.motion()[1].as_quat(scalar_first=True)
    extra = np.column_stack((poses, poses[:, :1])) if header.count(",") == 5 else poses
    files.named(tmp_path / "a.csv", header, quats=extra)
    with pytest.raises(ReaderError, match="name the columns with --columns"):
        read_series(tmp_path / "a.csv")


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_declared_columns_in_any_order(tmp_path, delimiter):
    path = tmp_path / "a.csv"
    times, poses, _ = files.named(path, "when,d,a,b,c", quats=files.motion()[1].as_quat()[:, [3, 0, 1, 2]])
    path.write_text(path.read_text().replace(",", delimiter))
    series = read_series(path, columns="t=when,qx=a,qy=b,qz=c,qw=d")
    assert_poses(series, poses)
    np.testing.assert_allclose(series.times_s, times)
    assert "Hamilton" in series.convention
    assert "w,x,y,z = d,a,b,c" in series.convention


def test_columns_by_number_without_header(tmp_path):
    path = tmp_path / "a.csv"
    _, poses, _ = files.named(path)
    path.write_text("\n".join(path.read_text().splitlines()[1:]))
    assert_poses(read_series(path, columns="t=#0,qw=#1,qx=#2,qy=#3,qz=#4"), poses)
    assert len(read_series(path, columns="qw=#1,qx=#2,qy=#3,qz=#4", rate_hz=50.0)) == 400


@pytest.mark.parametrize("kind", ["intrinsic", "extrinsic"])
@pytest.mark.parametrize("order", ["zyx", "xyz", "zxz"])
@pytest.mark.parametrize(("unit", "maps"), [("deg", "body-to-world"), ("rad", "world-to-body")])
def test_declared_euler_angles(tmp_path, kind, order, unit, maps):
    times, poses, _ = files.motion()
    poses = Rotation.from_rotvec([0.1, 0.9, 0.2]) * poses  # away from the poles of every order
    declared = poses if maps == "body-to-world" else poses.inv()
    angles = declared.as_euler(order.upper() if kind == "intrinsic" else order, degrees=unit == "deg")
    path = tmp_path / "a.csv"
    path.write_text(files.rows_text(np.column_stack((times, angles)), "ts,a,b,c"))
    series = read_series(path, columns=f"t=ts,e1=a,e2=b,e3=c,euler={kind}-{order},angle={unit},maps={maps}")
    assert_poses(series, poses)
    assert f"Euler {kind} {'-'.join(order)}" in series.convention


def test_positions_accelerations_and_units(tmp_path):
    times, poses, positions = files.motion()
    up = poses.inv().apply([0, 0, 1.0])
    quats = poses.as_quat(scalar_first=True)
    path = tmp_path / "a.csv"
    table = np.column_stack((times * 1e9, quats, positions * 1e3, up))
    path.write_text(files.rows_text(table, "t,w,x,y,z,a,b,c,d,e,f"))
    columns = "t=t,qw=w,qx=x,qy=y,qz=z,px=a,py=b,pz=c,ax=d,ay=e,az=f,time=ns,length=mm,accel=g"
    series = read_series(path, columns=columns)
    np.testing.assert_allclose(series.positions_m, positions, atol=1e-12)
    np.testing.assert_allclose(series.times_s, times, atol=1e-6)
    np.testing.assert_allclose(series.accelerations_mps2, up * 9.80665, atol=1e-12)
    assert series.warnings == ()


@pytest.mark.parametrize(
    ("unit", "per_si"),
    [
        *[("length=" + name, per) for name, per in (("m", 1.0), ("cm", 100.0), ("mm", 1000.0), ("inch", 1 / 0.0254))],
        *[("time=" + name, per) for name, per in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9))],
    ],
)
def test_every_unit(tmp_path, unit, per_si):
    times, poses, positions = files.motion()
    length, time = (per_si, 1.0) if unit.startswith("length") else (1.0, per_si)
    table = np.column_stack((times * time, poses.as_quat(scalar_first=True), positions * length))
    (tmp_path / "a.csv").write_text(files.rows_text(table, "t,w,x,y,z,a,b,c"))
    series = read_series(tmp_path / "a.csv", columns="t=t,qw=w,qx=x,qy=y,qz=z,px=a,py=b,pz=c," + unit)
    np.testing.assert_allclose(series.positions_m, positions, rtol=1e-12)
    np.testing.assert_allclose(series.times_s, times, atol=1e-6)


def test_world_to_body_and_jpl(tmp_path):
    _, poses, _ = files.motion()
    own, inverse = poses.as_quat(scalar_first=True), poses.inv().as_quat(scalar_first=True)
    base = "t=time,qw=w,qx=x,qy=y,qz=z"
    for quats, more in (
        (own, ",product=hamilton,maps=body-to-world"),
        (inverse, ",maps=world-to-body"),
        # JPL: C(q) = R(q)ᵀ, so the numbers of a JPL quaternion that maps world to body are those of `own`.
        (own, ",product=jpl,maps=world-to-body"),
        (inverse, ",product=jpl,maps=body-to-world"),
    ):
        files.named(tmp_path / "a.csv", quats=quats)
        series = read_series(tmp_path / "a.csv", columns=base + more)
        assert_poses(series, poses)
    assert "JPL, body to world" in series.convention


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("t=time", "needs either qw"),
        ("qw=w,qx=x,qy=y", "qz missing"),
        ("qw=w,qx=x,qy=y,qz=z,e1=a", "either qw"),
        ("qw=w,qx=x,qy=y,qz=z,px=a", "py, pz missing"),
        ("qw=w,qx=x,qy=y,qz=nope", "no column 'nope' for qz; the file has time, w, x, y, z"),
        ("qw=w,qx=x,qy=y,qz=#9", "#0 to #4"),
        ("qw=w,qw=x", "given twice"),
        ("foo=w", "unknown key 'foo'"),
        ("qw", "not key=value"),
        ("qw=w,qx=x,qy=y,qz=z,time=h", "time=h is not one of s, ms, us, ns"),
        ("qw=w,qx=x,qy=y,qz=z,product=jpl", "needs maps="),
        ("qw=w,qx=x,qy=y,qz=z,euler=intrinsic-zyx", "euler=intrinsic-zyx describes e1, which is not there"),
        ("qw=w,qx=x,qy=y,qz=z,angle=deg", "describes e1, which is not there"),
        ("qw=w,qx=x,qy=y,qz=z,length=mm", "describes px, which is not there"),
        ("qw=w,qx=x,qy=y,qz=z,accel=g", "describes ax, which is not there"),
        ("qw=w,qx=x,qy=y,qz=z,time=ms", "describes t, which is not there"),
        ("e1=w,e2=x,e3=y,euler=intrinsic-zyx,angle=deg,product=jpl", "describes qw, which is not there"),
        ("e1=w,e2=x,e3=y", "need euler="),
        ("e1=w,e2=x,e3=y,euler=zyx,angle=deg", "need euler="),
        ("e1=w,e2=x,e3=y,euler=intrinsic-zzx,angle=deg", "need euler="),
        ("e1=w,e2=x,e3=y,euler=intrinsic-zyx", "need angle="),
    ],
)
def test_declarations_that_do_not_work(tmp_path, columns, message):
    files.named(tmp_path / "a.csv")
    with pytest.raises(ReaderError, match=message):
        read_series(tmp_path / "a.csv", columns=columns)


def test_two_columns_of_one_name(tmp_path):
    poses = files.motion()[1].as_quat(scalar_first=True)
    files.named(tmp_path / "a.csv", "t,w,x,x,z", quats=poses)
    with pytest.raises(ReaderError, match="two columns are called 'x'"):
        read_series(tmp_path / "a.csv", columns="qw=w,qx=x,qy=x,qz=z")


@pytest.mark.parametrize("text", ["\ufeff{}", "{}\r\n"])
def test_byte_order_mark_line_ends_and_blank_lines(tmp_path, text):
    path = tmp_path / "a.csv"
    _, poses, _ = files.t42(path)
    content = path.read_text()
    crlf = content.replace("\n", "\r\n").replace("\r\n3,", "\r\n\r\n3,", 1)
    path.write_bytes(text.format("\r\n" + crlf).encode())
    assert_poses(read_series(path), poses)
    files.ndx(path)
    path.write_bytes(b"\xef\xbb\xbf\n" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert len(read_series(path)) == 400


def test_mcap_is_told_apart(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bytes(20))
    assert is_mcap(path.read_bytes())
    files.ndx(path)
    assert not is_mcap(path.read_bytes())
