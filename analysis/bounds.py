"""How much one recording may hold: what a file claims is checked against this before memory is reserved for it."""

from __future__ import annotations

MAX_SAMPLES = 20_000_000
"""27 hours at 200 Hz: 1 GB of times and orientations."""
MAX_GRID_POINTS = 20_000_000
"""Points of an even grid over the time of a recording: 55 hours at 100 Hz."""


def too_many(name: str, what: str = "samples") -> str:
    """Return the sentence about a file with more than ``MAX_SAMPLES``."""
    return f"{name} has more than {MAX_SAMPLES // 10**6} million {what}; cut it into trials first"
