"""The two CSV layouts of the benchmark authors' own recordings, told apart by content, never by name.

T42 (header row): Unix time ``ts`` in s, position ``tx,ty,tz`` in m, ``rx,ry,rz`` in rad, Euler extrinsic x-y-z; some
files also carry the quaternion ``qx,qy,qz,qw``, which then has to agree.

NDX_A (no header, Polhemus): station, x, y, z in inch, azimuth, elevation, roll in degrees, Euler intrinsic z-y-x; no
time stamps. A trailing comma on each line is usual. The tracker ran at 240 Hz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis import rotations
from analysis.euler_angles import from_euler
from analysis.readers.number_table import Layout, is_numeric_row, read_table, split_header
from analysis.readers.time_stamps import RawSamples
from analysis.series import FloatArray

T42_COLUMNS = ("ts", "tx", "ty", "tz", "rx", "ry", "rz")
T42_QUATERNION = ("qx", "qy", "qz", "qw")
NDX_COLUMNS = ("station", "x", "y", "z", "azimuth", "elevation", "roll")
NDX_RATE_HZ = 240.0
"""Rate of the tracker; its files carry no time."""
INCH_M = 0.0254
AGREEMENT_DEG = 0.01
"""Euler angles and quaternion of one row may differ by this much."""


def is_t42(lines: list[str]) -> bool:
    """Tell whether the first lines are those of a T42 file.

    Parameters
    ----------
    lines
        The first lines of the file.
    """
    return bool(lines) and set(T42_COLUMNS) <= set(split_header(lines[0]))


def is_ndx(lines: list[str]) -> bool:
    """Tell whether the first lines are those of an NDX_A file: seven numbers, the first a constant whole number.

    Parameters
    ----------
    lines
        The first lines of the file.
    """
    rows = [line.split(",") for line in lines if line.strip()]
    if not rows:
        return False
    widths = {len(row) - (not row[-1].strip()) for row in rows}
    # One damaged row does not make it another format: its fault is then named with its line number.
    sound = [row for row in rows if is_numeric_row(row)]
    if widths != {7} or len(sound) < max(1, len(rows) - 2):
        return False
    stations = {row[0].strip() for row in sound}
    return len(stations) == 1 and next(iter(stations)).isdigit() and int(next(iter(stations))) < 256


def read_t42(path: Path, lines: list[str]) -> RawSamples:
    """Read a T42 file.

    Parameters
    ----------
    path
        The file.
    lines
        Its first lines.

    Returns
    -------
    RawSamples

    Raises
    ------
    ReaderError
        A cell that is no number.
    """
    header = split_header(lines[0])
    with_quaternion = set(T42_QUATERNION) <= set(header)
    names = T42_COLUMNS + (T42_QUATERNION if with_quaternion else ())
    columns = tuple(header.index(name) for name in names)
    table = read_table(path, Layout(",", 1, columns, names))
    angles = table[:, 4:7]
    quats = from_euler(angles, "xyz", intrinsic=False)
    warnings = _angle_warnings(angles)
    notes: tuple[str, ...] = ("T42 layout: Unix time in s, positions in m, angles in rad",)
    if with_quaternion:
        extra, warning = _compare(table[:, 7:11], quats)
        notes, warnings = (*notes, *extra), warnings + warning
    return RawSamples(
        quats_wxyz=quats,
        times_s=table[:, 0].copy(),
        positions_m=table[:, 1:4].copy(),
        convention="Euler extrinsic x-y-z (rx, ry, rz), rad, body to world",
        source=str(path),
        notes=notes,
        warnings=warnings,
    )


def _angle_warnings(angles_rad: FloatArray) -> tuple[str, ...]:
    largest = float(np.abs(angles_rad).max())
    if largest <= 2.0 * np.pi + 1e-6:
        return ()
    return (f"angles reach {largest:.1f} where radians are expected; are rx, ry, rz in degrees?",)


def _compare(quats_xyzw: FloatArray, from_angles: FloatArray) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Compare the two orientations of every row: a note when they agree, a warning when not."""
    norms = np.linalg.norm(quats_xyzw, axis=1)
    usable = np.abs(norms - 1.0) < 1e-2
    if not usable.any():
        return (), ("the quaternion columns hold no unit quaternions; the Euler angles were used",)
    quats = rotations.from_xyzw(quats_xyzw[usable] / norms[usable, None])
    worst = float(np.degrees(rotations.distance(quats, from_angles[usable]).max()))
    if worst <= AGREEMENT_DEG and usable.all():
        return (f"quaternion columns agree with the Euler angles within {worst:.1g} deg",), ()
    return (), (
        f"quaternion columns and Euler angles (extrinsic x-y-z) differ by up to {worst:.3g} deg; the angles were used",
    )


def read_ndx(path: Path, lines: list[str]) -> RawSamples:
    """Read an NDX_A file.

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
    table = read_table(path, Layout(",", 0, tuple(range(7)), NDX_COLUMNS))
    return RawSamples(
        quats_wxyz=from_euler(np.radians(table[:, 4:7]), "zyx", intrinsic=True),
        times_s=None,
        assumed_rate_hz=NDX_RATE_HZ,
        positions_m=table[:, 1:4] * INCH_M,
        convention="Euler intrinsic z-y-x (azimuth, elevation, roll), deg, body to world",
        source=str(path),
        notes=("NDX_A layout: positions in inch, angles in deg",),
    )
