"""One trial as the report shows it: score, samples, cards as texts, provenance. Filled by the host, drawn here."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.reporting.tables import TrialFigure
from analysis.scoring.result import Result
from analysis.series import OrientationSeries


@dataclass(frozen=True)
class CardRow:
    """One line of a card."""

    label: str
    value: str
    """As text with its unit; empty where it is not known."""
    required: bool = False
    """Whether the benchmark card asks for it."""


@dataclass(frozen=True)
class CardTable:
    """One card."""

    title: str
    """``Object``, ``Hand``, ``Trial``."""
    rows: tuple[CardRow, ...]
    """In the order of the card."""


@dataclass(frozen=True, eq=False)
class TrialReport:
    """Everything in the report about one trial."""

    id: str
    """Name of its folder in the bundle: lower case, digits, ``-``."""
    hand: str
    """Hand model, or ``unknown hand``."""
    object: str
    """Object type and size, or ``unknown object``."""
    motion: str
    """Manipulation motion, or ``unknown motion``."""
    series: OrientationSeries
    result: Result
    cards: tuple[CardTable, ...] = ()
    comments: str = ""
    """Comments on the result, of the operator."""
    missing: tuple[str, ...] = ()
    """Required fields that no card has."""
    notes: tuple[str, ...] = ()
    """What was met on the way: reader, cards, damage."""
    provenance: tuple[tuple[str, str], ...] = ()
    """Where everything came from: name and value."""

    @property
    def figure(self) -> TrialFigure:
        """What of it goes into tables."""
        result = self.result
        return TrialFigure(self.hand, self.object, self.motion, result.theta_bar_deg, result.interval_deg)

    @property
    def title(self) -> str:
        """What was done, in one line."""
        return f"{self.object} · {self.motion} · {self.hand}"
