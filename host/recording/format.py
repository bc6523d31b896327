"""What stands in a recording: topics, schemas and the bytes of each message.

A recording is an MCAP file. The first channel, ``/raw/received``, holds exactly what the link delivered, with the
host's monotonic time and a CRC-32 of both, so that a flipped bit is found; it is the truth, and every score can be
recomputed from it. ``/raw/sent`` holds what the host sent. ``/trial/action`` holds what the operator did: the trial
window and the cycles left out are read back from it. The other channels are for viewers (Foxglove, PlotJuggler, ROS 2
tools) and for people: nothing reads them back. All messages are ROS 2's: CDR bytes with a ``ros2msg`` schema in the
file.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import math
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from firmware_protocol.packets import Event, Info, Status
from host.links.transport import AnyChunk, Chunk, FrameChunk
from host.recording.cdr import CDR_LITTLE_ENDIAN, CRC_FIELD, RosField, RosMessageType
from host.text import plain

FORMAT_VERSION = 1
PROFILE = "ros2"
"""MCAP profile: every channel is a ROS 2 one, so that ROS tools open the file."""
METADATA_NAME = "rotdrift"
"""Name of the metadata record by which a file is one of ours."""

MISSING_NAME = "rotdrift.missing"
"""Name of a metadata record that stands where a recovered recording lacks records: topic, how many, CRC-32."""

RECEIVED = "/raw/received"
SENT = "/raw/sent"
ORIENTATION = "/object/orientation"
INFO = "/object/info"
STATUS = "/object/status"
EVENT = "/object/event"
ENDPOINT = "/trial/endpoint"
NOTE = "/trial/note"
ACTION = "/trial/action"

WORLD_FRAME = "world"

RAW_SCHEMA_NAME = "rotdrift_msgs/msg/RawChunk"
# Part of the format to the last byte, as tools compare definitions. The module that it names is can/frames.py now.
RAW_SCHEMA = b"""\
# What one read of the link returned (or one write sent), exactly.
uint64 host_time_ns  # monotonic clock of the host at reception
uint32 crc32         # CRC-32 (zlib) of host_time_ns as 8 little-endian bytes, kind, data
uint8 kind           # 0: bytes of a link; 1: CAN frames, packed as firmware_protocol.can_frames says; 2: what was sent
uint8[] data         # none: the link was lost and is open again
"""
BYTES_KIND, FRAMES_KIND, SENT_KIND = range(3)

QUATERNION_SCHEMA_NAME = "geometry_msgs/msg/QuaternionStamped"
_RULE = "=" * 80
QUATERNION_SCHEMA = f"""\
std_msgs/Header header
geometry_msgs/Quaternion quaternion
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
""".encode()


def _checked(name: str, *fields: RosField) -> RosMessageType:
    """Make a type whose messages end with a CRC."""
    crc = RosField("uint32", CRC_FIELD, "of the type's name and all before")
    return RosMessageType(f"rotdrift_msgs/msg/{name}", (*fields, crc))


TYPES = {
    INFO: _checked(
        "Info",
        RosField("uint64", "device_id"),
        RosField("uint32", "boot_id", "differs after every reset"),
        RosField("string", "firmware_version"),
        RosField("uint16", "rate_hz", "orientation rate"),
        RosField("string", "name"),
        RosField("string", "sensor"),
        RosField("string", "filter"),
        RosField("string", "card", "the object's own card, JSON"),
        RosField("uint8", "protocol_major"),
        RosField("uint8", "protocol_minor"),
    ),
    STATUS: _checked(
        "Status",
        RosField("uint64", "uptime_us", "device clock without wrap"),
        RosField("string", "state"),
        RosField("uint64", "samples_produced", "since boot"),
        RosField("uint32", "samples_dropped", "of these, by the object itself"),
        RosField("uint16", "battery_mv", "0 without a battery"),
        RosField("float64", "temperature_c"),
        RosField("float64[3]", "gyro_bias_dps", "deg/s, sensor axes"),
        RosField("uint16", "errors", "bits, see the protocol"),
    ),
    EVENT: _checked(
        "Event",
        RosField("uint32", "device_time_us", "wraps"),
        RosField("string", "kind"),
        RosField("uint16", "value", "button number or marker"),
    ),
    ENDPOINT: _checked(
        "Endpoint",
        RosField("uint32", "number", "of the cycle that ends here; 0 for the first end point"),
        RosField("float64", "time_s", "since the first sample"),
        RosField("float64", "period_s", "since the end point before; NaN for the first"),
        RosField("float64", "step_deg", "angle of the step; NaN for the first"),
        RosField("float64", "theta_bar_deg", "rotation drift so far, provisional; NaN below two end points"),
        RosField("string", "flags", "what is odd about it, separated by commas"),
    ),
    NOTE: _checked("Note", RosField("string", "kind"), RosField("string", "text")),
    ACTION: _checked(
        "Action",
        RosField("string", "kind", "marker, note, window-start, window-stop, exclude, include, finish, pause, ..."),
        RosField("float64", "time_s", "newest sample at that moment, since the first sample; NaN before it"),
        RosField("string", "text", "what was typed"),
        RosField("float64", "from_s", "end point at the begin of the cycle that is meant; NaN where none is"),
        RosField("float64", "to_s", "end point at its end"),
    ),
}
"""Topic -> type of the messages that are made of values."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One channel and its schema; all are CDR with a ``ros2msg`` schema."""

    name: str
    schema_name: str
    schema: bytes


TOPICS = (
    Topic(RECEIVED, RAW_SCHEMA_NAME, RAW_SCHEMA),
    Topic(SENT, RAW_SCHEMA_NAME, RAW_SCHEMA),
    Topic(ORIENTATION, QUATERNION_SCHEMA_NAME, QUATERNION_SCHEMA),
    *(Topic(name, kind.name, kind.definition) for name, kind in TYPES.items()),
)
"""Every channel, in the order in which a recording declares them."""

_RAW_HEAD = struct.Struct("<4sQIB3xI")
_CRC_HEAD = struct.Struct("<QB")
RAW_HEAD_BYTES = _RAW_HEAD.size
"""Of a raw message, before its data: encapsulation 4 bytes, host time u64, CRC-32 u32, kind u8, 3 spare, length u32."""
_QUATERNION = struct.Struct(f"<4siII{len(WORLD_FRAME) + 1}s{(-12 - len(WORLD_FRAME) - 1) % 8}x4d")
_WORLD_BYTES = WORLD_FRAME.encode() + b"\0"


def metadata_crc(values: Mapping[str, str]) -> str:
    """Return the CRC-32 over the recording's own metadata, all keys but ``crc32`` in order, as eight hex digits."""
    kept = {key: value for key, value in values.items() if key != "crc32"}
    return f"{zlib.crc32(json.dumps(kept, sort_keys=True).encode()):08x}"


class DamagedMessageError(ValueError):
    """The bytes of a raw message are not what was written: wrong length or CRC."""

    at: int | None = None
    """Where in its block it starts, behind the head of its record; None where that is not known."""


def encode_raw(chunk: AnyChunk, sent: bool = False) -> bytes:
    """Make the CDR bytes of one raw chunk, received or sent."""
    kind = SENT_KIND if sent else FRAMES_KIND if isinstance(chunk, FrameChunk) else BYTES_KIND
    crc = zlib.crc32(chunk.data, zlib.crc32(_CRC_HEAD.pack(chunk.host_time_ns, kind)))
    return _RAW_HEAD.pack(CDR_LITTLE_ENDIAN, chunk.host_time_ns, crc, kind, len(chunk.data)) + chunk.data


def raw_length(data: bytes, at: int = 0) -> int | None:
    """Return the length of the raw message that starts at a place, by its header; None where it cannot be one."""
    if len(data) - at < _RAW_HEAD.size:
        return None
    head, _, _, kind, length = _RAW_HEAD.unpack_from(data, at)
    return _RAW_HEAD.size + length if head == CDR_LITTLE_ENDIAN and kind <= SENT_KIND else None


MAX_HOST_NS = 2**62
"""A monotonic clock that counts from the start of the machine gets no further: 146 years."""


def decode_raw(message: bytes, topic: str = RECEIVED) -> AnyChunk:
    """Read the CDR bytes of one raw chunk back.

    Raises
    ------
    DamagedMessageError
        Length, kind, CRC or time do not fit, or it belongs to another topic: the record names a wrong channel.
    """
    if len(message) < _RAW_HEAD.size:
        raise DamagedMessageError("shorter than its header")
    head, host_time_ns, crc, kind, length = _RAW_HEAD.unpack_from(message)
    data = message[_RAW_HEAD.size :]
    if head != CDR_LITTLE_ENDIAN or len(data) != length:
        raise DamagedMessageError("its length does not fit")
    if zlib.crc32(data, zlib.crc32(_CRC_HEAD.pack(host_time_ns, kind))) != crc:
        raise DamagedMessageError("its CRC does not fit")
    if kind > SENT_KIND:
        raise DamagedMessageError(f"it is of a kind this version does not know, {kind}")
    if (kind == SENT_KIND) != (topic == SENT):
        raise DamagedMessageError("it belongs to another channel")
    if host_time_ns >= MAX_HOST_NS:
        raise DamagedMessageError("no clock reads the time at which it was received")
    return FrameChunk(data, host_time_ns) if kind == FRAMES_KIND else Chunk(data, host_time_ns)


def encode_quaternion(stamp_ns: int, q_wxyz: Sequence[float]) -> bytes:
    """Make the CDR bytes of a ``geometry_msgs/msg/QuaternionStamped``; ``stamp_ns`` is a date, ns since 1970."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    w, x, y, z = q_wxyz  # ROS stores the scalar last
    return _QUATERNION.pack(CDR_LITTLE_ENDIAN, seconds, nanoseconds, len(_WORLD_BYTES), _WORLD_BYTES, x, y, z, w)


def packet_values(packet: Info | Status | Event) -> dict[str, Any]:
    """Return the values of a rare packet's message: names for enums, JSON for the card, texts made safe."""
    values = dataclasses.asdict(packet)
    if isinstance(packet, Info):
        values["firmware_version"] = ".".join(map(str, packet.firmware_version))
        values["card"] = json.dumps(_without_nan(values["card"]), ensure_ascii=False)
    elif isinstance(packet, Status):
        values["state"] = packet.state.name.lower()
        values["errors"] = int(packet.errors)
    else:
        values["kind"] = packet.kind.name.lower()
    return {key: plain(value, 4000) if isinstance(value, str) else value for key, value in values.items()}


def _without_nan(value: object) -> object:
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return plain(value) if isinstance(value, str) else value
