"""CSV files that the x-IMU3 software writes: ``Quaternion.csv``, with ``Inertial.csv`` beside it where there is one.

Header ``Timestamp (us),W,X,Y,Z``; the quaternion is Hamilton and turns sensor coordinates into Earth coordinates.
``Inertial.csv`` gives gyroscope in deg/s and accelerometer in g at its own time stamps. Source: the strings of the
x-IMU3 programming interface, version 1.9 (PyPI ``ximu3``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.formats.columns import ACCELERATION_UNITS, TIME_UNITS
from analysis.formats.source import SourceFile
from analysis.formats.text_table import Layout, TextTable, read_table, split_header
from analysis.formats.time_stamps import RawSamples
from analysis.series import FloatArray, ReaderError

QUATERNION_HEADER = ("Timestamp (us)", "W", "X", "Y", "Z")
INERTIAL_NAME = "Inertial.csv"
ACCELEROMETER = ("Timestamp (us)", "Accelerometer X (g)", "Accelerometer Y (g)", "Accelerometer Z (g)")


def is_ximu3(table: TextTable) -> bool:
    """Return whether the first line is the header of any x-IMU3 message file."""
    return split_header(table.lines[0])[0] == QUATERNION_HEADER[0]


def is_diagnostic(path: Path) -> bool:
    """Return whether a file is one that the x-IMU3 software writes beside the quaternions, by its first line."""
    try:
        with path.open("rb") as file:
            first = file.readline(1_000).decode("utf-8-sig", "replace").strip()
    except OSError:
        return False
    return first.startswith(QUATERNION_HEADER[0] + ",") and split_header(first) != QUATERNION_HEADER


def read_ximu3(table: TextTable) -> RawSamples:
    """Read an x-IMU3 quaternion file, and the accelerometer file beside it where there is one.

    Raises ReaderError for another message file than the quaternion's, or a cell that is not a number.
    """
    source = table.source
    if split_header(table.lines[0]) != QUATERNION_HEADER:
        raise ReaderError(
            f"{source.name} is an x-IMU3 file without quaternions; give the Quaternion.csv of the same folder"
        )
    read = read_table(source, Layout(",", 1, tuple(range(5)), QUATERNION_HEADER, width=5, header=table.lines[0]))
    values = read.values
    times_s = values[:, 0] * TIME_UNITS["us"]
    accelerations, note = _accelerations(source.path.with_name(INERTIAL_NAME), times_s)
    return RawSamples(
        quats_wxyz=values[:, 1:5].copy(),
        times_s=times_s,
        accelerations_mps2=accelerations,
        convention="x-IMU3: quaternion w,x,y,z, Hamilton, sensor to Earth",
        notes=("x-IMU3 layout: time in us", *read.notes, *note),
        starts=read.starts,
    )


def _accelerations(path: Path, times_s: FloatArray) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return (n, 3) accelerometer at the times of the quaternions, m/s²; None where there is no usable file."""
    if not path.is_file():
        return None, ()
    try:
        with SourceFile(path) as source:
            header = split_header(TextTable(source).lines[0])
            columns = tuple(header.index(name) for name in ACCELEROMETER)
            table = read_table(source, Layout(",", 1, columns, ACCELEROMETER), holes=False).values
    except (ReaderError, ValueError, OSError):
        return None, (f"{INERTIAL_NAME} beside it could not be used",)
    order = np.argsort(table[:, 0], kind="stable")
    at = table[order, 0] * TIME_UNITS["us"]
    values = np.stack([np.interp(times_s, at, table[order, k]) for k in (1, 2, 3)], axis=1)
    return values * ACCELERATION_UNITS["g"], (f"accelerations from {INERTIAL_NAME} beside it",)
