"""Orientations out of ROS messages, whatever storage they lie in: which topics have some, which is read, one by one.

ROS quaternions are x, y, z, w, Hamilton, child to parent frame (REP 103, REP 145). An Imu without an orientation has −1
in the first element of its covariance. Standard types are decoded by their standard definitions, so that what a file
says of its other types, or does not say, changes nothing.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from typing import Any

import numpy as np

from analysis.bounds import MAX_SAMPLES, too_many
from analysis.formats.rows.streams import StreamChoice, chosen
from analysis.formats.source import plain
from analysis.formats.time_stamps import RawSamples
from analysis.series import ReaderError

TRANSFORMS = "tf2_msgs/msg/TFMessage"
TYPES = {
    "sensor_msgs/msg/Imu": ("orientation", "", "linear_acceleration"),
    "geometry_msgs/msg/PoseStamped": ("pose.orientation", "pose.position", ""),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.orientation", "pose.pose.position", ""),
    "geometry_msgs/msg/Pose": ("orientation", "position", ""),
    "geometry_msgs/msg/QuaternionStamped": ("quaternion", "", ""),
    "geometry_msgs/msg/TransformStamped": ("transform.rotation", "transform.translation", ""),
    "nav_msgs/msg/Odometry": ("pose.pose.orientation", "pose.pose.position", ""),
    TRANSFORMS: ("transform.rotation", "transform.translation", ""),
}
"""Message types that carry an orientation -> where it, the position and the acceleration stand in them."""
MAX_SPREAD_S = 1e8
"""Message headers further apart than this carry times of two clocks: since the start, and since 1970."""
_parts = attrgetter("x", "y", "z")


@dataclass(frozen=True)
class Channel:
    """A way by which messages of one topic came: a channel, or a connection of a publisher."""

    topic: str
    kind: str
    """Message type as ROS 2 names it: ``sensor_msgs/msg/Imu``."""
    encoding: str
    """Of the messages: ``cdr``, ``ros1``, or one that is not read."""
    name: str
    """What a person calls it: its number, or the publisher's name."""


@dataclass(frozen=True)
class StoredMessage:
    """A message as it is stored."""

    channel: Channel
    received_ns: int
    data: bytes


def standard_name(kind: str) -> str:
    """Return a type's name as ROS 2 has it: ROS 1 leaves out ``msg/``."""
    package, _, name = kind.partition("/")
    return f"{package}/msg/{name}" if name and "/" not in name else kind


def choose_topic(channels: Iterable[Channel], topic: str | None, source: str) -> str:
    """Return the topic to read: the one named, or the only one with orientations.

    Raises
    ------
    ReaderError
        None, or several to choose from (lists them), or the one named has no orientations that are read.
    """
    channels = list(channels)
    readable = {c.topic: c.kind for c in channels if c.kind in TYPES and c.encoding in ("cdr", "ros1")}
    there = sorted({(c.topic, c.kind, c.encoding) for c in channels})
    listed = ", ".join(f"{plain(name)} ({plain(kind)})" for name, kind in sorted(readable.items())) or "none"
    if topic is not None:
        if topic not in readable:
            other = next((encoding for name, kind, encoding in there if name == topic and kind in TYPES), None)
            why = f" that are read: its messages are {plain(other)}" if other else ""
            raise ReaderError(f"no orientations on topic '{plain(topic)}'{why}; topics that have them: {listed}")
        return topic
    if not readable:
        found = ", ".join(f"{plain(name)} ({plain(kind)}, {plain(how)})" for name, kind, how in there[:20]) or "none"
        raise ReaderError(
            f"{source} has no topic with orientations (its topics: {found}): record one of {', '.join(sorted(TYPES))}"
        )
    # What never moves is the object only where nothing else could be.
    moving = [name for name in readable if not name.endswith("tf_static")] or list(readable)
    if len(moving) > 1:
        raise ReaderError(f"several topics have orientations; choose with --topic: {listed}")
    return moving[0]


Decoder = Callable[[StoredMessage], Any]


def decoder() -> Decoder:
    """Return what decodes messages of :data:`TYPES`, by the standard definitions.

    Raises ReaderError where the extra is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise ReaderError("ROS bags need rosbags: pip install 'rotdrift[ros]'") from error
    ros1, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    ros1_types: Any = ros1
    if TRANSFORMS not in ros1.fielddefs:
        ros1_types.register({TRANSFORMS: ros2.fielddefs[TRANSFORMS]})

    def decode(message: StoredMessage) -> Any:  # noqa: ANN401 - classes that rosbags makes
        kind = message.channel.kind
        if message.channel.encoding == "ros1":
            return ros1.deserialize_ros1(message.data, kind)
        if len(message.data) > 1 and message.data[1] > 1:
            raise ReaderError(
                f"the messages of {plain(message.channel.topic)} are not in plain CDR but in XCDR2 or a parameter list "
                f"(0x{message.data[1]:02x}), which is not read; record with the default middleware, or convert"
            )
        return ros2.deserialize_cdr(message.data, kind)

    return decode


class OrientationCollector:
    """Takes messages of one topic, one by one, and makes samples of them."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        # Flat: a tuple for every message takes four times the memory.
        self._times_s, self._received_s, self._rows = array("d"), array("d"), array("d")
        self._labels: list[str] = []
        self._channels: list[str] = []
        orientation, position, acceleration = TYPES[kind]
        self._orientation = attrgetter(orientation)
        self._vectors = [attrgetter(field) for field in (position, acceleration) if field]
        self._has_position, self._has_acceleration = bool(position), bool(acceleration)

    def __len__(self) -> int:
        return len(self._times_s)

    def add(self, message: Any, stored: StoredMessage) -> None:  # noqa: ANN401
        """Add a message's orientations.

        Raises ReaderError for an Imu whose sensor has no orientation.
        """
        if getattr(message, "orientation_covariance", (0.0,))[0] == -1.0:
            raise ReaderError(
                "the sensor gives no orientation, as its orientation_covariance shows; run an orientation filter, such "
                "as imu_filter_madgwick, and record its topic"
            )
        for item in message.transforms if self.kind == TRANSFORMS else (message,):
            quat = self._orientation(item)
            vectors = (part for get in self._vectors for part in _parts(get(item)))
            self._rows.extend((quat.w, quat.x, quat.y, quat.z, *vectors))
            header = getattr(item, "header", None)
            stamp = None if header is None else header.stamp
            # Whole seconds since the epoch keep 0.2 us in a double; that is enough for cycles of seconds.
            self._times_s.append(0.0 if stamp is None else stamp.sec + stamp.nanosec * 1e-9)
            self._received_s.append(stored.received_ns * 1e-9)
            frames = ("" if header is None else str(header.frame_id), str(getattr(item, "child_frame_id", "")))
            self._labels.append("->".join(filter(None, frames)) or "(unnamed)")
            self._channels.append(stored.channel.name)

    def samples(self, topic: str, choice: StreamChoice) -> RawSamples:
        """Return the samples; several frames are labels, several publishers at a time are to be chosen from.

        Raises
        ------
        SeveralStreamsError
            Several publishers or channels at a time, and no choice.
        """
        kept = np.ones(len(self), dtype=bool)
        channels = np.array(self._channels)
        received_s = np.array(self._received_s)
        names = sorted(dict.fromkeys(self._channels))
        notes = [f"topic {plain(topic, 120)} ({self.kind})"]
        if len(names) > 1 and (choice.channel is not None or _overlap(channels, received_s, names)):
            kept = channels == chosen("channel", names, choice.channel)
        rows = np.array(self._rows).reshape(len(self), -1)[kept]
        received_s = received_s[kept]
        times_s = np.array(self._times_s)[kept]
        labels = np.array(self._labels)[kept]
        own_clock = True
        if len(times_s) > 1 and len(np.unique(times_s)) < 2:
            times_s, own_clock = received_s, False
            notes.append("message headers carry no time; times of reception used")
        elif np.ptp(times_s) > MAX_SPREAD_S > np.ptp(received_s):
            times_s, own_clock = received_s, False
            notes.append("message headers carry times of two clocks; times of reception used")
        position = rows[:, 4:7] if self._has_position else None
        return RawSamples(
            quats_wxyz=rows[:, :4],
            times_s=times_s,
            positions_m=position,
            accelerations_mps2=rows[:, 4:7] if self._has_acceleration else None,
            convention=f"ROS {self.kind}: quaternion x,y,z,w, Hamilton, body to world",
            notes=tuple(notes),
            labels=labels if len(np.unique(labels)) > 1 else None,
            received_s=received_s if own_clock else None,
        )


def _overlap(channels: Any, received_s: Any, names: list[str]) -> bool:  # noqa: ANN401
    """Return whether messages of two channels came during the same time; parts of a split bag follow each other."""
    spans = sorted((received_s[channels == name].min(), received_s[channels == name].max()) for name in names)
    return any(after[0] < before[1] for before, after in pairwise(spans))


def collect(messages: Iterator[StoredMessage], topic: str, kind: str, source: str, choice: StreamChoice) -> RawSamples:
    """Return the samples of one topic's messages.

    Raises ReaderError where there are none.
    """
    decode, collector = decoder(), OrientationCollector(kind)
    for stored in messages:
        collector.add(decode(stored), stored)
        if len(collector) > MAX_SAMPLES:
            raise ReaderError(too_many(source))
    if not len(collector):
        raise ReaderError(f"topic {plain(topic, 80)} ({kind}) of {source} has no messages")
    return collector.samples(topic, choice)
