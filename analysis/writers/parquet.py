"""Parquet tables with named columns; needs the extra ``rotdrift[parquet]``."""

from __future__ import annotations

import importlib
import io
from pathlib import Path
from typing import Any

from analysis.series import OrientationSeries
from analysis.writers.errors import WriterError
from analysis.writers.series_csv import POSITION, QUATERNION


def parquet_bytes(series: OrientationSeries) -> bytes:
    """Write samples as parquet; the same samples give the same bytes.

    Parameters
    ----------
    series
        What to write; columns as in the CSV, int64 and float64.

    Raises
    ------
    WriterError
        The extra is not installed.
    """
    try:
        arrow: Any = importlib.import_module("pyarrow")  # an extra, and slow to import
        tables: Any = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise WriterError("parquet needs pyarrow: pip install 'rotdrift[parquet]'") from error
    columns = {series.index_kind: series.index, "t_s": series.times_s}
    columns.update(zip(QUATERNION, series.quats_wxyz.T, strict=True))
    if series.positions_m is not None:
        columns.update(zip(POSITION, series.positions_m.T, strict=True))
    table = arrow.table({name: arrow.array(values) for name, values in columns.items()})
    table = table.replace_schema_metadata({"convention": series.convention})
    buffer = io.BytesIO()
    tables.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def write_parquet(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a parquet file; see :func:`parquet_bytes`."""
    del result
    path.write_bytes(parquet_bytes(series))
    return ()
