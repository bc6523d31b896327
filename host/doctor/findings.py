"""What a check of machine or link found: one line each, with a verdict and what to do."""

from __future__ import annotations

import enum
from dataclasses import asdict, dataclass
from typing import Any


class Verdict(enum.Enum):
    """How good it is."""

    INFO = "info"
    OK = "ok"
    DOUBTFUL = "doubtful"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    topic: str
    """What was looked at, a word or two."""
    verdict: Verdict
    text: str
    """What was found."""
    mend: str = ""
    """What to do about it; empty where nothing is to be done."""

    def to_json(self) -> dict[str, Any]:
        """Turn into plain values."""
        return asdict(self) | {"verdict": self.verdict.value}


def judged(topic: str, text: str, *, good: bool, mend: str = "", verdict: Verdict = Verdict.DOUBTFUL) -> Finding:
    """Make a finding that is either as it should be, or ``verdict`` with a mend."""
    return Finding(topic, Verdict.OK, text) if good else Finding(topic, verdict, text, mend)
