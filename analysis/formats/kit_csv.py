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
from analysis.formats.rows.cells import is_numeric_row
from analysis.formats.source import plain
from analysis.formats.text_table import TableRows, TextTable, read_table
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
MAX_REACH_INCH = 200.0
"""Further from its source no tracker reaches."""
MIN_REACH_INCH = 1.5
"""Nothing that is tracked stays nearer to the source."""
FIXED_LENGTH = 0.08
FIXED_SPREAD_DEG = 4.0
"""Three numbers of a length fixed within that share whose direction turns by more are hardly a position ..."""
FIXED_SPREAD_OF_ANGLES_DEG = 25.0
"""... and, if it turns by more than this, no angles."""
GRAVITY_MPS2 = 9.81
_MAX_STATION = 255
_MIN_STATION_ROWS = 10


def is_t42(table: TextTable) -> bool:
    """Return whether a file has the T42 layout: its header names time, position and the three angles.

    Robots and solvePnP name a rotation vector rx, ry, rz too. So the time has to go by the authors' name, or the
    quaternion has to stand beside, which is compared with the angles.
    """
    names = set(_t42_names(table))
    own = "ts" in (name.strip().lower() for name in table.names)
    return set(T42_COLUMNS) <= names and (own or set(T42_QUATERNION) <= names)


def _t42_names(table: TextTable) -> tuple[str, ...]:
    """Return the header's names as T42 spells them: ``Time``, ``TX``, ``rx (rad)`` are ``ts``, ``tx``, ``rx``."""
    found = [_UNIT.sub("", re.sub(r"[\s_]", "", name.lower())) for name in table.names]
    time = next((name for name in _TIME_NAMES if name in found), None)
    return tuple("ts" if name == time else name for name in found)


def read_t42(table: TextTable) -> RawSamples:
    """Read a T42 file; raises ReaderError for a cell that is not a number."""
    header = _t42_names(table)

    def read(names: tuple[str, ...], holes: bool) -> TableRows:
        places = tuple(header.index(name) for name in names)
        return read_table(table.source, table.layout(places, names, time=0), holes)

    not_compared: tuple[str, ...] = ()
    with_quaternion = set(T42_QUATERNION) <= set(header)
    try:
        table_rows = read((*T42_COLUMNS, *T42_QUATERNION) if with_quaternion else T42_COLUMNS, not with_quaternion)
    except ReaderError as error:
        if not with_quaternion:
            raise
        table_rows = read(T42_COLUMNS, True)  # the angles are enough; where they are at fault, this fails as well
        not_compared = (f"the quaternion columns were not compared with the Euler angles: {error}",)
    values = table_rows.values
    whole = np.isfinite(values).all(axis=1)
    if not whole.any():
        raise ReaderError(f"{table.source.name} has no row without a hole: are the columns empty?")
    angles, quats_xyzw = values[:, 4:7], values[:, 7:]
    quats = np.full((len(values), 4), np.nan)
    quats[whole] = from_euler(angles[whole], "xyz", intrinsic=False)
    agreed, differing = _compare(quats_xyzw, quats) if quats_xyzw.size else ((), not_compared)
    return RawSamples(
        quats_wxyz=quats,
        times_s=values[:, 0].copy(),
        positions_m=values[:, 1:4].copy(),
        convention="Euler extrinsic x-y-z (rx, ry, rz), rad, body to world",
        notes=("T42 layout: Unix time in s, positions in m, angles in rad", *table_rows.notes, *agreed),
        warnings=(*_angle_warnings(angles[whole]), *differing),
        starts=table_rows.starts,
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
    """Return whether a file has the NDX_A layout: seven numbers a line, and what they are worth fits a tracker.

    Seven numbers without names may be anything, so ranges decide: the first is a station or a running number, the
    positions are where the tracker reaches and no vector of fixed length that turns (acceleration, magnetic field),
    the angles are within those that the tracker returns.
    """
    if _has_ndx_header(table):
        return True
    if table.names or not table.rows or {len(row) for row in table.rows} != {len(NDX_COLUMNS)}:
        return False
    # Damaged rows do not make it another format: their fault is then named with its line number.
    sound = np.array([[float(cell) for cell in row] for row in table.rows if is_numeric_row(row)])
    if not len(sound) or len(sound) < len(table.rows) - max(2, len(table.rows) // 10):
        return False
    stations = sound[:, 0]
    different = len(np.unique(stations))
    is_station = _no_stations(stations).mean() < 0.1 and (different == 1 or 2 * different <= len(stations))
    return (is_station or _is_running_number(stations)) and _fits_tracker(sound[:, 1:4], sound[:, 4:7])


def _is_running_number(values: FloatArray) -> bool:
    return len(values) > 1 and bool((np.diff(values) == 1.0).mean() > 0.9 and (values == np.round(values)).all())


def _fits_tracker(positions_inch: FloatArray, angles_deg: FloatArray) -> bool:
    """Return whether numbers can be those of the tracker: see :func:`is_ndx`."""
    limits = np.array([180.0, 90.0, 180.0]) + 0.01
    lengths = np.linalg.norm(positions_inch, axis=1)
    if (np.abs(angles_deg) > limits).any() or lengths.max() > MAX_REACH_INCH or lengths.max() < MIN_REACH_INCH:
        return False
    is_vector = _is_turning_vector(positions_inch, FIXED_SPREAD_DEG)
    is_gravity = is_vector and abs(float(np.median(lengths)) - GRAVITY_MPS2) < FIXED_LENGTH * GRAVITY_MPS2
    # A turn rate is zero on average, angles hardly about all axes.
    is_turn_rate = bool((np.abs(angles_deg.mean(axis=0)) < 0.5 * angles_deg.std(axis=0)).all())
    return not (
        is_gravity or (is_vector and is_turn_rate) or _is_turning_vector(angles_deg, FIXED_SPREAD_OF_ANGLES_DEG)
    )


def _is_turning_vector(vectors: FloatArray, least_deg: float) -> bool:
    """Return whether (n, 3) numbers are a vector of fixed length that turns by more: gravity or the magnetic field."""
    lengths = np.linalg.norm(vectors, axis=1)
    usual = float(np.median(lengths))
    if usual == 0.0 or float(lengths.std()) > FIXED_LENGTH * usual:
        return False
    directions = vectors / np.maximum(lengths, 1e-9)[:, None]
    return float(np.degrees(np.arccos(np.clip(directions @ directions[0], -1.0, 1.0)).max())) > least_deg


def _has_ndx_header(table: TextTable) -> bool:
    return tuple(name.lower() for name in table.names if name) == NDX_COLUMNS


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
    read = read_table(table.source, table.layout(tuple(range(len(NDX_COLUMNS))), NDX_COLUMNS), holes=False)
    values = read.values
    if not _has_ndx_header(table) and not _fits_tracker(values[:, 1:4], values[:, 4:7]):
        raise ReaderError(
            f"{table.source.name}: columns without names, seven of them, that do not fit a tracker: name the columns "
            "with --columns t=…,qw=…,qx=…,qy=…,qz=…; a layout is not guessed from its shape"
        )
    quats = from_euler(np.radians(values[:, 4:7]), "zyx", intrinsic=True)
    numbered: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    if _is_running_number(values[:, 0]) and len(values) > 2:
        rows = np.arange(len(values))
        numbered = ("the first column is a running row number",)
    else:
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
        notes=("NDX_A layout: positions in inch, angles in deg", *numbered, *read.notes),
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
