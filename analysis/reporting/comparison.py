"""Results side by side: which may stand in one table, which differences are larger than their uncertainty, the plot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec

from analysis.reporting import style
from analysis.reporting.tables import ComparedRow, SummaryRow, TrialFigure, pool
from analysis.scoring.interval import NO_DRIFT
from analysis.series import AnalysisError

MANY = 10
"""From so many differences on, a note counts those that chance alone may call larger."""
CRITERION = (
    "A difference counts as larger than its uncertainty when it exceeds the root of the sum of squares of the two 95 % "
    "half-widths that face each other (never narrower than Welch's interval)."
)


class ComparisonError(AnalysisError):
    """Results that must not be compared without a warning: other conventions, other score versions; names them."""


@dataclass(frozen=True)
class ComparedSource:
    """One submission or result, as far as comparing needs it."""

    name: str
    rules: tuple[tuple[str, str], ...]
    """What decides the number: card, score version, conventions; (name, value)."""
    trials: tuple[TrialFigure, ...]
    note: str = ""
    """What a reader has to know about it, e.g. that it is incomplete."""
    unverified: str = ""
    """Why its numbers were not made again from the recordings; empty where they were, and are equal."""


@dataclass(frozen=True)
class Difference:
    """Two hands with the same object and motion."""

    object: str
    motion: str
    one: str
    """The hand that drifts more."""
    other: str
    """The hand that drifts less."""
    difference_deg: float
    """θ̄ of one minus θ̄ of other, ≥ 0."""
    uncertainty_deg: float | None
    """95 % half-width of the difference: root of the sum of squares of the half-widths that face each other.

    Source: the method of variance estimates recovery, G. Y. Zou and A. Donner, Statistics in Medicine 27 (2008) 1693.
    For intervals of Student's t it is never narrower than Cochran's or Welch's: it errs on the side of "within".
    """

    unverified: tuple[str, ...] = ()
    """Those of the two hands whose numbers were not made again."""

    @property
    def larger(self) -> bool | None:
        """Whether the difference is larger than its uncertainty; None where that is not known."""
        return None if self.uncertainty_deg is None else self.difference_deg > self.uncertainty_deg


@dataclass(frozen=True)
class Comparison:
    """Everything compared."""

    rows: tuple[ComparedRow, ...]
    """Hand, object, motion, pooled within each source."""
    differences: tuple[Difference, ...]
    """All pairs of hands with the same object and motion."""
    notes: tuple[str, ...]
    """What to keep in mind: mixed rules, incomplete submissions."""


def compare(sources: Sequence[ComparedSource], *, mix: bool = False) -> Comparison:
    """Return results side by side.

    Repeats are pooled within a source; the same hand in two sources stays two rows, each with the name of its source.
    With ``mix`` results made by different rules may stand in one table; the notes then name them.

    Raises
    ------
    ComparisonError
        Rules differ and ``mix`` is not set: names which, where.
    """
    notes = [f"NOT verified: {source.name}: {source.unverified}" for source in sources if source.unverified]
    notes += [f"{source.name}: {source.note}" for source in sources if source.note]
    mixed = _mixed(sources)
    if mixed and not mix:
        raise ComparisonError("; ".join(mixed))
    notes += [f"MIXED: {line}" for line in mixed]
    keys: dict[tuple[str, str, str], set[int]] = {}
    for place, source in enumerate(sources):
        for trial in source.trials:
            keys.setdefault((trial.hand, trial.object, trial.motion), set()).add(place)
    rows: list[ComparedRow] = []
    for source in sources:
        for row in pool(source.trials):
            several = len(keys[row.hand, row.object, row.motion]) > 1
            values = msgspec.structs.asdict(row) | ({"hand": f"{row.hand} [{source.name}]"} if several else {})
            rows.append(ComparedRow(**values, unverified=source.unverified))
    rows.sort(key=lambda row: (row.object, row.motion, row.hand))
    notes += [
        f"θ̄ of {', '.join(filter(None, (row.hand, row.object, row.motion)))} {NO_DRIFT}: its interval touches 0"
        for row in rows
        if row.interval_deg is not None and row.interval_deg[0] <= 0.0
    ]
    differences = _differences(rows)
    known = sum(difference.larger is not None for difference in differences)
    if known >= MANY:
        notes.append(
            f"{known} differences are judged, each at 95 %: where nothing differs at all, up to {round(0.05 * known)} "
            "of them would still be called larger"
        )
    return Comparison(tuple(rows), tuple(differences), tuple(notes))


def _mixed(sources: Sequence[ComparedSource]) -> list[str]:
    found = []
    names = dict.fromkeys(name for source in sources for name, _ in source.rules)
    for name in names:
        values: dict[str, list[str]] = {}
        for source in sources:
            values.setdefault(dict(source.rules).get(name, "not stated"), []).append(source.name)
        if len(values) > 1:
            stated = ", ".join(f"'{value}' in {' and '.join(where)}" for value, where in values.items())
            found.append(f"{name} is {stated}")
    return found


def _differences(rows: Sequence[ComparedRow]) -> list[Difference]:
    found = []
    for place, first in enumerate(rows):
        for second in rows[place + 1 :]:
            if (first.object, first.motion) != (second.object, second.motion):
                continue
            if first.theta_bar_mean_deg is None or second.theta_bar_mean_deg is None:
                continue
            means_deg = ((first.theta_bar_mean_deg, first), (second.theta_bar_mean_deg, second))
            (less_deg, less), (more_deg, more) = sorted(means_deg, key=lambda item: item[0])
            found.append(_difference(more, more_deg, less, less_deg))
    return found


def _difference(more: ComparedRow, more_deg: float, less: ComparedRow, less_deg: float) -> Difference:
    uncertainty = None
    if more.interval_deg is not None and less.interval_deg is not None:
        low_deg, high_deg = more.interval_deg
        # One that was cut at 0 is as wide below as above, or wider.
        below_deg = max(more_deg - low_deg, high_deg - more_deg)
        uncertainty = math.hypot(below_deg, less.interval_deg[1] - less_deg)
    unverified = tuple(row.hand for row in (more, less) if row.unverified)
    return Difference(more.object, more.motion, more.hand, less.hand, more_deg - less_deg, uncertainty, unverified)


def compare_figures(rows: Sequence[ComparedRow], whole: Comparison) -> Comparison:
    """Return some rows of a comparison, with every difference that has to do with them."""
    hands = {(row.object, row.motion, row.hand) for row in rows}
    kept = [
        difference
        for difference in whole.differences
        if {(difference.object, difference.motion, hand) for hand in (difference.one, difference.other)} & hands
    ]
    return replace(whole, rows=tuple(rows), differences=tuple(kept))


def difference_text(difference: Difference) -> str:
    """Return a difference as a sentence."""
    size = f"{difference.one} drifts {difference.difference_deg:.3f}° per cycle more than {difference.other}"
    if difference.uncertainty_deg is None:
        verdict = "no interval: whether that is more than chance is not known"
    else:
        relation = "larger than" if difference.larger else "within"
        verdict = f"{relation} the uncertainty of ±{difference.uncertainty_deg:.3f}°"
    doubt = f"; not verified: {' and '.join(difference.unverified)}" if difference.unverified else ""
    return f"{difference.object}, {difference.motion}: {size}; {verdict}{doubt}"


@style.style()
def forest_figure(rows: Sequence[SummaryRow]) -> style.PaperFigure:
    """Return a figure: θ̄ of every row with its interval, grouped by object and motion.

    What was not verified has an open mark, and words beside it.
    """
    groups = list(dict.fromkeys((row.object, row.motion) for row in rows))
    figure = style.new_figure(0.9 + 0.21 * (len(rows) + len(groups)), 6.0)
    ax = figure.subplots()
    y, ticks, labels = 0.0, [], []
    for group in groups:
        ax.text(
            0.0, y, _short(f"{group[0]} · {group[1]}", 75), transform=ax.get_yaxis_transform(), va="center",
            weight="bold", fontsize=7, bbox={"fc": "white", "ec": "none", "pad": 1.0}, in_layout=False,
        )  # fmt: skip
        y += 1.0
        for row in (row for row in rows if (row.object, row.motion) == group):
            ticks.append(y)
            labels.append(_short(row.hand, 32))
            if row.theta_bar_mean_deg is None:
                text = "no score"
            else:
                if row.interval_deg is not None:
                    ax.plot(row.interval_deg, [y, y], "-", color=style.BLUE, lw=1.8, solid_capstyle="butt")
                doubtful = isinstance(row, ComparedRow) and row.unverified
                fill, edge = ("white", style.VERMILION) if doubtful else (style.VERMILION, "white")
                ax.plot(row.theta_bar_mean_deg, y, "s", mfc=fill, ms=4.5, mec=edge, mew=0.9 if doubtful else 0.4)
                ends = "" if row.interval_deg is None else f" ({row.interval_deg[0]:.3f} … {row.interval_deg[1]:.3f})"
                text = f"{row.theta_bar_mean_deg:.3f}{ends}, n = {row.n_valid}{', not verified' if doubtful else ''}"
            ax.annotate(
                text, (1.01, y), xycoords=("axes fraction", "data"), va="center", fontsize=6.5, annotation_clip=False
            )
            y += 1.0
    ax.set_yticks(ticks, labels)
    ax.set_ylim(y - 0.4, -0.6)
    ax.set_xlim(left=0.0)
    ax.grid(axis="x", color=style.LIGHT, lw=0.4)
    ax.set_axisbelow(True)
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("θ̄ (° per cycle), 95 % interval; further left is better; n = trials")
    return figure


def forest_bytes(rows: Sequence[SummaryRow], kind: str) -> bytes:
    """Return the forest figure as a file of this kind (``png``, ``svg``, ``pdf``), sorted by object, motion, hand."""
    ordered = sorted(rows, key=lambda row: (row.object, row.motion, row.hand))
    return style.figure_bytes(forest_figure(ordered), kind)


def _short(text: str, most: int) -> str:
    """Return a long name cut where there is no room: head and end distinguish it from others."""
    kept = style.drawable(text)
    return kept if len(kept) <= most else f"{kept[: most - most // 3 - 1]}…{kept[-(most // 3) :]}"
