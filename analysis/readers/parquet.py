"""Parquet tables with named columns; needs the extra ``rotdrift[parquet]``."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from analysis.readers.column_spec import ColumnSpec, column_numbers
from analysis.readers.named_csv import guess_names, samples_of
from analysis.readers.number_table import plain
from analysis.readers.time_stamps import RawSamples
from analysis.series import ReaderError

MAGIC = b"PAR1"


def read_parquet(path: Path, spec: ColumnSpec | None) -> RawSamples:
    """Read a parquet file.

    Parameters
    ----------
    path
        The file.
    spec
        What the columns mean; None to go by their names.

    Returns
    -------
    RawSamples

    Raises
    ------
    ReaderError
        The extra is not installed, no such columns, a column without numbers, a missing value (names the row).
    """
    try:
        arrow: Any = importlib.import_module("pyarrow")  # an extra, and slow to import
        tables: Any = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise ReaderError("parquet files need pyarrow: pip install 'rotdrift[parquet]'") from error
    try:
        file = tables.ParquetFile(path)
        header = tuple(file.schema_arrow.names)
        declared = spec is not None
        if spec is None:
            spec = guess_names(header)
        if spec is None:
            there = ", ".join(plain(name) for name in header[:20])
            raise ReaderError(f"name the columns with --columns t=…,qw=…,qx=…,qy=…,qz=…; the file has {there}")
        wanted = [header[number] for number in column_numbers(spec, header, len(header))]
        table = file.read(columns=list(dict.fromkeys(wanted)))
        columns = []
        for name in wanted:
            column = table.column(name)
            if arrow.types.is_temporal(column.type):
                raise ReaderError(f"column {plain(name)} holds dates; store the time as a number")
            columns.append(column.to_numpy().astype(np.float64))
    except arrow.ArrowInvalid as error:
        raise ReaderError(f"{plain(path.name, 80)} is not a sound parquet file: {plain(str(error), 120)}") from error
    except (TypeError, ValueError) as error:
        raise ReaderError(f"column {plain(name)} of {plain(path.name, 80)} does not hold numbers") from error
    values = np.stack(columns, axis=1)
    bad = ~np.isfinite(values)
    if bad.any():
        row, place = (int(k) for k in np.argwhere(bad)[0])
        raise ReaderError(
            f"{plain(path.name, 80)} row {row}: no number in column {plain(wanted[place])}; mend or remove that row"
        )
    if len(values) == 0:
        raise ReaderError(f"{plain(path.name, 80)} has no data rows: record again, or give another file")
    return samples_of(values, spec, str(path), declared=declared)
