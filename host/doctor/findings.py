"""What a check of machine or link found: one line each, with a verdict and a remedy."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Verdict(enum.Enum):
    """How good it is."""

    INFO = "info"
    OK = "ok"
    DOUBTFUL = "doubtful"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check."""

    topic: str
    """What was checked, a word or two."""
    verdict: Verdict
    text: str
    """What was found."""
    remedy: str = ""
    """What to do about it; empty where nothing is to be done."""

    def to_json(self) -> dict[str, str]:
        """Return plain values; the remedy keeps the key ``mend`` that scripts may know."""
        return {"topic": self.topic, "verdict": self.verdict.value, "text": self.text, "mend": self.remedy}


def judged(topic: str, text: str, *, good: bool, remedy: str = "", verdict: Verdict = Verdict.DOUBTFUL) -> Finding:
    """Return a finding that is either as it should be, or ``verdict`` with a remedy."""
    return Finding(topic, Verdict.OK, text) if good else Finding(topic, verdict, text, remedy)
