"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw`` in s and m, white space between, ``#`` comments.

Source: TUM RGB-D benchmark, file formats; the format evo and most SLAM tools read and write.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.rows.cells import is_numeric_row
from analysis.formats.rows.names import recognise
from analysis.formats.text_table import COMMENT, Layout, TextTable, read_table, split_row
from analysis.formats.time_stamps import RawSamples
from analysis.geometry import rotations
from analysis.series import FloatArray, OrientationSeries

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")

_LINES = 20  # looked at


def is_tum(table: TextTable) -> bool:
    """Return whether a file is a TUM trajectory: eight numbers without commas, two damaged lines at most.

    One whose header names the quaternion in another order is not: it is read by its header.
    """
    found = recognise(table.names) if table.names else None
    if found is not None and found.quaternions:
        parts = next(iter(found.quaternions.values()))
        if [table.names.index(parts[key]) for key in ("qx", "qy", "qz", "qw")] != [4, 5, 6, 7]:
            return False
    rows = [row for line in table.lines[:_LINES] if (row := split_row(line.split(COMMENT, 1)[0], None))]
    sound = [row for row in rows if len(row) == len(COLUMNS) and is_numeric_row(row)]
    return bool(rows) and len(sound) >= max(1, len(rows) - 2)


def read_tum(table: TextTable) -> RawSamples:
    """Read a TUM trajectory; raises ReaderError for a cell that is not a number."""
    read = read_table(table.source, Layout(None, table.header_lines, tuple(range(len(COLUMNS))), COLUMNS))
    values = read.values
    return RawSamples(
        quats_wxyz=rotations.from_xyzw(values[:, 4:8]),
        times_s=values[:, 0].copy(),
        positions_m=values[:, 1:4].copy(),
        convention="TUM trajectory: quaternion x,y,z,w, Hamilton, body to world",
        notes=("TUM trajectory: time in s, positions in m", *read.notes),
        starts=read.starts,
    )


def known_positions(series: OrientationSeries) -> tuple[FloatArray, tuple[str, ...]]:
    """Return (n, 3) positions for a format that must have some, m: zeros where there are none, and a note on that."""
    if series.positions_m is None:
        return np.zeros((len(series), 3)), ("the recording has no positions; zeros are written",)
    return series.positions_m, ()


def write_tum(series: OrientationSeries, _result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a TUM trajectory; positions that are not known are written as zeros, which the notes report."""
    positions, notes = known_positions(series)
    table = np.column_stack((series.times_s, positions, rotations.to_xyzw(series.quats_wxyz)))
    with path.open("x", encoding="utf-8") as file:
        np.savetxt(file, table, fmt=["%.9f", *["%.17g"] * 7], header=" ".join(COLUMNS))
    return notes
