"""Files of orientations to :class:`~analysis.series.OrientationSeries`, and back; one module per format.

:func:`read_series` picks the reader from the content of the file, never from its name. Every reader says in the
series which convention it read with, and what it assumed. :func:`write_series` picks the writer by name; nothing is
overwritten.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.formats.columns import ColumnSpec, parse_columns
from analysis.formats.conventions import convention_warnings
from analysis.formats.kit_csv import is_ndx, is_t42, read_ndx, read_t42, write_kit_csv
from analysis.formats.matlab import write_matlab
from analysis.formats.named_csv import guess_columns, read_named, write_csv, write_endpoints_csv
from analysis.formats.parquet import MAGIC as PARQUET_MAGIC
from analysis.formats.parquet import read_parquet, write_parquet
from analysis.formats.ros_bag import MCAP_MAGIC, is_bag, read_ros_bag, write_ros_bag
from analysis.formats.text_table import delimiter_of, head_lines, is_numeric_row, plain, split_row
from analysis.formats.time_stamps import RawSamples, to_series
from analysis.formats.tum import is_tum, read_tum, write_tum
from analysis.formats.ximu3_csv import is_ximu3, read_ximu3
from analysis.series import OrientationSeries, ReaderError

__all__ = ["FORMATS", "ColumnSpec", "ReaderError", "is_mcap", "parse_columns", "read_series", "write_series"]

_KNOWN = "the benchmark authors' CSV, CSV with --columns, TUM, x-IMU3 CSV, parquet, ROS bag or MCAP"

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


def is_mcap(path: Path) -> bool:
    """Tell whether a file is MCAP: a recording of this program, or a ROS 2 bag.

    Parameters
    ----------
    path
        The file.
    """
    with path.open("rb") as file:
        return file.read(len(MCAP_MAGIC)) == MCAP_MAGIC


def read_series(
    path: Path | str,
    *,
    columns: str | ColumnSpec | None = None,
    rate_hz: float | None = None,
    topic: str | None = None,
) -> OrientationSeries:
    """Read a file of orientations; the format is recognised from the content.

    A recording of this program is MCAP with the raw bytes of the link in it; those are decoded by the program, not
    here. An MCAP file that comes here is read as a ROS 2 one.

    Parameters
    ----------
    path
        File, or folder of a ROS 2 bag.
    columns
        What the columns of a CSV or parquet file mean (:mod:`analysis.formats.columns`); None to recognise them.
    rate_hz
        Sampling rate where the file has no time stamps.
    topic
        Which topic of a bag, or which station of a Polhemus tracker's file.

    Returns
    -------
    OrientationSeries

    Raises
    ------
    ReaderError
        Not a file known here, or damaged: names the line or row and what to do.
    OSError
        The file cannot be opened.
    """
    place = Path(path)
    spec = parse_columns(columns) if isinstance(columns, str) else columns
    series = to_series(_raw_samples(place, spec, topic), rate_hz)
    found = convention_warnings(series)
    return replace(series, warnings=(*series.warnings, *found)) if found else series


def _raw_samples(path: Path, spec: ColumnSpec | None, topic: str | None) -> RawSamples:
    if path.is_dir():
        if not is_bag(path, b""):
            raise ReaderError(
                f"{plain(path.name, 80)} is a folder without metadata.yaml, so no ROS 2 bag: give a file in it"
            )
        return read_ros_bag(path, topic)
    with path.open("rb") as file:
        start = file.read(16)
    if not start:
        raise ReaderError(f"{plain(path.name, 80)} is empty: record again, or give another file")
    if is_bag(path, start):
        return read_ros_bag(path, topic)
    if start.startswith(PARQUET_MAGIC):
        return read_parquet(path, spec)
    return _text_samples(path, head_lines(path), spec, topic)


def _text_samples(path: Path, lines: list[str], spec: ColumnSpec | None, topic: str | None) -> RawSamples:
    if spec is not None:
        return read_named(path, lines, spec)
    if is_ximu3(lines):
        return read_ximu3(path, lines)
    if is_t42(lines):
        return read_t42(path, lines)
    if is_ndx(lines):
        return read_ndx(path, lines, topic)
    if is_tum(lines):
        return read_tum(path, lines)
    guessed = guess_columns(lines)
    if guessed is not None:
        return read_named(path, lines, guessed, declared=False)
    if not lines:
        raise ReaderError(f"{plain(path.name, 80)} is empty: record again, or give another file")
    first = lines[0]
    what = (
        "columns without names"
        if is_numeric_row(split_row(first, delimiter_of(lines)))
        else f"it starts with '{plain(first)}'"
    )
    raise ReaderError(
        f"{plain(path.name, 80)} is not a file known here ({what}); known are {_KNOWN}; name the columns with "
        "--columns t=…,qw=…,qx=…,qy=…,qz=…"
    )


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
