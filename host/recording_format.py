"""What stands in a recording: topics, schemas and the bytes of each message.

A recording is an MCAP file. The first channel, ``/raw/received``, holds exactly what the link delivered, with the
host's monotonic time and a CRC-32 of both; it is the truth, and every score can be recomputed from it. ``/raw/sent``
holds what the host sent. The other channels are for viewers (Foxglove, PlotJuggler, ROS 2 tools) and for people:
nothing reads them back. Two encodings: ROS 2's CDR with ``ros2msg`` schemas, and JSON with JSON Schema.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from host.transports.chunks import AnyChunk, Chunk, FrameChunk

FORMAT_VERSION = 1
METADATA_NAME = "rotdrift"
"""Name of the metadata record that says: this is one of ours."""

RECEIVED = "/raw/received"
SENT = "/raw/sent"
ORIENTATION = "/object/orientation"
INFO = "/object/info"
STATUS = "/object/status"
EVENT = "/object/event"
ENDPOINT = "/trial/endpoint"
NOTE = "/trial/note"

CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
WORLD_FRAME = "world"

RAW_SCHEMA_NAME = "rotdrift_msgs/msg/RawChunk"
RAW_SCHEMA = b"""\
# What one read of the link returned (or one write sent), exactly.
uint64 host_time_ns  # monotonic clock of the host at reception
uint32 crc32         # CRC-32 (zlib) of host_time_ns as 8 little-endian bytes, kind, data
uint8 kind           # 0: bytes of a serial link; 1: CAN frames, packed as firmware_protocol.can_frames says
uint8[] data
"""

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

_NUMBER = {"type": "number"}
_TEXT = {"type": "string"}
_WHOLE = {"type": "integer"}


def _json_schema(title: str, **properties: dict[str, str]) -> bytes:
    schema = {"title": title, "type": "object", "properties": properties}
    return json.dumps(schema, sort_keys=True).encode()


@dataclass(frozen=True, slots=True)
class Topic:
    """One channel and its schema."""

    name: str
    schema_name: str
    schema_encoding: str
    schema: bytes
    message_encoding: str


def _json_topic(topic: str, title: str, **properties: dict[str, str]) -> Topic:
    return Topic(topic, title, "jsonschema", _json_schema(title, **properties), "json")


TOPICS = (
    Topic(RECEIVED, RAW_SCHEMA_NAME, "ros2msg", RAW_SCHEMA, "cdr"),
    Topic(SENT, RAW_SCHEMA_NAME, "ros2msg", RAW_SCHEMA, "cdr"),
    Topic(ORIENTATION, QUATERNION_SCHEMA_NAME, "ros2msg", QUATERNION_SCHEMA, "cdr"),
    _json_topic(INFO, "rotdrift.Info", device_id=_TEXT, boot_id=_WHOLE, rate_hz=_NUMBER, name=_TEXT),
    _json_topic(STATUS, "rotdrift.Status", uptime_us=_WHOLE, samples_produced=_WHOLE, samples_dropped=_WHOLE),
    _json_topic(EVENT, "rotdrift.Event", device_time_us=_WHOLE, kind=_TEXT, value=_WHOLE),
    _json_topic(ENDPOINT, "rotdrift.Endpoint", number=_WHOLE, time_s=_NUMBER, step_deg=_NUMBER, theta_bar_deg=_NUMBER),
    _json_topic(NOTE, "rotdrift.Note", kind=_TEXT, text=_TEXT),
)
"""Every channel, in the order in which a recording declares them."""

_RAW_HEAD = struct.Struct("<4sQIB3xI")
_CRC_HEAD = struct.Struct("<QB")
_QUATERNION = struct.Struct(f"<4siII{len(WORLD_FRAME) + 1}s{(-12 - len(WORLD_FRAME) - 1) % 8}x4d")
_WORLD_BYTES = WORLD_FRAME.encode() + b"\0"


class DamagedMessageError(ValueError):
    """The bytes of a raw message are not what was written: wrong length or CRC."""


def encode_raw(chunk: AnyChunk) -> bytes:
    """Make the CDR bytes of one raw chunk."""
    kind = 1 if isinstance(chunk, FrameChunk) else 0
    crc = zlib.crc32(chunk.data, zlib.crc32(_CRC_HEAD.pack(chunk.host_time_ns, kind)))
    return _RAW_HEAD.pack(CDR_LITTLE_ENDIAN, chunk.host_time_ns, crc, kind, len(chunk.data)) + chunk.data


def decode_raw(message: bytes) -> AnyChunk:
    """Read the CDR bytes of one raw chunk back.

    Raises
    ------
    DamagedMessageError
        Length, kind or CRC do not fit.
    """
    if len(message) < _RAW_HEAD.size:
        raise DamagedMessageError("shorter than its header")
    head, host_time_ns, crc, kind, length = _RAW_HEAD.unpack_from(message)
    data = message[_RAW_HEAD.size :]
    if head != CDR_LITTLE_ENDIAN or len(data) != length:
        raise DamagedMessageError("its length does not fit")
    if zlib.crc32(data, zlib.crc32(_CRC_HEAD.pack(host_time_ns, kind))) != crc:
        raise DamagedMessageError("its CRC does not fit")
    if kind > 1:
        raise DamagedMessageError(f"it is of a kind this version does not know, {kind}")
    return FrameChunk(data, host_time_ns) if kind == 1 else Chunk(data, host_time_ns)


def encode_quaternion(stamp_ns: int, q_wxyz: npt.NDArray[np.float64]) -> bytes:
    """Make the CDR bytes of a ``geometry_msgs/msg/QuaternionStamped``.

    Parameters
    ----------
    stamp_ns : int
        Wall clock, ns since 1970.
    q_wxyz : (4,)
        Unit quaternion, scalar first, body to world; ROS stores x, y, z, w.
    """
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    w, x, y, z = q_wxyz
    return _QUATERNION.pack(CDR_LITTLE_ENDIAN, seconds, nanoseconds, len(_WORLD_BYTES), _WORLD_BYTES, x, y, z, w)


def encode_json(values: dict[str, Any]) -> bytes:
    """Make the bytes of a JSON message; NaN, which JSON has not, becomes null."""
    return json.dumps(_without_nan(values), separators=(",", ":"), ensure_ascii=False).encode("utf-8", "replace")


def _without_nan(value: object) -> object:
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return value
