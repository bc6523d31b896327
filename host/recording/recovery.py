"""A clean recording from a cut or damaged one."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

from host.errors import FileError
from host.recording import format as fmt
from host.recording.reader import RecordingHeader
from host.recording.salvage import SalvagedMessage, salvage
from host.recording.views import add_views
from host.recording.writer import RecordingWriter
from host.trial import Trial


@dataclass(frozen=True, slots=True)
class Recovery:
    """What was found in a damaged recording, and what was not."""

    chunks: int
    """Whole records of what the link delivered."""
    sent: int
    """Whole records of what the host sent."""
    actions: int
    """Whole records of what the operator did."""
    notes: int
    missing_chunks: int
    """Records of what the link delivered that are damaged; behind the last whole one nobody can count them."""
    missing_others: int
    """Records of the other kinds above that are damaged."""
    header_found: bool
    """Whether link, date and settings are known."""

    def sentences(self) -> list[str]:
        """Say it to a person."""
        said = [f"{self.chunks} records of received data are whole, {self.missing_chunks} are damaged and left out"]
        if self.missing_others:
            said.append(f"{self.missing_others} records of commands, actions or notes are damaged and left out")
        if not self.header_found:
            said.append("the file's own description is damaged: link and settings are not known")
        return said

    def to_json(self) -> dict[str, Any]:
        """Turn into plain values."""
        return asdict(self)


def recover(source: Path, target: Path) -> Recovery:
    """Write a clean recording of everything whole in a damaged one.

    The raw channels, the operator's actions and the notes are copied; samples, packets and end points for viewers are
    made again from them. Nothing is taken over whose CRC-32 does not fit.

    Parameters
    ----------
    source : Path
        Any file that once was a recording.
    target : Path
        Must not exist.

    Raises
    ------
    FileError
        Nothing can be found, or the new file cannot be written.
    """
    header, messages = salvage(source)
    first = next(messages, None)
    head = header or _made_up(first)
    if head is None:
        raise FileError(f"{source} holds no whole record of a recording", "give a file that `rotdrift capture` wrote")
    # The source's own numbers stay in the notes: a recovered recording says what it is.
    writer = RecordingWriter(target, head.link, head.wall_time_ns, head.monotonic_ns, head.settings)
    copier = _Copier(writer, head)
    try:
        # A capture killed before its first flush leaves a header and nothing else: that is a recording too.
        for message in chain([] if first is None else [first], messages):
            copier.take(message)
        copier.finish()
        found = replace(copier.result(), header_found=header is not None)
        writer.add_note("recovered", f"from {source.name}: {'; '.join(found.sentences())}", copier.last_ns)
    finally:
        problems: list[str] = []
        writer.close(problems.append)
    if problems:
        raise FileError(problems[0], "make room on the disk and try again")
    return found


class _Copier:
    def __init__(self, writer: RecordingWriter, head: RecordingHeader) -> None:
        self._writer = writer
        self._wall_minus_monotonic_ns = head.wall_time_ns - head.monotonic_ns
        self._trial = Trial()
        self._counts: Counter[str] = Counter()
        self._next: dict[str, int] = {}
        self._missing: Counter[str] = Counter()
        self.last_ns = head.monotonic_ns

    def take(self, message: SalvagedMessage) -> None:
        self._count(message)
        chunk = message.chunk
        if chunk is None:
            at_ns = max(self.last_ns, min(message.time_ns - self._wall_minus_monotonic_ns, self.last_ns + 10**9))
            self._writer.add_values(message.topic, message.values, at_ns)
        elif message.topic == fmt.SENT:
            self._writer.add_sent(chunk.data, chunk.host_time_ns)
        else:
            self._writer.add_received(chunk)
            add_views(self._writer, self._trial.feed(chunk), chunk.host_time_ns)
            self.last_ns = chunk.host_time_ns
        self._writer.flush_if_due(self.last_ns)

    def finish(self) -> None:
        """Take what the decoder still holds."""
        add_views(self._writer, self._trial.finish(), self.last_ns)

    def _count(self, message: SalvagedMessage) -> None:
        """Count what is missing by the records' own numbers; a number far off is damage itself and passed over."""
        self._counts[message.topic] += 1
        expected = self._next.get(message.topic, 0)
        gone = message.sequence - expected
        if 0 <= gone < 1_000_000:
            self._missing[message.topic] += gone
            self._next[message.topic] = message.sequence + 1
        else:
            self._next[message.topic] = expected + 1

    def result(self) -> Recovery:
        return Recovery(
            chunks=self._counts[fmt.RECEIVED],
            sent=self._counts[fmt.SENT],
            actions=self._counts[fmt.ACTION],
            notes=self._counts[fmt.NOTE],
            missing_chunks=self._missing[fmt.RECEIVED],
            missing_others=self._missing[fmt.SENT] + self._missing[fmt.ACTION] + self._missing[fmt.NOTE],
            header_found=True,
        )


def _made_up(first: SalvagedMessage | None) -> RecordingHeader | None:
    """Give a header for a file whose own is gone: the date from the first whole record; None where there is none."""
    if first is None:
        return None
    monotonic_ns = 0 if first.chunk is None else first.chunk.host_time_ns
    return RecordingHeader("", "", first.time_ns, monotonic_ns)
