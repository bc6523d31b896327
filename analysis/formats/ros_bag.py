"""ROS 1 bags, ROS 2 bags (folders, MCAP or db3 storage) and single MCAP files; needs the extra ``rotdrift[ros]``.

Read: sensor_msgs/Imu, geometry_msgs/PoseStamped, QuaternionStamped and TransformStamped, nav_msgs/Odometry. ROS
quaternions are x, y, z, w, Hamilton, child to parent frame (REP 103, REP 145). An Imu without an orientation has −1
in the first element of its covariance.

Written: a folder with MCAP storage, ``PoseStamped`` where positions are known, else ``QuaternionStamped``, object to
``world``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.source import SourceFile, plain
from analysis.formats.time_stamps import RawSamples
from analysis.geometry import rotations
from analysis.series import OrientationSeries, ReaderError, WriterError

ROS1_MAGIC = b"#ROSBAG V2"
MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3"
TOPIC = "/object/orientation"
FRAME = "world"
"""Topic and frame of what is written."""

_LIBRARIES = {"rosbags", "lz4", "backports", "ruamel", "apsw", "bz2", "zlib"}
_DAMAGE = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    TypeError,
    SyntaxError,  # rosbags makes classes of the types in a bag: their names are letters, digits and _ by its grammar
    MemoryError,
    RecursionError,
    struct.error,
)
_REMEDY = "copy it again, or recover it with an MCAP or ROS tool"
_parts = attrgetter("x", "y", "z")
TYPES = {
    "sensor_msgs/msg/Imu": ("orientation", "", "linear_acceleration"),
    "geometry_msgs/msg/PoseStamped": ("pose.orientation", "pose.position", ""),
    "geometry_msgs/msg/QuaternionStamped": ("quaternion", "", ""),
    "geometry_msgs/msg/TransformStamped": ("transform.rotation", "transform.translation", ""),
    "nav_msgs/msg/Odometry": ("pose.pose.orientation", "pose.pose.position", ""),
}
"""Message types that carry an orientation -> where it, the position and the acceleration stand in them."""


def is_mcap(start: bytes) -> bool:
    """Return whether a file is MCAP by its first bytes: a recording of this program, or a ROS 2 bag."""
    return start.startswith(MCAP_MAGIC)


def is_bag(source: SourceFile) -> bool:
    """Return whether a source is a bag or an MCAP file, by the folder's content or the file's first bytes."""
    by_start = source.head.startswith((MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC))
    return by_start or (source.path / "metadata.yaml").is_file()


def read_ros_bag(source: SourceFile, topic: str | None) -> RawSamples:
    """Read the orientations of one topic, which has to be named where several carry some.

    Times are those of the message headers; where these are not set, those of reception, which the notes report.

    Raises
    ------
    ReaderError
        The extra is not installed; no or several topics to choose from (lists them); a damaged bag.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ReaderError("ROS bags need rosbags: pip install 'rotdrift[ros]'") from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    try:
        with AnyReader([source.path], default_typestore=store) as reader:
            name, kind = _choose({t: info.msgtype for t, info in reader.topics.items()}, topic, source.name)
            connections = [c for c in reader.connections if c.topic == name]
            messages = (
                (stamp_ns, reader.deserialize(data, connection.msgtype))
                for connection, stamp_ns, data in reader.messages(connections=connections)
            )
            return _collect(messages, kind, source.name, f"{name} ({kind})")
    except ReaderError:
        raise
    except AnyReaderError as error:
        what = plain(str(error), 160).rstrip(".")
        raise ReaderError(f"{source.name} cannot be read as a bag ({what}): {_REMEDY}") from error
    except Exception as error:
        # Damaged bags raise a dozen kinds of errors out of rosbags and the libraries below it; our own are let through.
        from_library = type(error).__module__.split(".")[0] in _LIBRARIES
        if from_library or isinstance(error, _DAMAGE):
            what = f" ({plain(str(error), 160)})" if from_library else ""  # Python's own text explains nothing
            raise ReaderError(f"{source.name} is damaged or cut off{what}: {_REMEDY}") from error
        raise


def _choose(topics: dict[str, str | None], topic: str | None, source: str) -> tuple[str, str]:
    usable = {name: kind for name, kind in topics.items() if kind in TYPES}
    listed = ", ".join(f"{plain(name)} ({kind})" for name, kind in sorted(usable.items())) or "none"
    if topic is not None:
        if topic not in usable:
            raise ReaderError(f"no orientations on topic '{plain(topic)}'; topics that have them: {listed}")
        return topic, str(usable[topic])
    if not usable:
        raise ReaderError(f"{source} has no topic with orientations: record one of {', '.join(sorted(TYPES))}")
    if len(usable) > 1:
        raise ReaderError(f"several topics have orientations; choose with --topic: {listed}")
    (name, kind), *_ = usable.items()
    return name, str(kind)


def _collect(messages: Iterator[tuple[int, Any]], kind: str, source: str, what: str) -> RawSamples:
    times, received, quats, positions, accelerations = [], [], [], [], []
    frames: set[tuple[str, str]] = set()
    orientation_of, position_of, acceleration_of = (attrgetter(field) if field else None for field in TYPES[kind])
    assert orientation_of is not None
    for stamp_ns, message in messages:
        if getattr(message, "orientation_covariance", (0.0,))[0] == -1.0:
            raise ReaderError(
                "the sensor gives no orientation, as its orientation_covariance shows; run an orientation filter, such "
                "as imu_filter_madgwick, and record its topic"
            )
        quat = orientation_of(message)
        header = message.header.stamp
        # Whole seconds since the epoch keep 0.2 us in a double; that is enough for cycles of seconds.
        times.append(header.sec + header.nanosec * 1e-9)
        received.append(stamp_ns * 1e-9)
        quats.append((quat.w, quat.x, quat.y, quat.z))
        if position_of is not None:
            positions.append(_parts(position_of(message)))
        if acceleration_of is not None:
            accelerations.append(_parts(acceleration_of(message)))
        frames.add((str(message.header.frame_id), str(getattr(message, "child_frame_id", ""))))
    if not quats:
        raise ReaderError(f"topic {plain(what, 80)} of {source} has no messages")
    notes, warnings = [f"topic {plain(what, 120)}"], []
    times_s = np.array(times)
    if len(times) > 1 and len(np.unique(times_s)) < 2:
        times_s = np.array(received)
        notes.append("message headers carry no time; times of reception used")
    if len(frames) > 1:
        named = ", ".join(sorted(plain("→".join(filter(None, pair))) or "(unnamed)" for pair in frames))
        warnings.append(f"the topic mixes several frames ({plain(named, 120)}); record one object per topic")
    return RawSamples(
        quats_wxyz=np.array(quats, dtype=np.float64),
        times_s=times_s,
        positions_m=np.array(positions, dtype=np.float64) if positions else None,
        accelerations_mps2=np.array(accelerations, dtype=np.float64) if accelerations else None,
        convention=f"ROS {kind}: quaternion x,y,z,w, Hamilton, body to world",
        notes=tuple(notes),
        warnings=tuple(warnings),
    )


def write_ros_bag(series: OrientationSeries, _result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a ROS 2 bag; message times are the recording's own.

    Raises
    ------
    WriterError
        The extra is not installed, times are before 1970, or the name is that of a ROS 1 bag.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise WriterError("ROS bags need rosbags: pip install 'rotdrift[ros]'") from error
    if path.suffix.lower() == ".bag":
        raise WriterError(
            "a name in .bag means ROS 1, and readers would take it so; leave the ending off: a ROS 2 bag is a folder"
        )
    if len(series) and series.times_s[0] < 0:
        raise WriterError("a ROS time cannot be negative")
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    with_positions = series.positions_m is not None
    kind = "geometry_msgs/msg/PoseStamped" if with_positions else "geometry_msgs/msg/QuaternionStamped"
    quaternion, point = types["geometry_msgs/msg/Quaternion"], types["geometry_msgs/msg/Point"]
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    nanoseconds = [round(time_s * 1e9) for time_s in series.times_s.tolist()]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection(TOPIC, kind, typestore=store)
        for row, (at_ns, parts) in enumerate(
            zip(nanoseconds, rotations.to_xyzw(series.quats_wxyz).tolist(), strict=True)
        ):
            head = header(stamp(*divmod(at_ns, 10**9)), FRAME)
            body: Any = quaternion(*parts)
            if series.positions_m is not None:
                body = types["geometry_msgs/msg/Pose"](point(*series.positions_m[row].tolist()), body)
            bag.write(connection, at_ns, store.serialize_cdr(types[kind](head, body), kind))
    return ()
