"""Checking what only a recording of ours has: its definitions, the checksum in each message, what the raw bytes are."""

from __future__ import annotations

from firmware_protocol.items import StreamCounters
from host.recording import format as fmt
from host.recording.bulk.raw_span import RawSpan, raw_spans
from host.recording.bulk.record_runs import HEAD_BYTES, MESSAGE_HEAD_BYTES, MessageRun, by_channel
from host.recording.check.account import DecodedRaw, Findings
from host.recording.check.messages import MessageCheck
from host.recording.reader import RecordingHeader, parse_header, parse_missing
from host.stream.decoding import Link
from host.version import VERSION

LEFT_OUT = "the record is left out by all that reads this recording"
DEFINITIONS = {topic.name: (topic.schema_name, "ros2msg", topic.schema, "cdr") for topic in fmt.TOPICS}
"""Of this version, by topic: name, encoding and text of the schema, encoding of the messages."""


class OwnCheck:
    """Checks the content of a recording of ours while its records are walked."""

    def __init__(self, messages: MessageCheck, damage: Findings, notes: Findings) -> None:
        self.header: RecordingHeader | None = None
        self._messages = messages
        self._damage = damage
        self._notes = notes
        self._link = Link()
        self._chunks = 0
        self._orientation_bytes = len(fmt.encode_quaternion(0, (1.0, 0.0, 0.0, 0.0)))

    def add_definition(self, at: int, topic: str, definition: tuple[object, ...]) -> None:
        """Enter a channel with its schema: name, encoding and text of the schema, encoding of the messages."""
        if topic == fmt.RECEIVED:
            self._messages.ours = True
        expected = DEFINITIONS.get(topic)
        if expected is None:
            if self._messages.ours:
                self._notes.add(at, f"{topic} is a channel that this version does not know", "it is left out")
        elif expected != definition:
            meaning = "an older version, or another tool, wrote it" if self._messages.ours else "another tool wrote it"
            self._notes.add(at, f"the definition of {topic} is not that of version {VERSION}", meaning)

    def add_metadata(self, at: int, body: bytes, name: str) -> None:
        """Enter a metadata record."""
        if name == fmt.METADATA_NAME:
            header = parse_header(body)
            self._messages.ours = True
            if header is None:
                meaning = "link, date and settings are not known"
                self._damage.add(at, "the recording's own description is damaged", meaning)
            elif self.header is None:
                self.header = header
                if header.version != VERSION:
                    self._notes.add(at, f"recorded by version {header.version}, this is {VERSION}")
        elif name == fmt.MISSING_NAME:
            missing = parse_missing(body)
            if missing is None:
                self._damage.add(at, "a record of what was missing before is damaged", "how much is not known")
            else:
                what = f"{missing[1]} records of {missing[0]} are missing here"
                self._notes.add(at, what, "from the damaged file that this one was recovered from")

    def add(self, block: memoryview, run: MessageRun, at: int, within: int | None = None) -> None:
        """Enter messages of a block; places as in :meth:`host.recording.check.messages.MessageCheck.add`."""
        for channel, of_channel in by_channel(run.channels):
            checked = self._messages.channels.get(channel)
            if checked is None:
                continue
            chosen, topic = run.at(of_channel), checked.topic
            if topic == fmt.RECEIVED:
                self._add_received(block, chosen, at, within)
                continue
            if topic == fmt.ORIENTATION:  # for viewers, without a checksum: only the length can be checked
                sizes = chosen.ends - chosen.starts - (HEAD_BYTES + MESSAGE_HEAD_BYTES)
                places = chosen.starts[sizes != self._orientation_bytes]
                problems = [(int(place), "it has another length") for place in places]
            else:
                problems = list(_wrong(block, chosen, topic))
            for place, why in problems:
                self._damage.add(
                    at + place if within is None else within, f"a record of {topic} is damaged ({why})", LEFT_OUT
                )

    def _add_received(self, block: memoryview, run: MessageRun, at: int, within: int | None) -> None:
        for item in raw_spans(block, run.starts + HEAD_BYTES, run.ends):
            if isinstance(item, RawSpan):
                self._chunks += len(item.stops)
                if self._link.is_of_bytes:
                    self._link.feed_span(item.data)
            elif isinstance(item, fmt.DamagedMessageError):
                place = within if within is not None or item.at is None else at + item.at - HEAD_BYTES
                self._damage.add(place, f"a record of {fmt.RECEIVED} is damaged ({item})", LEFT_OUT)
                self._link.skip_gap()
            else:
                self._chunks += 1
                self._link.feed(item)
        self._link.take_damage()

    def decoded(self) -> DecodedRaw:
        """Return what the raw channel decodes to; nothing follows."""
        self._link.flush()
        counters: StreamCounters = self._link.counters
        n_samples = sum(n for kind, n in counters.packets.items() if kind.name == "ORIENTATION")
        damaged = counters.crc_errors + counters.malformed + getattr(counters, "cobs_errors", 0)
        return DecodedRaw(self._chunks, n_samples, damaged)


def _wrong(block: memoryview, run: MessageRun, topic: str) -> list[tuple[int, str]]:
    """Return the messages of a topic, one with a checksum, that do not fit it: place and why."""
    found = []
    for _, start, end in run.places():
        message = bytes(block[start + HEAD_BYTES + MESSAGE_HEAD_BYTES : end])
        try:
            if topic == fmt.SENT:
                fmt.decode_raw(message, topic)
            elif topic in fmt.TYPES:
                fmt.TYPES[topic].decode(message)
        except ValueError as error:
            found.append((start, str(error)))
    return found
