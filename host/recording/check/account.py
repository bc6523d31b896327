"""What checking a file found: problems with their places, notes, and the account of its channels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from host.text import plain

MAX_KEPT = 200
"""Problems and notes kept one by one; of a file that is damaged all over, the rest is counted."""
JsonValues: TypeAlias = dict[str, object]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that does not fit, or that a person should know."""

    what: str
    meaning: str = ""
    """What it means, or the remedy."""
    at: int | None = None
    """Offset in the file, B; None for what is of the whole file."""
    repeats: int = 0
    """How often the same follows right behind: a hole of zeros is read as thousands of records."""

    def line(self) -> str:
        """Return it as one line."""
        place = "" if self.at is None else f"at {self.at}: "
        more = f" ({self.repeats} more behind it)" if self.repeats else ""
        meaning = f": {plain(self.meaning, 400)}" if self.meaning else ""
        return f"{place}{plain(self.what, 400)}{more}{meaning}"


class Findings:
    """Collects what is found, up to :data:`MAX_KEPT` one by one."""

    def __init__(self) -> None:
        self.kept: list[Finding] = []
        self.n = 0

    def add(self, at: int | None, what: str, meaning: str = "") -> None:
        """Enter something; the same once more right behind itself counts as one."""
        last = self.kept[-1] if self.kept and len(self.kept) < MAX_KEPT else None
        if last is not None and at is not None and (last.what, last.meaning) == (what, meaning):
            self.kept[-1] = replace(last, repeats=last.repeats + 1)
            return
        self.n += 1
        if len(self.kept) < MAX_KEPT:
            self.kept.append(Finding(what, meaning, at))


@dataclass(frozen=True, slots=True)
class ChannelAccount:
    """The records of one channel."""

    topic: str
    schema: str
    records: int
    stated: int | None
    """As the file's statistics have it; None where it has none."""
    missing: int
    """By the numbers of the records; 0 where they are not numbered."""
    numbered: bool


@dataclass(frozen=True, slots=True)
class DecodedRaw:
    """What the raw channel of a recording of ours decodes to."""

    chunks: int
    samples: int
    damaged_frames: int
    """Pieces that are not whole frames: damage on the link, which the recording keeps as it came."""


@dataclass(frozen=True, slots=True)
class CheckReport:
    """What checking one file found."""

    kind: str
    """What the file is, in words."""
    n_bytes: int
    closed: bool
    """Whether it ends as a finished file does."""
    problems: tuple[Finding, ...]
    """Damage; empty where the file is sound."""
    n_problems: int
    """How many there are, those not kept one by one too."""
    notes: tuple[Finding, ...]
    """Not damage, but worth knowing."""
    channels: tuple[ChannelAccount, ...] = ()
    checksums: dict[str, str] = field(default_factory=dict)
    """Of data and summary: ``fits``, ``does not fit``, ``not stated``."""
    span_s: float | None = None
    """From the first message to the last; None without two messages."""
    decoded: DecodedRaw | None = None

    @property
    def sound(self) -> bool:
        """Whether nothing is damaged."""
        return not self.n_problems

    def to_json(self) -> JsonValues:
        """Return plain values."""
        decoded = self.decoded
        return {
            "kind": self.kind,
            "bytes": self.n_bytes,
            "sound": self.sound,
            "closed": self.closed,
            "n_problems": self.n_problems,
            "problems": [_finding_values(finding) for finding in self.problems],
            "notes": [_finding_values(finding) for finding in self.notes],
            "checksums": self.checksums,
            "span_s": self.span_s,
            "channels": [
                {
                    "topic": plain(channel.topic),
                    "schema": plain(channel.schema),
                    "records": channel.records,
                    "stated": channel.stated,
                    "missing": channel.missing,
                    "numbered": channel.numbered,
                }
                for channel in self.channels
            ],
            "decoded": None
            if decoded is None
            else {"chunks": decoded.chunks, "samples": decoded.samples, "damaged_frames": decoded.damaged_frames},
        }

    def lines(self) -> Iterator[str]:
        """Report it for a person: problems first, one a line, the verdict last.

        Yields
        ------
        str
            Lines without their ends.
        """
        for finding in self.problems:
            yield finding.line()
        if self.n_problems > len(self.problems):
            yield f"and {self.n_problems - len(self.problems)} more problems"
        for finding in self.notes:
            yield f"note: {finding.line()}"
        length = "" if self.span_s is None else f", {self.span_s:.1f} s"
        yield f"{self.kind}, {self.n_bytes} bytes{length}"
        if self.checksums:
            yield "checksums: " + ", ".join(f"{name} {verdict}" for name, verdict in self.checksums.items())
        for channel in self.channels:
            stated = "" if channel.stated in {None, channel.records} else f", {channel.stated} stated"
            missing = f", {channel.missing} missing" if channel.missing else ""
            counts = f"{channel.records} records{stated}{missing}"
            yield f"  {plain(channel.topic, 60)}: {counts} ({plain(channel.schema, 60)})"
        if self.decoded is not None:
            damaged = f", {self.decoded.damaged_frames} damaged frames" if self.decoded.damaged_frames else ""
            yield f"the raw channel decodes: {self.decoded.chunks} chunks, {self.decoded.samples} samples{damaged}"
        n = self.n_problems
        yield "sound" if self.sound else f"damaged: {n} problem{'s' * (n != 1)}"


def _finding_values(finding: Finding) -> JsonValues:
    return {
        "offset": finding.at,
        "repeats": finding.repeats,
        "what": plain(finding.what, 400),
        "meaning": plain(finding.meaning, 400),
    }
