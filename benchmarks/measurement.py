"""How everything is measured: interleaved rounds, medians with ranges, ratios from the same round.

Times are CPU seconds of the process, so that a busy machine lengthens them less than it would the clock on the wall.
What is compared runs in turn within each round; a ratio is taken per round, and its median and range are reported: what
slows the machine for seconds slows both sides.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from statistics import median
from typing import Any

GAIN, COST, PLAIN = ">=", "<=", ""


@dataclass(frozen=True)
class Row:
    """One figure of the table."""

    name: str
    value: float
    unit: str
    low: float | None = None
    """Least of all rounds."""
    high: float | None = None
    goal: float | None = None
    sense: str = PLAIN
    """``>=`` where more is better, ``<=`` where less is."""
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the median meets the goal; None without one."""
        if self.goal is None:
            return None
        return self.value >= self.goal if self.sense == GAIN else self.value <= self.goal

    def plain(self) -> dict[str, Any]:
        """As JSON values."""
        return {**asdict(self), "met": self.met}


@dataclass(frozen=True)
class Curve:
    """One line of a growth plot."""

    name: str
    x_label: str
    y_label: str
    x: tuple[float, ...]
    y: tuple[float, ...]


@dataclass
class Topic:
    """What one module measured."""

    title: str
    rows: list[Row] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    """What could not be measured here, and why."""
    text: str = ""
    """Preformatted text for the table: a profile."""


def cpu_s(function: Callable[[], object]) -> float:
    """CPU seconds of one call, all threads."""
    start = time.process_time()
    function()
    return time.process_time() - start


def rounds_of(functions: Mapping[str, Callable[[], object]], n: int, warm: bool = True) -> dict[str, list[float]]:
    """CPU seconds of each function in each of n rounds; they take turns."""
    if warm:
        for function in functions.values():
            function()
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(n):
        for name, function in functions.items():
            times[name].append(cpu_s(function))
    return times


def figure(
    name: str, values: list[float], unit: str, note: str = "", goal: float | None = None, sense: str = ""
) -> Row:
    """Median and range of values."""
    return Row(name, median(values), unit, min(values), max(values), goal, sense, note)


def ratio(
    name: str,
    over: list[float],
    under: list[float],
    goal: float | None = None,
    sense: str = GAIN,
    factor: float = 1.0,
    note: str = "",
) -> Row:
    """Median and range of ``over / under * factor``, round by round."""
    ratios = [factor * a / b for a, b in zip(over, under, strict=True)]
    return figure(name, ratios, "×", note, goal, sense)
