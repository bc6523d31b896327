"""Parquet tables with named columns; needs the extra ``rotdrift[parquet]``."""

from __future__ import annotations

import importlib
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.bounds import MAX_SAMPLES, too_many
from analysis.formats.columns import (
    QUATERNION,
    TIME_UNITS,
    ColumnSpec,
    column_numbers,
    guess_names,
    hint,
    samples_of,
)
from analysis.formats.named_csv import WRITTEN_POSITION
from analysis.formats.rows.names import label_column
from analysis.formats.rows.streams import LabelArray, StreamChoice, tells_apart
from analysis.formats.source import SourceFile, plain
from analysis.formats.time_stamps import RawSamples
from analysis.series import AnalysisError, FloatArray, OrientationSeries, ReaderError, WriterError

MAGIC = b"PAR1"


def _pyarrow(what: str, missing: type[AnalysisError]) -> tuple[Any, Any]:
    """Import pyarrow and its parquet module: an extra, and slow to import."""
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise missing(f"{what} pyarrow: pip install 'rotdrift[parquet]'") from error


def read_parquet(source: SourceFile, spec: ColumnSpec | None, choice: StreamChoice) -> RawSamples:
    """Read a parquet file; without a ``spec``, by the names of its columns. Missing values are holes.

    Raises
    ------
    ReaderError
        The extra is not installed, no such columns, a column without numbers; quaternions of several sensors.
    """
    arrow, tables = _pyarrow("parquet files need", ReaderError)
    try:
        file = tables.ParquetFile(source.rewound())
        header = tuple(file.schema_arrow.names)
        if spec is None:
            spec = guess_names(header, choice)
        if spec is None:
            there = ", ".join(plain(name) for name in header[:20])
            raise ReaderError(f"name the columns with {hint(header)}; the file has {there}")
        wanted = [header[number] for number in column_numbers(spec, header, len(header))]
        if file.metadata.num_rows > MAX_SAMPLES:
            raise ReaderError(too_many(source.name))
        values = np.empty((file.metadata.num_rows, len(wanted)))
        for place, (key, name) in enumerate(zip(spec.names, wanted, strict=True)):
            column = file.read(columns=[name], use_threads=False).column(name)  # all together would be held twice
            if len(column) != len(values):
                raise arrow.ArrowInvalid("columns of different lengths")
            if key == "t" and arrow.types.is_temporal(column.type):
                values[:, place] = _seconds(column, arrow) / TIME_UNITS[spec.time]
            else:
                values[:, place] = column.to_numpy()
        labels = _labels(file, header, wanted)
    except arrow.ArrowInvalid as error:
        raise ReaderError(f"{source.name} is not a sound parquet file: {plain(str(error), 120)}") from error
    except (TypeError, ValueError) as error:
        raise ReaderError(f"column {plain(name)} of {source.name} does not hold numbers") from error
    if len(values) == 0:
        raise ReaderError(f"{source.name} has no data rows: record again, or give another file")
    return replace(samples_of(values, spec), labels=labels)


def _seconds(column: Any, arrow: Any) -> FloatArray:  # noqa: ANN401 - pyarrow has no types
    """Return time stamps, durations or times of day as s."""
    unit = getattr(column.type, "unit", None)
    if unit is None:
        raise ReaderError("the time column holds days; store the time of each sample")
    width = arrow.int32() if arrow.types.is_time32(column.type) else arrow.int64()
    numbers: FloatArray = column.cast(width).to_numpy().astype(np.float64)
    return np.asarray(numbers * TIME_UNITS[unit], dtype=np.float64)


def _labels(
    file: Any,  # noqa: ANN401
    header: tuple[str, ...],
    wanted: list[str],
) -> LabelArray | None:
    """Return (n,) which sensor each row is of, by the first column whose name and values tell sensors apart."""
    for name in header:
        if name not in wanted and label_column(name):
            cells = file.read(columns=[name]).column(name).to_pylist()
            labels = np.array(["" if cell is None else str(cell) for cell in cells])
            if tells_apart(labels, named=True):
                return labels
    return None


def parquet_bytes(series: OrientationSeries) -> bytes:
    """Return samples as parquet: columns as in the CSV, int64 and float64; the same samples give the same bytes.

    Raises
    ------
    WriterError
        The extra is not installed.
    """
    arrow, tables = _pyarrow("parquet needs", WriterError)
    columns = {series.index_kind: series.index, "t_s": series.times_s}
    columns.update(zip(QUATERNION, series.quats_wxyz.T, strict=True))
    if series.positions_m is not None:
        columns.update(zip(WRITTEN_POSITION, series.positions_m.T, strict=True))
    table = arrow.table({name: arrow.array(values) for name, values in columns.items()})
    table = table.replace_schema_metadata({"convention": series.convention})
    buffer = io.BytesIO()
    tables.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def write_parquet(series: OrientationSeries, _result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a parquet file; see :func:`parquet_bytes`."""
    path.write_bytes(parquet_bytes(series))
    return ()
