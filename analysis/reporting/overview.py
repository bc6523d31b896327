"""What stands before the trials of a report: repeats pooled, and θ̄ of everything in one picture."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.reporting import style as look
from analysis.reporting.comparison import forest_figure
from analysis.reporting.tables import COLUMNS as COLUMNS
from analysis.reporting.tables import PooledFigure, TrialFigure, figure_cells, pool
from analysis.reporting.trial_report import TrialReport


def pooled(trials: Sequence[TrialReport]) -> list[PooledFigure]:
    """Pool the repeats among the trials of a report; see :func:`analysis.reporting.tables.pool`."""
    return pool(
        [
            TrialFigure(trial.hand, trial.object, trial.motion, trial.view.theta_bar_deg, trial.view.interval_deg)
            for trial in trials
        ]
    )


def cells(row: PooledFigure) -> tuple[str, ...]:
    """Write a row of the summary as texts, one for each of ``COLUMNS``."""
    return (row.hand, row.object, row.motion, *figure_cells(row))


def forest(rows: Sequence[PooledFigure], kind: str) -> bytes:
    """Draw θ̄ of every row with its interval, as a file of this kind (``png``, ``svg``, ``pdf``)."""
    with look.style():
        ordered = sorted(rows, key=lambda row: (row.object, row.motion, row.hand))
        return look.figure_bytes(forest_figure(ordered), kind)
