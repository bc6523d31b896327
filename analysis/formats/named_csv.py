"""CSV whose columns are declared with ``--columns``, or named so that nothing needs declaring.

Written with units in the names, so that reading it back needs no declaration.
"""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.columns import QUATERNION, ColumnSpec, column_numbers, samples_of
from analysis.formats.rows.cells import CellKind, kind_of
from analysis.formats.rows.names import label_column
from analysis.formats.rows.streams import LabelArray, tells_apart
from analysis.formats.text_table import Layout, TextTable, read_table, read_texts
from analysis.formats.time_stamps import RawSamples
from analysis.series import OrientationSeries, WriterError

WRITTEN_POSITION = ("px_m", "py_m", "pz_m")
"""Names of the position's columns in tables written here."""


def read_named(table: TextTable, spec: ColumnSpec) -> RawSamples:
    """Read a CSV by its column names; raises ReaderError for a column or a number that is not there."""
    width = len(table.names) or len(table.rows[0])
    numbers = column_numbers(spec, table.names, width)
    names = tuple(spec.names.values())
    layout = table.layout(numbers, names, time=list(spec.names).index("t") if "t" in spec.names else None)
    if all(name.startswith("#") and name not in table.names for name in names):
        layout = replace(layout, width=0)  # the numbers hold whatever the header names
    read = read_table(table.source, layout)
    samples = samples_of(read.values, spec, table.rate_hz)
    return replace(
        samples,
        notes=(*samples.notes, *read.notes),
        starts=read.starts,
        labels=_labels(table, layout, set(numbers)),
    )


def _labels(table: TextTable, layout: Layout, read: set[int]) -> LabelArray | None:
    """Return (n,) which sensor each row is of, by the first column that tells sensors apart; None where none does."""
    width = len(table.names) or len(table.rows[0])
    for column in range(width):
        named = bool(table.names) and label_column(table.names[column])
        cells = [row[column] for row in table.rows if column < len(row)]
        if column in read or not cells or not (named or all(kind_of(cell) is CellKind.TEXT for cell in cells)):
            continue
        labels = np.array(read_texts(table.source, replace(layout, columns=(column,), width=0)))
        if tells_apart(labels, named):
            return labels
    return None


def csv_text(series: OrientationSeries) -> str:
    """Return samples as CSV: name of the sample, time in s, quaternion, position in m where there is one.

    Numbers carry 17 digits, so that reading them back gives the very same values.
    """
    names = [series.index_kind, "t_s", *QUATERNION]
    columns = [series.index.astype(np.float64), series.times_s, *series.quats_wxyz.T]
    formats = ["%d", "%.9f", *["%.17g"] * 4]
    if series.positions_m is not None:
        names += WRITTEN_POSITION
        columns += list(series.positions_m.T)
        formats += ["%.17g"] * 3
    buffer = io.StringIO()
    np.savetxt(buffer, np.stack(columns, axis=1), fmt=formats, delimiter=",", header=",".join(names), comments="")
    return buffer.getvalue()


def endpoints_csv_text(result: dict[str, Any]) -> str:
    """Return the end points of a score (as JSON values) as CSV.

    Columns: number, sample, time in s, the quaternion that was scored, flags, reason.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    points = result.get("endpoints") or []
    kind = "sequence" if points and "sequence" in points[0] else "row"
    writer.writerow(["endpoint", kind, "t_s", *QUATERNION, "flags", "reason"])
    for number, point in enumerate(points, start=1):
        quat = [repr(float(part)) for part in point["quat_wxyz"]]
        flags = "; ".join(point.get("flags") or [])
        writer.writerow(
            [number, point[kind], repr(float(point["time_s"])), *quat, flags, safe_cell(point.get("reason", ""))]
        )
    return buffer.getvalue()


def safe_cell(text: str) -> str:
    """Return what a person wrote so that no spreadsheet takes it for a formula, also one that drops leading blanks."""
    return f"'{text}" if text.lstrip()[:1] in {"=", "+", "-", "@", "|", "%"} or text[:1] in {"\t", "\r"} else text


def write_csv(series: OrientationSeries, _result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write samples as CSV; see :func:`csv_text`."""
    path.write_text(csv_text(series), encoding="utf-8")
    return ()


def write_endpoints_csv(_series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write end points as CSV, see :func:`endpoints_csv_text`; raises WriterError where no score was given."""
    if result is None:
        raise WriterError("end points need a score")
    path.write_text(endpoints_csv_text(result), encoding="utf-8")
    return () if result.get("valid") else ("these end points make no valid score: " + "; ".join(result["reasons"]),)
