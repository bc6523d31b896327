"""ROS 1 and ROS 2 bags, MCAP and parquet, written by the formats' own libraries."""

import numpy as np
import pytest

from analysis.formats import ReaderError, SourceFile, read_series
from analysis.formats.ros_bag import read_ros_bag
from analysis.formats.rows.streams import StreamChoice
from analysis.geometry import rotations
from tests import reader_files as files

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="the extra rotdrift[ros] is not installed")
rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="the extra rotdrift[ros] is not installed")
typesys = pytest.importorskip("rosbags.typesys")

KINDS = [
    "sensor_msgs/msg/Imu",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/QuaternionStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
]


def message(types, kind, k, time_s, quat, position, ros1, stamped=True, frame="world", covariance=0.0):
    sec, nanosec = divmod(round(time_s * 1e9), 10**9) if stamped else (0, 0)
    stamp = types["builtin_interfaces/msg/Time"](sec, nanosec)
    header = types["std_msgs/msg/Header"](*([k] if ros1 else []), stamp, frame)
    q = types["geometry_msgs/msg/Quaternion"](*(float(v) for v in quat))
    point = types["geometry_msgs/msg/Point"](*(float(v) for v in position))
    vector = types["geometry_msgs/msg/Vector3"](*(float(v) for v in position))
    nine, thirty_six = np.zeros(9), np.zeros(36)
    pose = types["geometry_msgs/msg/Pose"](point, q)
    if kind.endswith("Imu"):
        return types[kind](header, q, np.full(9, covariance), vector, nine, vector, nine)
    if kind.endswith("PoseStamped"):
        return types[kind](header, pose)
    if kind.endswith("QuaternionStamped"):
        return types[kind](header, q)
    if kind.endswith("TransformStamped"):
        return types[kind](header, "object", types["geometry_msgs/msg/Transform"](vector, q))
    twist = types["geometry_msgs/msg/Twist"](vector, vector)
    return types[kind](
        header,
        "object",
        types["geometry_msgs/msg/PoseWithCovariance"](pose, thirty_six),
        types["geometry_msgs/msg/TwistWithCovariance"](twist, thirty_six),
    )


def write(path, kinds, ros1=False, storage=None, n=60, **more):
    """Write one topic per kind; return the motion."""
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.ROS2_HUMBLE)
    times, poses, positions = files.motion(n)
    if ros1:
        writer = rosbag1.Writer(path)
    else:
        writer = rosbag2.Writer(path, version=9, storage_plugin=storage or rosbag2.StoragePlugin.SQLITE3)
    with writer:
        for number, kind in enumerate(kinds):
            connection = writer.add_connection(f"/topic{number}", kind, typestore=store)
            for k, (t, q, p) in enumerate(zip(times, poses.as_quat(), positions, strict=True)):
                made = message(store.types, kind, k, t, q, p, ros1, **more)
                data = store.serialize_ros1(made, kind) if ros1 else store.serialize_cdr(made, kind)
                writer.write(connection, round(t * 1e9) + 5_000_000, data)
    return times, poses, positions


def assert_motion(series, times, poses, positions, with_positions=True):
    np.testing.assert_allclose(series.times_s, times, atol=1e-6)
    assert rotations.distance(series.quats_wxyz, poses.as_quat(scalar_first=True)).max() < 1e-9
    if with_positions:
        np.testing.assert_allclose(series.positions_m, positions, atol=1e-12)
    else:
        assert series.positions_m is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ros1", [True, False])
def test_every_message_type(tmp_path, kind, ros1):
    path = tmp_path / ("trial.bag" if ros1 else "trial")
    motion = write(path, [kind], ros1)
    series = read_series(path)
    assert_motion(
        series, *motion, with_positions=kind.split("/")[-1] in ("PoseStamped", "TransformStamped", "Odometry")
    )
    assert kind in series.convention
    assert (series.accelerations_mps2 is not None) == kind.endswith("Imu")


def test_mcap_storage_as_folder_and_as_bare_file(tmp_path):
    motion = write(tmp_path / "trial", [KINDS[1]], storage=rosbag2.StoragePlugin.MCAP)
    assert_motion(read_series(tmp_path / "trial"), *motion)
    (bare,) = (tmp_path / "trial").glob("*.mcap")
    assert_motion(read_series(bare), *motion)


def test_a_bare_database(tmp_path):
    motion = write(tmp_path / "trial", [KINDS[1]])
    (bare,) = (tmp_path / "trial").glob("*.db3")
    assert_motion(read_series(bare), *motion)


def test_several_topics_need_a_choice(tmp_path):
    motion = write(tmp_path / "trial.bag", KINDS[:2], ros1=True)
    with pytest.raises(ReaderError, match=r"choose with --topic: /topic0 \(sensor_msgs/msg/Imu\), /topic1"):
        read_series(tmp_path / "trial.bag")
    assert_motion(read_series(tmp_path / "trial.bag", topic="/topic1"), *motion)
    with pytest.raises(ReaderError, match=r"no orientations on topic '/else'; topics that have them: /topic0"):
        read_series(tmp_path / "trial.bag", topic="/else")


def test_headers_without_time_fall_back_on_reception(tmp_path):
    times, *_ = write(tmp_path / "trial", [KINDS[2]], stamped=False)
    series = read_series(tmp_path / "trial")
    np.testing.assert_allclose(series.times_s, times + 0.005, atol=1e-6)
    assert any("times of reception" in note for note in series.notes)


def test_an_imu_that_gives_no_orientation_is_refused(tmp_path):
    write(tmp_path / "trial", [KINDS[0]], covariance=-1.0)
    with pytest.raises(ReaderError, match="the sensor gives no orientation, as its orientation_covariance shows"):
        read_series(tmp_path / "trial")


def test_a_bag_without_orientations(tmp_path):
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with rosbag2.Writer(tmp_path / "trial", version=9) as writer:
        writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
    with pytest.raises(ReaderError, match="has no topic with orientations"):
        read_series(tmp_path / "trial")


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95])
@pytest.mark.parametrize("storage", ["ros1", "mcap", "db3"])
def test_cut_bags_are_refused_in_one_sentence(tmp_path, storage, share):
    if storage == "ros1":
        path = tmp_path / "trial.bag"
        write(path, [KINDS[0]], ros1=True)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if storage == "mcap" else rosbag2.StoragePlugin.SQLITE3
        write(tmp_path / "trial", [KINDS[0]], storage=plugin)
        (path,) = (tmp_path / "trial").glob(f"*.{storage}")
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(ReaderError) as refused:
        read_series(path)
    assert len(str(refused.value)) < 400
    assert "\n" not in str(refused.value)


def test_random_bytes_after_a_magic_are_refused(tmp_path):
    rng = np.random.default_rng(1)
    for magic, suffix in ((b"#ROSBAG V2.0\n", ".bag"), (b"\x89MCAP0\r\n", ".mcap"), (b"SQLite format 3\0", ".db3")):
        for _ in range(20):
            path = tmp_path / f"x{suffix}"
            path.write_bytes(magic + rng.bytes(400))
            with SourceFile(path) as source, pytest.raises(ReaderError):
                read_ros_bag(source, None, StreamChoice())  # here: a process for each would take a minute


# Parquet


def parquet_table(n=60, names=("time_s", "qw", "qx", "qy", "qz")):
    pyarrow = pytest.importorskip("pyarrow", reason="the extra rotdrift[parquet] is not installed")
    times, poses, _ = files.motion(n)
    columns = [times, *poses.as_quat(scalar_first=True).T]
    return pyarrow, dict(zip(names, columns, strict=True)), times, poses


def save(pyarrow, columns, path):
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(columns), path)


def test_parquet_by_names_and_by_declaration(tmp_path):
    pyarrow, columns, times, poses = parquet_table()
    save(pyarrow, columns, tmp_path / "a.parquet")
    assert_motion(read_series(tmp_path / "a.parquet"), times, poses, None, with_positions=False)
    renamed = dict(zip("abcde", columns.values(), strict=True))
    save(pyarrow, renamed | {"text": ["x"] * 60}, tmp_path / "b.parquet")
    series = read_series(tmp_path / "b.parquet", columns="t=a,qw=b,qx=c,qy=d,qz=e")
    assert_motion(series, times, poses, None, with_positions=False)
    with pytest.raises(ReaderError, match=r"name the columns .* the file has a, b, c, d, e, text"):
        read_series(tmp_path / "b.parquet")
    with pytest.raises(ReaderError, match=r"column text .* does not hold numbers"):
        read_series(tmp_path / "b.parquet", columns="t=text,qw=b,qx=c,qy=d,qz=e")


def test_parquet_with_a_hole(tmp_path):
    pyarrow, columns, _, _ = parquet_table()
    columns["qx"] = [*columns["qx"][:7].tolist(), None, *columns["qx"][8:].tolist()]
    save(pyarrow, columns, tmp_path / "a.parquet")
    series = read_series(tmp_path / "a.parquet")
    assert 7 not in series.index.tolist()
    assert any(
        "1 of " in note and "have no orientation and are left out" in note for note in (*series.notes, *series.warnings)
    )


def test_parquet_without_rows_or_cut(tmp_path):
    pyarrow, columns, _, _ = parquet_table()
    save(pyarrow, {name: column[:0] for name, column in columns.items()}, tmp_path / "a.parquet")
    with pytest.raises(ReaderError, match="has no data rows"):
        read_series(tmp_path / "a.parquet")
    save(pyarrow, columns, tmp_path / "b.parquet")
    data = (tmp_path / "b.parquet").read_bytes()
    (tmp_path / "b.parquet").write_bytes(data[: len(data) // 2])
    with pytest.raises(ReaderError, match="not a sound parquet file"):
        read_series(tmp_path / "b.parquet")
