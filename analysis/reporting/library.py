"""What notebooks and other programs use of reporting: one figure, and a result as a small HTML table."""

from __future__ import annotations

from html import escape
from typing import Any

from analysis.reporting import style as look
from analysis.reporting import wording
from analysis.reporting.figure_set import CAPTIONS, make_figure
from analysis.reporting.trial_report import TrialReport
from analysis.series import OrientationSeries

_LEFT = "style='text-align:left'"


def draw(result: dict[str, Any], series: OrientationSeries, name: str) -> look.PaperFigure:
    """Draw one figure of a score given as JSON values; see :func:`analysis.plot`.

    Raises
    ------
    ValueError
        An unknown name, or nothing to show in it.
    """
    if name not in CAPTIONS:
        raise ValueError(f"there is no figure {name!r}; there are {', '.join(CAPTIONS)}")
    with look.style():
        figure = make_figure(_trial(result, series), name)
    if figure is None:
        raise ValueError(f"this result has nothing to show in the figure {name!r}")
    return figure


def result_html(result: dict[str, Any]) -> str:
    """Write a result as an HTML table for notebooks: the number first, then trust.

    Parameters
    ----------
    result
        A score as JSON values.
    """
    trial = _trial(result, None)
    view = trial.view
    if view.valid:
        ends = wording.interval_text(trial)
        head = f"θ̄ = {wording.degrees(view.theta_bar_deg)}° per cycle" + (f" ({ends})" if ends else "")
    else:
        head = "no score: " + "; ".join(result.get("reasons") or [])
    rows = [("end points", str(view.n_endpoints), ""), *wording.trust_rows(trial)]
    cells = "".join(
        f"<tr><th {_LEFT}>{escape(label)}</th><td>{escape(value)}</td><td {_LEFT}>{escape(why)}</td></tr>"
        for label, value, why in rows
    )
    warnings = "".join(f"<li>{escape(str(warning))}</li>" for warning in result.get("warnings") or [])
    return f"<b>{escape(head)}</b><table>{cells}</table>" + (f"<ul>{warnings}</ul>" if warnings else "")


def _trial(result: dict[str, Any], series: OrientationSeries | None) -> TrialReport:
    if series is None:
        import numpy as np

        series = OrientationSeries(np.zeros(0), np.zeros((0, 4)), np.zeros(0, dtype=np.int64))
    return TrialReport(id="", hand="", object="", motion="", series=series, result=result)
