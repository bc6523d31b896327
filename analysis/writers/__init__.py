"""Orientation series to files of other tools; one module per format, each read back by its reader in a test.

:func:`write_series` picks the writer by name. Nothing is overwritten.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from analysis.series import OrientationSeries
from analysis.writers.kit_csv import write_kit_csv
from analysis.writers.matlab import write_matlab
from analysis.writers.parquet import write_parquet
from analysis.writers.ros_bag import write_ros_bag
from analysis.writers.series_csv import write_csv, write_endpoints_csv
from analysis.writers.tum import write_tum

__all__ = ["FORMATS", "write_series"]

Result = dict[str, Any] | None

FORMATS: dict[str, tuple[str, Callable[[OrientationSeries, Result, Path], tuple[str, ...]]]] = {
    "csv": ("CSV with named columns", write_csv),
    "endpoints": ("CSV of the end points, for rotdrift_score.m", write_endpoints_csv),
    "tum": ("TUM trajectory, for evo and SLAM tools", write_tum),
    "parquet": ("parquet, for pandas, polars, DuckDB", write_parquet),
    "mat": ("MATLAB and Octave file", write_matlab),
    "ros2": ("ROS 2 bag (a folder, MCAP storage)", write_ros_bag),
    "kit": ("the benchmark authors' CSV layout (T42)", write_kit_csv),
}
"""Name -> (what it is, writer). A writer returns what it had to leave out or make up, for people."""


def write_series(
    series: OrientationSeries, path: Path, kind: str, result: dict[str, Any] | None = None
) -> tuple[str, ...]:
    """Write a recording in another format.

    Parameters
    ----------
    series
        What to write.
    path
        Where; must not exist.
    kind
        One of ``FORMATS``.
    result
        Its score as JSON values, for the formats that hold end points.

    Returns
    -------
    What had to be left out or made up; empty where nothing was.

    Raises
    ------
    FileExistsError
        ``path`` exists.
    WriterError
        The format needs something that is not there: an extra package, a score.
    """
    if path.exists():
        raise FileExistsError(str(path))
    return FORMATS[kind][1](series, result, path)
