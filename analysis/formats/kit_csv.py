"""The two CSV layouts of the benchmark authors' own recordings, told apart by content, never by name.

T42 (header row): Unix time ``ts`` in s, position ``tx,ty,tz`` in m, ``rx,ry,rz`` in rad, Euler extrinsic x-y-z; some
files also carry the quaternion ``qx,qy,qz,qw``, which then has to agree. This layout is written too, with a running
index in front and without motor columns, so that the authors' scripts can work on any recording.

NDX_A (no header, Polhemus): station, x, y, z in inch, azimuth, elevation, roll in degrees, Euler intrinsic z-y-x; no
time stamps. A trailing comma on each line is usual. The tracker ran at 240 Hz.

Separators, upper or lower case and the order of named columns do not matter, and T42's time may be called otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.text_table import (
    Layout,
    delimiter_of,
    header_lines,
    is_numeric_row,
    plain,
    read_table,
    split_header,
    split_row,
)
from analysis.formats.time_stamps import RawSamples
from analysis.formats.tum import NO_POSITIONS
from analysis.geometry import averages, rotations
from analysis.geometry.euler_angles import from_euler, to_euler_zyx
from analysis.series import FloatArray, IntArray, OrientationSeries, ReaderError

T42_COLUMNS = ("ts", "tx", "ty", "tz", "rx", "ry", "rz")
T42_QUATERNION = ("qx", "qy", "qz", "qw")
NDX_COLUMNS = ("station", "x", "y", "z", "azimuth", "elevation", "roll")
NDX_RATE_HZ = 240.0
"""Rate of the tracker; its files carry no time."""
INCH_M = 0.0254
AGREEMENT_DEG = 0.01
"""Euler angles and quaternion of one row may differ by this much."""


_TIME_NAMES = ("ts", "time", "timestamp", "stamp", "t")
_UNIT = re.compile(r"[(\[](?:s|m|rad)[)\]]$")
_MAX_STATION = 255
_MIN_STATION_ROWS = 10


def is_t42(lines: list[str]) -> bool:
    """Tell whether the first lines are those of a T42 file: its header names time, position and the three angles.

    Parameters
    ----------
    lines
        The first lines of the file.
    """
    return bool(lines) and set(T42_COLUMNS) <= set(_t42_names(lines))


def _t42_names(lines: list[str]) -> tuple[str, ...]:
    """Names of the header as T42 spells them: ``Time``, ``TX`` and ``rx (rad)`` are ``ts``, ``tx`` and ``rx``."""
    found = [_UNIT.sub("", re.sub(r"[\s_]", "", name.lower())) for name in split_header(lines[0], delimiter_of(lines))]
    time = next((name for name in _TIME_NAMES if name in found), None)
    return tuple("ts" if name == time else name for name in found)


def is_ndx(lines: list[str]) -> bool:
    """Tell whether the first lines are those of an NDX_A file: seven numbers, the first a station.

    Parameters
    ----------
    lines
        The first lines of the file.
    """
    delimiter = delimiter_of(lines)
    rows = [split_row(line, delimiter) for line in lines]
    if _is_ndx_header(rows):
        rows = rows[1:]
    if not rows or {len(row) for row in rows} != {len(NDX_COLUMNS)}:
        return False
    # One damaged row does not make it another format: its fault is then named with its line number.
    sound = [row for row in rows if is_numeric_row(row)]
    if len(sound) < max(1, len(rows) - 2):
        return False
    stations = [float(row[0]) for row in sound]
    different = len(set(stations))
    return all(map(_is_station, stations)) and (different == 1 or 2 * different <= len(stations))


def _is_ndx_header(rows: Sequence[Sequence[str]]) -> bool:
    return bool(rows) and tuple(cell.lower() for cell in rows[0]) == NDX_COLUMNS


def _is_station(value: float) -> bool:
    return value.is_integer() and 0 <= value <= _MAX_STATION


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
    header = _t42_names(lines)

    def columns(names: tuple[str, ...]) -> tuple[FloatArray, tuple[str, ...]]:
        places = tuple(header.index(name) for name in names)
        return read_table(path, Layout(delimiter_of(lines), header_lines(lines), places, names))

    table, cut = columns(T42_COLUMNS)
    angles = table[:, 4:7]
    quats = from_euler(angles, "xyz", intrinsic=False)
    warnings = _angle_warnings(angles)
    notes: tuple[str, ...] = ("T42 layout: Unix time in s, positions in m, angles in rad", *cut)
    if set(T42_QUATERNION) <= set(header):
        try:
            extra, warning = _compare(columns(T42_QUATERNION)[0], quats)
        except ReaderError as error:
            extra, warning = (), (f"the quaternion columns were not compared with the Euler angles: {error}",)
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
    with np.errstate(over="ignore"):  # numbers beyond all reason are no unit quaternions either
        norms = np.linalg.norm(quats_xyzw, axis=1)
    usable = np.abs(norms - 1.0) < 1e-2
    if not usable.any():
        return (), ("the quaternion columns hold no unit quaternions; the Euler angles were used",)
    quats = rotations.from_xyzw(quats_xyzw[usable] / norms[usable, None])
    worst = float(np.degrees(rotations.distance(quats, from_angles[usable]).max()))
    if worst <= AGREEMENT_DEG and usable.all():
        return (f"quaternion columns agree with the Euler angles within {worst:.1g}°",), ()
    return (), (
        f"quaternion columns and Euler angles (extrinsic x-y-z) differ by up to {worst:.3g}°; the angles were used",
    )


def read_ndx(path: Path, lines: list[str], station: str | None = None) -> RawSamples:
    """Read an NDX_A file.

    Parameters
    ----------
    path
        The file.
    lines
        Its first lines.
    station
        Which station, where the tracker followed several; None for the one that turns most, which a warning then says.

    Returns
    -------
    RawSamples
        Rows keep their number in the file, also where those of other stations are left out.

    Raises
    ------
    ReaderError
        A cell that is no number, or no such station.
    """
    delimiter = delimiter_of(lines)
    header = int(_is_ndx_header([split_row(lines[0], delimiter)])) and header_lines(lines)
    table, cut = read_table(path, Layout(delimiter, header, tuple(range(len(NDX_COLUMNS))), NDX_COLUMNS))
    quats = from_euler(np.radians(table[:, 4:7]), "zyx", intrinsic=True)
    rows, warnings = _station_rows(table[:, 0], quats, station)
    largest = float(np.abs(table[rows, 4:7]).max())
    if largest <= np.pi + 0.01 and np.ptp(table[rows, 4:7], axis=0).max() > 0.0:
        warnings = (*warnings, f"no angle exceeds {largest:.2f} where degrees are expected; are they radians?")
    return RawSamples(
        quats_wxyz=quats[rows],
        times_s=None,
        assumed_rate_hz=NDX_RATE_HZ,
        positions_m=table[rows, 1:4] * INCH_M,
        convention="Euler intrinsic z-y-x (azimuth, elevation, roll), deg, body to world",
        source=str(path),
        notes=("NDX_A layout: positions in inch, angles in deg", *cut),
        warnings=warnings,
        index=rows,
    )


def _station_rows(
    stations: FloatArray, quats_wxyz: FloatArray, station: str | None
) -> tuple[IntArray, tuple[str, ...]]:
    """Choose the rows of one station, and say which where there is a choice."""
    wrong = np.flatnonzero((stations != np.round(stations)) | (stations < 0) | (stations > _MAX_STATION))
    if len(wrong):
        raise ReaderError(f"row {wrong[0]}: {stations[wrong[0]]:g} is no station of a tracker; is the line damaged?")
    there = np.unique(stations).astype(np.int64)
    listed = ", ".join(map(str, there[:20]))
    if station is not None:
        if station not in map(str, there):
            raise ReaderError(f"no station {plain(station)} in the file; --topic takes one of {listed}")
        return np.flatnonzero(stations == int(station)), ()
    if len(there) == 1:
        return np.arange(len(stations)), ()

    def turning(number: int) -> float:
        quats = quats_wxyz[stations == number]
        if len(quats) < _MIN_STATION_ROWS:
            return -1.0
        return float(np.median(rotations.distance(quats, averages.average(quats))))

    taken = max(there.tolist(), key=turning)
    warning = f"the file holds stations {listed}; {taken}, which turns most, was taken (--topic says otherwise)"
    return np.flatnonzero(stations == taken), (warning,)


HEADER = ",ts,tx,ty,tz,rx,ry,rz,qx,qy,qz,qw"


def write_kit_csv(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write the T42 layout; positions that are not known are written as zeros, and that is said."""
    del result
    positions = np.zeros((len(series), 3)) if series.positions_m is None else series.positions_m
    # Intrinsic z-y-x angles, read from the other end, are the extrinsic x-y-z angles.
    angles = to_euler_zyx(series.quats_wxyz)[:, ::-1]
    table = np.column_stack(
        (np.arange(len(series)), series.times_s, positions, angles, rotations.to_xyzw(series.quats_wxyz))
    )
    with path.open("x", encoding="utf-8") as file:
        np.savetxt(file, table, fmt=["%d", "%.9f", *["%.17g"] * 10], delimiter=",", header=HEADER, comments="")
    return (NO_POSITIONS,) if series.positions_m is None else ()
