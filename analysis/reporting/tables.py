"""Repeats pooled, and the summary as CSV, Markdown and LaTeX. Only here are trials pooled."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from analysis.formats.named_csv import safe_cell
from analysis.series import FloatArray


@dataclass(frozen=True)
class TrialFigure:
    """One trial as the summary needs it."""

    hand: str
    object: str
    motion: str
    theta_bar_deg: float | None
    """θ̄, None where no score is claimed."""
    interval_deg: tuple[float, float] | None
    """Its interval within the trial."""


class SummaryRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Repeats of one hand, object and motion, pooled."""

    hand: str
    object: str
    motion: str
    n_trials: int
    n_valid: int
    theta_bar_mean_deg: float | None
    theta_bar_min_deg: float | None
    theta_bar_max_deg: float | None
    interval_low_deg: float | None
    """Ends of the 95 % interval, see ``interval_kind``."""
    interval_high_deg: float | None
    interval_kind: str
    """``within the trial``: of the only one; ``between trials``: t interval of the mean; ``none``."""

    @property
    def interval_deg(self) -> tuple[float, float] | None:
        """Both ends of the interval; None where there is none."""
        low, high = self.interval_low_deg, self.interval_high_deg
        return None if low is None or high is None else (low, high)

    @property
    def figures(self) -> tuple[str, str, str, str]:
        """Mean, interval, range and number of trials as texts; an em dash where there is none."""
        low, high = self.theta_bar_min_deg, self.theta_bar_max_deg
        mean = "—" if self.theta_bar_mean_deg is None else f"{self.theta_bar_mean_deg:.3f}"
        ends = "—" if self.interval_deg is None else f"{self.interval_deg[0]:.3f} … {self.interval_deg[1]:.3f}"
        spread = "—" if low is None or high is None or self.n_valid < 2 else f"{low:.3f} … {high:.3f}"
        count = str(self.n_trials) if self.n_valid == self.n_trials else f"{self.n_valid} of {self.n_trials} valid"
        return mean, ends, spread, count

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as texts, one for each of :data:`COLUMNS`."""
        return (self.hand, self.object, self.motion, *self.figures)


class ComparedRow(SummaryRow, frozen=True, forbid_unknown_fields=True):
    """A row of a comparison: whether its numbers were made again from the recordings stands beside them."""

    unverified: str
    """Why they were not; empty where they were."""

    @property
    def verified(self) -> str:
        """The cell that a reader sees."""
        return f"not verified: {self.unverified}" if self.unverified else "yes"


VERIFIED = "verified"
"""Name of that column, in comparisons only."""


def pool(trials: Sequence[TrialFigure]) -> list[SummaryRow]:
    """Return repeats pooled: mean, range, and an interval of the mean.

    With two or more valid repeats the interval is mean ± t(0.975, k − 1)·s/√k over their θ̄, cut at 0: it holds what
    differs from trial to trial, which no single trial shows. With one it is that trial's own.

    Parameters
    ----------
    trials : sequence of TrialFigure
        In any order.

    Returns
    -------
    One row per hand, object and motion, sorted by these.
    """
    groups: dict[tuple[str, str, str], list[TrialFigure]] = {}
    for trial in trials:
        groups.setdefault((trial.hand, trial.object, trial.motion), []).append(trial)
    pooled = []
    for (hand, thing, motion), group in sorted(groups.items()):
        valid = [trial for trial in group if trial.theta_bar_deg is not None]
        values: FloatArray = np.array([trial.theta_bar_deg for trial in valid], dtype=np.float64)
        interval, kind = _interval(values, valid)
        pooled.append(
            SummaryRow(
                hand=hand,
                object=thing,
                motion=motion,
                n_trials=len(group),
                n_valid=len(valid),
                theta_bar_mean_deg=float(values.mean()) if len(values) else None,
                theta_bar_min_deg=float(values.min()) if len(values) else None,
                theta_bar_max_deg=float(values.max()) if len(values) else None,
                interval_low_deg=None if interval is None else interval[0],
                interval_high_deg=None if interval is None else interval[1],
                interval_kind=kind,
            )
        )
    return pooled


def _interval(values: FloatArray, valid: Sequence[TrialFigure]) -> tuple[tuple[float, float] | None, str]:
    from scipy.special import stdtrit  # slow to import

    if len(values) == 1:
        return valid[0].interval_deg, "within the trial" if valid[0].interval_deg else "none"
    if len(values) == 0:
        return None, "none"
    mean = float(values.mean())
    half = float(stdtrit(len(values) - 1, 0.975)) * float(values.std(ddof=1)) / math.sqrt(len(values))
    return (max(0.0, mean - half), mean + half), "between trials"


COLUMNS = ("hand", "object", "motion", "θ̄ (°)", "95 % interval (°)", "range (°)", "trials")


def summary_csv(rows: Sequence[SummaryRow]) -> str:
    """Return the summary as CSV, full precision, units in the names."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    names = "hand object motion theta_bar_mean_deg interval_low_deg interval_high_deg interval_kind"
    names += " theta_bar_min_deg theta_bar_max_deg n_valid n_trials"
    writer.writerow([*names.split(), *_compared(rows, VERIFIED)])
    for row in rows:
        texts = map(safe_cell, (row.hand, row.object, row.motion))
        numbers = map(_exact, (row.theta_bar_mean_deg, row.interval_low_deg, row.interval_high_deg))
        ends = map(_exact, (row.theta_bar_min_deg, row.theta_bar_max_deg))
        counts = (row.n_valid, row.n_trials)
        writer.writerow([*texts, *numbers, row.interval_kind, *ends, *counts, *map(safe_cell, _verified(row))])
    return buffer.getvalue()


def summary_markdown(rows: Sequence[SummaryRow]) -> str:
    """Return the summary as a Markdown table."""
    lines = [f"| {' | '.join([*COLUMNS, *_compared(rows, VERIFIED)])} |"]
    lines.append(f"|---|---|---|---:|---:|---:|---:|{''.join(_compared(rows, '---|'))}")
    for row in rows:
        cells = [_escaped(cell) for cell in (row.hand, row.object, row.motion)]
        lines.append("| " + " | ".join([*cells, *row.figures, *map(_escaped, _verified(row))]) + " |")
    return "\n".join(lines) + "\n"


def summary_latex(rows: Sequence[SummaryRow]) -> str:
    """Return the summary as a LaTeX table (booktabs)."""
    lines = [
        "% needs \\usepackage{booktabs}; names in other than Latin letters need XeLaTeX or LuaLaTeX",
        f"\\begin{{tabular}}{{lllrrrr{''.join(_compared(rows, 'l'))}}}",
        "\\toprule",
        "Hand & Object & Motion & $\\bar{\\theta}$ ($^\\circ$) & 95\\,\\% interval ($^\\circ$) & Range ($^\\circ$) & "
        f"{' & '.join(['Trials', *_compared(rows, 'Verified')])} \\\\",
        "\\midrule",
    ]
    for row in rows:
        cells = [_latex(cell) for cell in (row.hand, row.object, row.motion)]
        figures = [figure.replace("…", "--").replace("—", "---") for figure in row.figures]
        lines.append(" & ".join([*cells, *figures, *map(_latex, _verified(row))]) + " \\\\")
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"


def _compared(rows: Sequence[SummaryRow], text: str) -> list[str]:
    """Return a text in a list of its own where the rows are those of a comparison, which has one column more."""
    return [text] if any(isinstance(row, ComparedRow) for row in rows) else []


def _verified(row: SummaryRow) -> list[str]:
    return [row.verified] if isinstance(row, ComparedRow) else []


def _exact(value: float | None) -> str:
    return "" if value is None else repr(value)


def _escaped(text: str) -> str:
    return re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", text).replace("\n", " ")


_LATEX = {
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
    "×": "$\\times$",
    "⌀": "$\\oslash$",
    "<": "\\textless{}",
    ">": "\\textgreater{}",
    "|": "\\textbar{}",
    '"': "''",
    "…": "\\ldots{}",
    "·": "$\\cdot$",
    "±": "$\\pm$",
    "−": "$-$",
    "µ": "$\\mu$",
    "\ufffd": "?",
    "θ": "$\\theta$",
    "°": "$^\\circ$",
    "`": "\\textasciigrave{}",
    "'": "{'}",
    "[": "{[}",  # at the start of a line it would be an argument of the line break before, as the star
    "*": "{*}",
    **{character: "\\" + character for character in "&%$#_{}"},
}


def _latex(text: str) -> str:
    """Return a text so written that LaTeX sets it as it is."""
    written = "".join(_LATEX.get(character, character) for character in text).replace("\n", " ")
    return re.sub("-(?=-)", "-{}", written)  # two hyphens would become a dash
