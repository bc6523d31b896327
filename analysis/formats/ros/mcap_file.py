"""Messages out of MCAP files, with the format's own library: channels of any encoding may stand beside the wanted one.

The profile in the header is not looked at: what a channel's messages are stands in its own record. A ROS 2 bag that
was split has several files; their channels for one topic may differ, in their quality of service for one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk

from analysis.formats.ros.messages import Channel, StoredMessage, standard_name
from analysis.formats.source import plain
from analysis.series import ReaderError

MAX_CHUNK_BYTES = 2**28
"""A chunk that unpacks to more is refused: recorders write some megabytes."""
_DEFINITIONS = {"ros2msg": "cdr", "ros2idl": "cdr", "omgidl": "cdr", "ros1msg": "ros1"}


class McapFiles:
    """Messages of one or more MCAP files, read in one go.

    Parameters
    ----------
    paths : sequence of Path
        In the order of recording.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)

    def channels(self) -> set[Channel]:
        """Return all channels that stand in the files."""
        found: set[Channel] = set()
        for path in self._paths:
            for record in _records(path):
                if isinstance(record, Channel):
                    found.add(record)
        return found

    def messages(self, topic: str) -> Iterator[StoredMessage]:
        """Yield the messages of a topic, by the time of reception within each file."""
        for path in self._paths:
            found = [item for item in _records(path, topic) if isinstance(item, StoredMessage)]
            found.sort(key=lambda message: message.received_ns)
            yield from found


def _records(path: Path, topic: str | None = None) -> Iterator[Channel | StoredMessage]:
    """Yield the channels of a file, and the messages of one topic."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        for outer in StreamReader(file, emit_chunks=True).records:
            if isinstance(outer, Chunk):
                if outer.uncompressed_size > MAX_CHUNK_BYTES:
                    raise ReaderError(
                        f"{plain(path.name, 80)} has a chunk of {outer.uncompressed_size} bytes unpacked; at most "
                        f"{MAX_CHUNK_BYTES} are read: write it again with smaller chunks (`mcap compress`)"
                    )
                inside = breakup_chunk(outer, validate_crc=True)
            else:
                inside = [outer]
            for record in inside:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, ChannelRecord):
                    channels[record.id] = channel = _channel(record, schemas.get(record.schema_id))
                    yield channel
                elif isinstance(record, Message) and topic is not None:
                    origin = channels.get(record.channel_id)
                    if origin is None:
                        raise McapError("a message of a channel that is not there")
                    if origin.topic == topic:
                        yield StoredMessage(origin, record.log_time, record.data)


def _channel(record: ChannelRecord, schema: Schema | None) -> Channel:
    kind = "" if schema is None else standard_name(schema.name)
    by_definition = "" if schema is None else _DEFINITIONS.get(schema.encoding, "")
    # Recorders disagree on the name of an encoding, but hardly on that of the definition.
    encoding = record.message_encoding or by_definition
    return Channel(record.topic, kind, encoding, record.metadata.get("callerid") or str(record.id))


def files_of_bag(folder: Path) -> list[Path] | None:
    """Return the MCAP files of a ROS 2 bag in order; None where it is stored otherwise.

    Raises ReaderError where one that its ``metadata.yaml`` names is missing.
    """
    text = (folder / "metadata.yaml").read_text(encoding="utf-8", errors="replace")
    named = dict.fromkeys(re.findall(r"^\s*(?:- |path: )\s*['\"]?([^'\"\n]+\.mcap)['\"]?\s*$", text, re.MULTILINE))
    paths = [folder / Path(name).name for name in named]
    missing = [path.name for path in paths if not path.is_file()]
    if missing:
        raise ReaderError(f"{plain(missing[0], 80)}, which metadata.yaml of {plain(folder.name, 80)} names, is missing")
    return paths or None
