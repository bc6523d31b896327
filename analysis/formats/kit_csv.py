"""The two CSV layouts of the benchmark authors' own recordings, distinguished by content, never by name.

T42 (header row): Unix time ``ts`` in s, position ``tx,ty,tz`` in m, ``rx,ry,rz`` in rad, Euler extrinsic x-y-z; some
files also carry the quaternion ``qx,qy,qz,qw``, which then has to agree. This layout is written too, with a running
index in front and without motor columns, so that the authors' scripts can work on any recording.

NDX_A (no header, Polhemus): station, x, y, z in inch, azimuth, elevation, roll in degrees, Euler intrinsic z-y-x; no
time stamps. A trailing comma on each line is usual. The tracker ran at 240 Hz.

Separators, upper or lower case and the order of named columns do not matter, and T42's time may be called otherwise.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.columns import LENGTH_UNITS
from analysis.formats.source import plain
from analysis.formats.text_table import Layout, TextTable, is_numeric_row, read_table
from analysis.formats.time_stamps import RawSamples
from analysis.formats.tum import known_positions
from analysis.geometry import averages, rotations
from analysis.geometry.euler_angles import from_euler, to_euler_zyx
from analysis.series import BoolArray, FloatArray, IntArray, OrientationSeries, ReaderError

T42_COLUMNS = ("ts", "tx", "ty", "tz", "rx", "ry", "rz")
T42_QUATERNION = ("qx", "qy", "qz", "qw")
NDX_COLUMNS = ("station", "x", "y", "z", "azimuth", "elevation", "roll")
NDX_RATE_HZ = 240.0
"""Rate of the tracker; its files carry no time."""
AGREEMENT_DEG = 0.01
"""Euler angles and quaternion of one row may differ by this much."""

_TIME_NAMES = ("ts", "time", "timestamp", "stamp", "t")
_UNIT = re.compile(r"[(\[](?:s|m|rad)[)\]]$")
_MAX_STATION = 255
_MIN_STATION_ROWS = 10


def is_t42(table: TextTable) -> bool:
    """Return whether a file has the T42 layout: its header names time, position and the three angles."""
    return set(T42_COLUMNS) <= set(_t42_names(table))


def _t42_names(table: TextTable) -> tuple[str, ...]:
    """Return the header's names as T42 spells them: ``Time``, ``TX``, ``rx (rad)`` are ``ts``, ``tx``, ``rx``."""
    found = [_UNIT.sub("", re.sub(r"[\s_]", "", name.lower())) for name in table.names]
    time = next((name for name in _TIME_NAMES if name in found), None)
    return tuple("ts" if name == time else name for name in found)


def read_t42(table: TextTable) -> RawSamples:
    """Read a T42 file; raises ReaderError for a cell that is not a number."""
    header = _t42_names(table)

    def read(names: tuple[str, ...]) -> tuple[FloatArray, tuple[str, ...]]:
        places = tuple(header.index(name) for name in names)
        return read_table(table.source, Layout(table.delimiter, table.header_lines, places, names))

    not_compared: tuple[str, ...] = ()
    with_quaternion = set(T42_QUATERNION) <= set(header)
    try:
        values, cut = read((*T42_COLUMNS, *T42_QUATERNION) if with_quaternion else T42_COLUMNS)
    except ReaderError as error:
        values, cut = read(T42_COLUMNS)  # the angles are enough; where they are at fault, this fails as well
        not_compared = (f"the quaternion columns were not compared with the Euler angles: {error}",)
    angles, quats_xyzw = values[:, 4:7], values[:, 7:]
    quats = from_euler(angles, "xyz", intrinsic=False)
    agreed, differing = _compare(quats_xyzw, quats) if quats_xyzw.size else ((), not_compared)
    return RawSamples(
        quats_wxyz=quats,
        times_s=values[:, 0].copy(),
        positions_m=values[:, 1:4].copy(),
        convention="Euler extrinsic x-y-z (rx, ry, rz), rad, body to world",
        notes=("T42 layout: Unix time in s, positions in m, angles in rad", *cut, *agreed),
        warnings=(*_angle_warnings(angles), *differing),
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


def is_ndx(table: TextTable) -> bool:
    """Return whether a file has the NDX_A layout: seven numbers a line, the first of them a station."""
    rows = table.rows[1:] if _has_ndx_header(table) else table.rows
    if not rows or {len(row) for row in rows} != {len(NDX_COLUMNS)}:
        return False
    # One damaged row does not make it another format: its fault is then named with its line number.
    sound = [row for row in rows if is_numeric_row(row)]
    if len(sound) < max(1, len(rows) - 2):
        return False
    stations = np.array([float(row[0]) for row in sound])
    different = len(np.unique(stations))
    return not _no_stations(stations).any() and (different == 1 or 2 * different <= len(stations))


def _has_ndx_header(table: TextTable) -> bool:
    return tuple(cell.lower() for cell in table.rows[0]) == NDX_COLUMNS


def _no_stations(stations: FloatArray) -> BoolArray:
    """Return (n,) which numbers cannot be that of a tracker's station."""
    return np.asarray((stations != np.round(stations)) | (stations < 0) | (stations > _MAX_STATION))


def read_ndx(table: TextTable, station: str | None = None) -> RawSamples:
    """Read one station of an NDX_A file; without ``station`` the one that turns most, which a warning reports.

    Rows keep their number in the file, also where those of other stations are left out.

    Raises
    ------
    ReaderError
        A cell that is not a number, or no such station.
    """
    header = table.header_lines if _has_ndx_header(table) else 0
    layout = Layout(table.delimiter, header, tuple(range(len(NDX_COLUMNS))), NDX_COLUMNS)
    values, cut = read_table(table.source, layout)
    quats = from_euler(np.radians(values[:, 4:7]), "zyx", intrinsic=True)
    rows, warnings = _station_rows(values[:, 0], quats, station)
    angles_deg = values[rows, 4:7]
    largest = float(np.abs(angles_deg).max())
    if largest <= np.pi + 0.01 and np.ptp(angles_deg, axis=0).max() > 0.0:
        warnings = (*warnings, f"no angle exceeds {largest:.2f} where degrees are expected; are they radians?")
    return RawSamples(
        quats_wxyz=quats[rows],
        times_s=None,
        assumed_rate_hz=NDX_RATE_HZ,
        positions_m=values[rows, 1:4] * LENGTH_UNITS["inch"],
        convention="Euler intrinsic z-y-x (azimuth, elevation, roll), deg, body to world",
        notes=("NDX_A layout: positions in inch, angles in deg", *cut),
        warnings=warnings,
        index=rows,
    )


def _station_rows(
    stations: FloatArray, quats_wxyz: FloatArray, station: str | None
) -> tuple[IntArray, tuple[str, ...]]:
    """Choose the rows of one station, with a warning where several could be meant."""
    wrong = np.flatnonzero(_no_stations(stations))
    if len(wrong):
        raise ReaderError(
            f"row {wrong[0]}: {stations[wrong[0]]:g} is not a valid station of a tracker; is the line damaged?"
        )
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

    chosen = max(there.tolist(), key=turning)
    warning = f"the file holds stations {listed}; {chosen}, which turns most, was taken (--topic says otherwise)"
    return np.flatnonzero(stations == chosen), (warning,)


def write_kit_csv(series: OrientationSeries, _result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write the T42 layout; positions that are not known are written as zeros, which the notes report."""
    positions, notes = known_positions(series)
    # Intrinsic z-y-x angles, read from the other end, are the extrinsic x-y-z angles.
    angles = to_euler_zyx(series.quats_wxyz)[:, ::-1]
    quats_xyzw = rotations.to_xyzw(series.quats_wxyz)
    table = np.column_stack((np.arange(len(series)), series.times_s, positions, angles, quats_xyzw))
    header = ",".join(("", *T42_COLUMNS, *T42_QUATERNION))
    with path.open("x", encoding="utf-8") as file:
        np.savetxt(file, table, fmt=["%d", "%.9f", *["%.17g"] * 10], delimiter=",", header=header, comments="")
    return notes
