"""Arrays in, results out: orientation series, cycles, the drift score and its trust.

For notebooks and other programs::

    import analysis

    series = analysis.load("trial.csv")
    result = analysis.score(series)
    result.theta_bar_deg, result.interval_deg, result.warnings
    analysis.plot(result, series)

Everything else is in the modules; these three names do not change between minor versions.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.reporting.style import PaperFigure
    from analysis.scoring.result import Result
    from analysis.series import OrientationSeries

__all__ = ["load", "plot", "score"]


def load(path: str | Path, *, columns: str | None = None, rate_hz: float | None = None) -> OrientationSeries:
    """Read a recording; the format is recognised from the content.

    Parameters
    ----------
    path : str or Path
        The authors' CSV, CSV with named columns, TUM, x-IMU3, parquet, ROS bag, MCAP.
    columns : str, optional
        What the columns mean, e.g. ``"t=time,qw=w,qx=x,qy=y,qz=z"`` (:mod:`analysis.formats.columns`).
    rate_hz : float, optional
        Sampling rate where the file has no time stamps.

    Raises
    ------
    ReaderError
        Not a file known here, or damaged.
    """
    from analysis.formats import read_series

    return read_series(path, columns=columns, rate_hz=rate_hz)


def score(series: OrientationSeries, *, window: tuple[float | None, float | None] | None = None) -> Result:
    """Score a recording by the benchmark card; see :func:`analysis.scoring.trial.score_series` for every option.

    ``window`` is (from, to) in s; without one the search finds the cycles by itself. Where no drift can be claimed,
    ``valid`` of the result is False, and its ``reasons`` name why.
    """
    from analysis.scoring.trial import score_series

    return score_series(series, window=window)


def plot(result: Result, series: OrientationSeries, name: str = "rotation_cloud") -> PaperFigure:
    """Draw a figure of a scored recording; a notebook shows it, ``figure.savefig`` writes it.

    ``name`` is one of ``rotation_cloud``, ``sphere``, ``translation_cloud``, ``rotation``, ``steps``, ``drift``,
    ``sensitivity``, ``link``.

    Raises
    ------
    ValueError
        Another name, or nothing to show in it.
    """
    from analysis.reporting.figure_set import make_figure

    figure = make_figure(series, result, name)
    if figure is None:
        raise ValueError(f"this result has nothing to show in the figure {name!r}")
    return figure
