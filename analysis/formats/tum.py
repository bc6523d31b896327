"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw`` in s and m, white space between, ``#`` comments.

Source: TUM RGB-D benchmark, file formats; the format evo and most SLAM tools read and write.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.text_table import COMMENT, Layout, is_numeric_row, read_table, split_row
from analysis.formats.time_stamps import RawSamples
from analysis.geometry import rotations
from analysis.series import OrientationSeries

COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")


def is_tum(lines: list[str]) -> bool:
    """Tell whether the first lines are those of a TUM trajectory: eight numbers without commas.

    Parameters
    ----------
    lines
        The first lines of the file.
    """
    rows = [split_row(line.split(COMMENT, 1)[0], None) for line in lines]
    rows = [row for row in rows if row]
    sound = [row for row in rows if len(row) == len(COLUMNS) and is_numeric_row(row)]
    return bool(rows) and len(sound) >= max(1, len(rows) - 2)


def read_tum(path: Path, lines: list[str]) -> RawSamples:
    """Read a TUM trajectory.

    Parameters
    ----------
    path
        The file.
    lines
        Its first lines (not needed: the layout is fixed).

    Returns
    -------
    RawSamples

    Raises
    ------
    ReaderError
        A cell that is no number.
    """
    del lines
    table, cut = read_table(path, Layout(None, 0, tuple(range(8)), COLUMNS))
    return RawSamples(
        quats_wxyz=rotations.from_xyzw(table[:, 4:8]),
        times_s=table[:, 0].copy(),
        positions_m=table[:, 1:4].copy(),
        convention="TUM trajectory: quaternion x,y,z,w, Hamilton, body to world",
        source=str(path),
        notes=("TUM trajectory: time in s, positions in m", *cut),
    )


NO_POSITIONS = "the recording has no positions; zeros are written"


def write_tum(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a TUM trajectory; positions that are not known are written as zeros, and that is said."""
    del result
    positions = np.zeros((len(series), 3)) if series.positions_m is None else series.positions_m
    table = np.column_stack((series.times_s, positions, rotations.to_xyzw(series.quats_wxyz)))
    with path.open("x", encoding="utf-8") as file:
        np.savetxt(file, table, fmt=["%.9f", *["%.17g"] * 7], header="timestamp tx ty tz qx qy qz qw")
    return (NO_POSITIONS,) if series.positions_m is None else ()
