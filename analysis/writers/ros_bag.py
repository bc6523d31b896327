"""ROS 2 bags: a folder with MCAP storage; needs the extra ``rotdrift[ros]``.

``geometry_msgs/PoseStamped`` where positions are known, else ``QuaternionStamped``; x, y, z, w, object to ``world``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis import rotations
from analysis.series import OrientationSeries
from analysis.writers.errors import WriterError

TOPIC = "/object/orientation"
FRAME = "world"


def write_ros_bag(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a ROS 2 bag; message times are the recording's own.

    Raises
    ------
    WriterError
        The extra is not installed, times are before 1970, or the name is that of a ROS 1 bag.
    """
    del result
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
