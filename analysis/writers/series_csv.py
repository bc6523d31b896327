"""CSV with named columns and units in the names; the reader recognises it without being told anything."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from analysis.series import OrientationSeries
from analysis.writers.errors import WriterError

QUATERNION = ("qw", "qx", "qy", "qz")
POSITION = ("px_m", "py_m", "pz_m")


def csv_text(series: OrientationSeries) -> str:
    """Write samples: name of the sample, time in s, quaternion, position in m where there is one.

    Numbers carry 17 digits, so that reading them back gives the very same values.

    Parameters
    ----------
    series
        What to write.
    """
    names = [series.index_kind, "t_s", *QUATERNION]
    columns = [series.index.astype(np.float64), series.times_s, *series.quats_wxyz.T]
    formats = ["%d", "%.9f", *["%.17g"] * 4]
    if series.positions_m is not None:
        names += POSITION
        columns += list(series.positions_m.T)
        formats += ["%.17g"] * 3
    buffer = io.StringIO()
    np.savetxt(buffer, np.stack(columns, axis=1), fmt=formats, delimiter=",", header=",".join(names), comments="")
    return buffer.getvalue()


def endpoints_csv_text(result: dict[str, Any]) -> str:
    """Write end points: number, sample, time in s, the quaternion that was scored, flags, reason.

    Parameters
    ----------
    result
        A score as JSON values.
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
    """Keep a spreadsheet from taking a text for a formula; also where it drops what stands before it.

    Parameters
    ----------
    text
        What a person wrote.
    """
    return f"'{text}" if text.lstrip()[:1] in {"=", "+", "-", "@", "|", "%"} or text[:1] in {"\t", "\r"} else text


def write_csv(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write samples as CSV; see :func:`csv_text`."""
    del result
    path.write_text(csv_text(series), encoding="utf-8")
    return ()


def write_endpoints_csv(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write end points as CSV; see :func:`endpoints_csv_text`.

    Raises
    ------
    WriterError
        No score was given.
    """
    del series
    if result is None:
        raise WriterError("end points need a score")
    path.write_text(endpoints_csv_text(result), encoding="utf-8")
    return () if result.get("valid") else ("these end points make no valid score: " + "; ".join(result["reasons"]),)
