"""Files of orientations to :class:`~analysis.series.OrientationSeries`, and back; one module per format.

:func:`read_series` picks the reader from the content of the file, never from its name. Every reader notes in
the series which convention it read with, and what it assumed. :func:`write_series` picks the writer by name; nothing is
overwritten.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from analysis.formats.apart import read_bag_apart, read_parquet_apart
from analysis.formats.columns import ColumnSpec, guess_names, hint, parse_columns
from analysis.formats.conventions import convention_warnings
from analysis.formats.kit_csv import is_ndx, is_t42, read_ndx, read_t42, write_kit_csv
from analysis.formats.matlab import write_matlab
from analysis.formats.named_csv import read_named, write_csv, write_endpoints_csv
from analysis.formats.parquet import MAGIC as PARQUET_MAGIC
from analysis.formats.parquet import write_parquet
from analysis.formats.ros_bag import is_bag, is_mcap, write_ros_bag
from analysis.formats.rows.streams import SeveralStreamsError, StreamChoice
from analysis.formats.source import SourceFile, plain
from analysis.formats.text_table import TextTable
from analysis.formats.time_stamps import RawSamples, to_series
from analysis.formats.tum import is_tum, read_tum, write_tum
from analysis.formats.ximu3_csv import is_diagnostic, is_ximu3, read_ximu3
from analysis.series import OrientationSeries, ReaderError

__all__ = [
    "FORMATS",
    "ReaderError",
    "SeveralStreamsError",
    "SourceFile",
    "StreamChoice",
    "is_diagnostic",
    "is_mcap",
    "parse_columns",
    "read_series",
    "write_series",
]

_KNOWN = (
    "the benchmark authors' CSV, CSV with --columns, TUM, x-IMU3 CSV, parquet, ROS bag or MCAP, and CAN logs (candump "
    "-l, ASC, BLF, TRC, python-can's CSV)"
)
_PACKED = {
    b"\x1f\x8b": "gzip",
    b"\x28\xb5\x2f\xfd": "zstandard",
    b"PK\x03\x04": "zip",
    b"\xfd7zXZ\0": "xz",
    b"BZh": "bzip2",
    b"\x04\x22\x4d\x18": "lz4",
    b"7z\xbc\xaf\x27\x1c": "7z",
}
"""First bytes -> how a file is packed."""

Writer = Callable[[OrientationSeries, dict[str, Any] | None, Path], tuple[str, ...]]

FORMATS: dict[str, tuple[str, Writer]] = {
    "csv": ("CSV with named columns", write_csv),
    "endpoints": ("CSV of the end points, for rotdrift_score.m", write_endpoints_csv),
    "tum": ("TUM trajectory, for evo and SLAM tools", write_tum),
    "parquet": ("parquet, for pandas, polars, DuckDB", write_parquet),
    "mat": ("MATLAB and Octave file", write_matlab),
    "ros2": ("ROS 2 bag (a folder, MCAP storage)", write_ros_bag),
    "kit": ("the benchmark authors' CSV layout (T42)", write_kit_csv),
}
"""Name -> (what it is, writer). A writer returns what it had to leave out or make up, for people."""


def read_series(
    source: Path | str | SourceFile,
    *,
    columns: str | None = None,
    rate_hz: float | None = None,
    topic: str | None = None,
    choice: StreamChoice | None = None,
) -> OrientationSeries:
    """Read a file of orientations; the format is recognised from the content.

    A recording of this program is MCAP with the raw bytes of the link in it; those are decoded by the program, not
    here. An MCAP file that comes here is read as a ROS 2 one.

    Parameters
    ----------
    source : Path or str or SourceFile
        File, or folder of a ROS 2 bag; one that is open already is not opened again.
    columns : str, optional
        What the columns of a CSV or parquet file mean (:mod:`analysis.formats.columns`); None to recognise them.
    rate_hz : float, optional
        Sampling rate where the file has no time stamps.
    topic : str, optional
        Which topic of a bag, or which station of a Polhemus tracker's file.
    choice : StreamChoice, optional
        Which sensor, channel or session, where there are several.

    Raises
    ------
    ReaderError
        Not a file known here, or damaged: names the line or row and what to do.
    OSError
        The file cannot be opened.
    """
    if not isinstance(source, SourceFile):
        with SourceFile(Path(source)) as opened:
            return read_series(opened, columns=columns, rate_hz=rate_hz, topic=topic, choice=choice)
    choice = choice or StreamChoice()
    spec = parse_columns(columns) if columns is not None else None
    series = to_series(_raw_samples(source, spec, topic, choice), source.label, rate_hz, choice)
    return series.with_remarks(warnings=convention_warnings(series))


def _raw_samples(source: SourceFile, spec: ColumnSpec | None, topic: str | None, choice: StreamChoice) -> RawSamples:
    if is_bag(source):
        return read_bag_apart(source, topic, choice)
    if source.path.is_dir():
        raise ReaderError(f"{source.name} is a folder without metadata.yaml, so no ROS 2 bag: give a file in it")
    if source.head.startswith(PARQUET_MAGIC):
        return read_parquet_apart(source, spec, choice)
    packed = next((name for magic, name in _PACKED.items() if source.head.startswith(magic)), None)
    if packed is not None:
        raise ReaderError(f"{source.name} is packed ({packed}): unpack it and give the file in it")
    return _text_samples(TextTable(source), spec, topic, choice)


def _text_samples(table: TextTable, spec: ColumnSpec | None, topic: str | None, choice: StreamChoice) -> RawSamples:
    """Read a text file by the columns declared, or by the first layout that claims it."""
    if spec is not None:
        return read_named(table, spec)
    if is_ximu3(table):
        return read_ximu3(table)
    if is_t42(table):
        return read_t42(table)
    if is_ndx(table):
        return read_ndx(table, topic if topic is not None else choice.sensor)
    if is_tum(table):
        return read_tum(table)
    guessed = guess_names(table.names, choice)
    if guessed is not None:
        return read_named(table, guessed)
    what = f"it starts with '{plain(table.lines[0])}'" if table.names else "columns without names"
    raise ReaderError(
        f"{table.source.name} is not a file known here ({what}); known are {_KNOWN}; name the columns with "
        f"{hint(table.names)}"
    )


def write_series(
    series: OrientationSeries, path: Path, kind: str, result: dict[str, Any] | None = None
) -> tuple[str, ...]:
    """Write a recording in another format.

    Parameters
    ----------
    series : OrientationSeries
        What to write.
    path : Path
        Where; must not exist.
    kind : str
        One of ``FORMATS``.
    result : dict, optional
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
