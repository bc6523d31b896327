"""Writing a recording: raw first, unchunked, flushed, never over an existing file.

Unchunked and flushed every :data:`FLUSH_PERIOD_NS`, a killed capture loses at most what came since the last flush, and
a machine without power at most what came since the last sync, half a second and how long the disk needs for it; the
library's default chunks would lose everything since the last megabyte, and its seeking reader does not open a cut file.
"""

from __future__ import annotations

import contextlib
import json
import platform
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt
from mcap.writer import CompressionType, IndexType, Writer

from firmware_protocol.packets import Event, Info, Status
from host.links.transport import AnyChunk, Chunk, GapChunk
from host.recording import format as fmt
from host.recording.sink import RecordingSink
from host.text import plain
from host.version import VERSION

LAST_DATE_NS = 2**31 * 10**9 - 1
"""ROS counts seconds in 32 bits: up to 2038. A damaged recording may claim any date."""
FLUSH_PERIOD_NS = 50_000_000
"""Half of the promised 100 ms, so that a late turn of the loop still keeps the promise."""


class RecordingWriter:
    """One recording being written. It belongs to one thread; no method fails because of the disk.

    Parameters
    ----------
    path : Path
        Must not exist.
    link : str
        URI of the link.
    wall_time_ns, monotonic_ns : int
        The two clocks at the same instant: the anchor by which monotonic times become dates.
    settings : dict
        How the capture was started; stored as JSON.

    Raises
    ------
    FileError
        The file exists or cannot be created.
    """

    def __init__(
        self, path: Path, link: str, wall_time_ns: int, monotonic_ns: int, settings: dict[str, Any] | None = None
    ) -> None:
        self.path = path
        self.closed = False
        """Whether it is finished: nothing can be added."""
        self._sink = RecordingSink(path)
        self._wall_minus_monotonic_ns = wall_time_ns - monotonic_ns
        self._flushed_ns = monotonic_ns
        self._logged_ns = 0
        self._writer = cast(  # its methods are not annotated
            Any,
            Writer(
                cast(IO[bytes], self._sink),
                use_chunking=False,
                compression=CompressionType.NONE,
                index_types=IndexType.ALL,
                enable_data_crcs=True,
            ),
        )
        self._writer.start(profile=fmt.PROFILE, library=f"rotdrift {VERSION}")
        head = {
            "format": str(fmt.FORMAT_VERSION),
            "version": VERSION,
            "link": plain(link),
            "wall_time_ns": str(wall_time_ns),
            "monotonic_ns": str(monotonic_ns),
            "settings": json.dumps(settings or {}, sort_keys=True),
            "system": plain(f"{platform.system()} {platform.release()}, Python {platform.python_version()}"),
        }
        self._writer.add_metadata(fmt.METADATA_NAME, head | {"crc32": fmt.metadata_crc(head)})
        schema_ids: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        for topic in fmt.TOPICS:
            if topic.schema_name not in schema_ids:
                schema_ids[topic.schema_name] = self._writer.register_schema(topic.schema_name, "ros2msg", topic.schema)
            self._channels[topic.name] = self._writer.register_channel(
                topic.name, "cdr", schema_ids[topic.schema_name], {}
            )
        self._counts = dict.fromkeys(self._channels, 0)
        self._writer.flush()

    @property
    def n_bytes(self) -> int:
        """Size of the recording so far, B, including what is still in memory."""
        return self._sink.tell()

    @property
    def problem(self) -> str | None:
        """Why nothing can be written at the moment, and what is done about it; None when all is well."""
        if self._sink.bytes_discarded:
            return (
                f"{self._sink.problem}; the memory for it is full as well and "
                f"{self._sink.bytes_discarded / 1e6:.1f} MB are lost"
            )
        if self._sink.problem:
            kept = len(self._sink.pending) / 1e6
            return f"{self._sink.problem}; {kept:.1f} MB are kept in memory until it can be written"
        return None

    @property
    def unwritten(self) -> bytes:
        """Records that are not on the disk; they continue the file."""
        return self._sink.pending

    def wall_ns(self, host_time_ns: int) -> int:
        """Turn a monotonic time into a date, ns since 1970; what ROS cannot write becomes the nearest it can."""
        return min(max(host_time_ns + self._wall_minus_monotonic_ns, 0), LAST_DATE_NS)

    def add_received(self, chunk: AnyChunk) -> None:
        """Record what the link delivered, before anything else is done with it."""
        if isinstance(chunk, GapChunk):
            self.add_missing(fmt.RECEIVED, chunk.records)
            return
        self._add(fmt.RECEIVED, fmt.encode_raw(chunk), chunk.host_time_ns)

    def add_missing(self, topic: str, records: int) -> None:
        """Record that this recording lacks records of a topic here: the one that it is made from is damaged."""
        values = {"topic": topic, "records": str(records)}
        self._writer.add_metadata(fmt.MISSING_NAME, values | {"crc32": fmt.metadata_crc(values)})

    def add_sent(self, data: bytes, host_time_ns: int) -> None:
        """Record what the host sent."""
        self._add(fmt.SENT, fmt.encode_raw(Chunk(data, host_time_ns), sent=True), host_time_ns)

    def add_orientations(
        self, stamps_ns: npt.NDArray[np.int64], quats_wxyz: npt.NDArray[np.float64], host_time_ns: int
    ) -> None:
        """Record decoded samples for viewers.

        Parameters
        ----------
        stamps_ns : (n,)
            Monotonic host time at which each sample was taken, ns.
        quats_wxyz : (n, 4)
            Unit quaternions, body to world.
        host_time_ns : int
            Reception.
        """
        for stamp_ns, q_wxyz in zip(stamps_ns.tolist(), quats_wxyz.tolist(), strict=True):  # plain numbers pack faster
            self._add(fmt.ORIENTATION, fmt.encode_quaternion(self.wall_ns(stamp_ns), q_wxyz), host_time_ns)

    def add_packet(self, packet: Info | Status | Event, host_time_ns: int) -> None:
        """Record a rare packet."""
        topic = fmt.INFO if isinstance(packet, Info) else fmt.STATUS if isinstance(packet, Status) else fmt.EVENT
        self.add_values(topic, fmt.packet_values(packet), host_time_ns)

    def add_values(self, topic: str, values: dict[str, Any], host_time_ns: int) -> None:
        """Record a message on one of the topics of :data:`host.recording.format.TYPES`."""
        self._add(topic, fmt.TYPES[topic].encode(values), host_time_ns)

    def add_note(self, kind: str, text: str, host_time_ns: int) -> None:
        """Record something that happened, in words."""
        self.add_values(fmt.NOTE, {"kind": kind, "text": plain(text, 2000)}, host_time_ns)

    def flush_if_due(self, now_ns: int) -> None:
        """Flush when the last one is long enough ago; to be called at least every 50 ms."""
        if now_ns - self._flushed_ns >= FLUSH_PERIOD_NS:
            self._flushed_ns = now_ns
            self._sink.flush_pending(now_ns)
            self._sink.sync_if_due(now_ns)

    def close(self, report: Callable[[str], object] = lambda _: None) -> None:
        """Finish the file: statistics, index, footer; restore it when it was deleted meanwhile.

        ``report`` is called with a sentence on what could not be saved.
        """
        if self.closed:
            return
        self.closed = True
        with contextlib.closing(self._sink):  # even where finishing fails, what there is goes to the disk
            self._writer.finish()
            if not self._sink.flush_pending():
                rescued = self._sink.rescue((Path(tempfile.gettempdir()), Path.home()))
                where = f"; the whole of it is {rescued}" if rescued else ""
                report(f"the recording {self.path} is cut: {self._sink.problem}{where}")
            if self._sink.removed():
                restored = " and written again" if self._sink.restore() else ""
                report(f"the recording {self.path} was removed meanwhile{restored}")

    def _add(self, topic: str, message: bytes, host_time_ns: int) -> None:
        count = self._counts[topic]
        self._counts[topic] = count + 1
        wall_ns = self.wall_ns(host_time_ns)
        # What was received earlier may be written later; ROS tools want the times of a file never to go back.
        self._logged_ns = max(self._logged_ns, wall_ns)
        self._writer.add_message(
            self._channels[topic],
            log_time=self._logged_ns,
            publish_time=wall_ns,
            data=message,
            sequence=count & 0xFFFFFFFF,
        )
