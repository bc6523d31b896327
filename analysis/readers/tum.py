"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw`` in s and m, white space between, ``#`` comments.

Source: TUM RGB-D benchmark, file formats; the format evo and most SLAM tools write.
"""

from __future__ import annotations

from pathlib import Path

from analysis import rotations
from analysis.readers.number_table import COMMENT, Layout, is_numeric_row, read_table, split_row
from analysis.readers.time_stamps import RawSamples

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
