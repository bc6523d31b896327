"""ROS 1 bags, ROS 2 bags (folders, MCAP or db3 storage) and single MCAP files; needs the extra ``rotdrift[ros]``.

Read: what :mod:`analysis.formats.ros.messages` lists. MCAP is read with its own library, the others with rosbags.

Written: a folder with MCAP storage, ``PoseStamped`` where positions are known, else ``QuaternionStamped``, object to
``world``.
"""

from __future__ import annotations

import errno
import struct
from pathlib import Path
from typing import Any

from analysis.formats.ros.mcap_file import McapFiles, files_of_bag
from analysis.formats.ros.messages import (
    TYPES,
    Channel,
    StoredMessage,
    choose_topic,
    collect,
    standard_name,
)
from analysis.formats.rows.streams import StreamChoice
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
MAX_SECONDS = 2**31
"""Where a ROS time ends, s: in 2038."""

_LIBRARIES = {"rosbags", "lz4", "backports", "ruamel", "apsw", "bz2", "mcap", "zlib", "zstandard"}
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
    RecursionError,
    struct.error,
)
_REMEDY = "copy it again, or recover it: one of rotdrift with `rotdrift recover`, others with an MCAP or ROS tool"


def is_mcap(start: bytes) -> bool:
    """Return whether a file is MCAP by its first bytes: a recording of this program, or a ROS 2 bag."""
    return start.startswith(MCAP_MAGIC)


def is_bag(source: SourceFile) -> bool:
    """Return whether a source is a bag or an MCAP file, by the folder's content or the file's first bytes."""
    by_start = source.head.startswith((MCAP_MAGIC, ROS1_MAGIC, SQLITE_MAGIC))
    return by_start or (source.path / "metadata.yaml").is_file()


def read_ros_bag(source: SourceFile, topic: str | None, choice: StreamChoice) -> RawSamples:
    """Read the orientations of one topic, which has to be named where several carry some.

    Times are those of the message headers; where these are not set, those of reception, which the notes report.

    Raises
    ------
    SeveralStreamsError
        Several publishers or frames on the topic, and no choice.
    ReaderError
        The extra is not installed; no or several topics to choose from (lists them); a damaged bag.
    """
    try:
        files = [source.path] if is_mcap(source.head) else None
        if source.path.is_dir():
            files = files_of_bag(source.path)
        if files is not None:
            return _read_mcap(files, topic, source.name, choice)
        return _read_other(source.path, source.head.startswith(ROS1_MAGIC), topic, source.name, choice)
    except ReaderError:
        raise
    except Exception as error:
        if getattr(error, "errno", None) == errno.EFBIG:
            raise  # it unpacks to more than the process that reads may write
        # Damaged bags raise a dozen kinds of errors out of rosbags and the libraries below it; our own are let through,
        # and want of memory, the limit of the process that reads.
        from_library = type(error).__module__.split(".")[0] in _LIBRARIES
        if from_library or isinstance(error, _DAMAGE):
            what = f" ({plain(str(error), 160)})" if from_library else ""  # Python's own text explains nothing
            raise ReaderError(f"{source.name} is damaged or cut off{what}: {_REMEDY}") from error
        raise


def _read_mcap(files: list[Path], topic: str | None, name: str, choice: StreamChoice) -> RawSamples:
    stored = McapFiles(files)
    channels = stored.channels()
    wanted = choose_topic(channels, topic, name)
    kind = next(channel.kind for channel in channels if channel.topic == wanted and channel.kind in TYPES)
    return collect(stored.messages(wanted), wanted, kind, name, choice)


def _read_other(path: Path, is_ros1: bool, topic: str | None, name: str, choice: StreamChoice) -> RawSamples:
    """Read a ROS 1 bag or a ROS 2 bag with db3 storage; the types are the standard ones, not those in the file."""
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError as error:
        raise ReaderError("ROS bags need rosbags: pip install 'rotdrift[ros]'") from error
    reader: Any = Reader1(path) if is_ros1 else Reader2(path)
    with reader:
        encoding = "ros1" if is_ros1 else "cdr"
        channels = {
            connection.id: Channel(
                connection.topic,
                standard_name(connection.msgtype),
                encoding,
                getattr(connection.ext, "callerid", None) or str(connection.id),
            )
            for connection in reader.connections
        }
        wanted = choose_topic(channels.values(), topic, name)
        kind = next(channel.kind for channel in channels.values() if channel.topic == wanted and channel.kind in TYPES)
        messages = (
            StoredMessage(channels[connection.id], stamp_ns, data)
            for connection, stamp_ns, data in reader.messages([c for c in reader.connections if c.topic == wanted])
        )
        return collect(messages, wanted, kind, name, choice)


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
    if len(series) and series.times_s[-1] >= MAX_SECONDS:
        raise WriterError(f"a ROS time ends at {MAX_SECONDS} s, the recording at {series.times_s[-1]:.4g} s")
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
