"""What the columns of a file mean: names, units, order and convention, declared in one line or read off their names.

``t=time,qw=q0,qx=q1,qy=q2,qz=q3,time=ms,product=jpl,maps=world-to-body`` or
``t=ts,e1=yaw,e2=pitch,e3=roll,angle=deg,euler=intrinsic-zyx``

=========== ============================================================ ==============
key         meaning                                                      default
=========== ============================================================ ==============
t           column with time                                             none: give the rate
qw qx qy qz columns of the quaternion, each named: in any order
e1 e2 e3    columns of the Euler angles, in the order of ``euler``
px py pz    columns of the position                                      none
ax ay az    columns of the acceleration, body frame                      none
time        unit of t: s, ms, us, ns                                     s
angle       unit of e1 e2 e3: rad, deg                                   must be given
euler       intrinsic-zyx, extrinsic-xyz, …                              must be given
length      unit of px py pz: m, cm, mm, inch                            m
accel       unit of ax ay az: mps2, g                                    mps2
product     hamilton or jpl                                              hamilton
maps        body-to-world or world-to-body                               body-to-world
=========== ============================================================ ==============

A column is given by its name in the header, or as ``#2`` by its 0-based number.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.formats.source import plain
from analysis.formats.time_stamps import RawSamples
from analysis.geometry import rotations
from analysis.geometry.euler_angles import from_euler
from analysis.series import FloatArray, ReaderError

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180.0}
ACCELERATION_UNITS = {"mps2": 1.0, "g": 9.80665}
QUATERNION = ("qw", "qx", "qy", "qz")
EULER = ("e1", "e2", "e3")
POSITION = ("px", "py", "pz")
ACCELERATION = ("ax", "ay", "az")
_COLUMN_KEYS = ("t", *QUATERNION, *EULER, *POSITION, *ACCELERATION)
_SETTINGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "time": ("t", tuple(TIME_UNITS)),
    "angle": ("e1", tuple(ANGLE_UNITS)),
    "length": ("px", tuple(LENGTH_UNITS)),
    "accel": ("ax", tuple(ACCELERATION_UNITS)),
    "product": ("qw", ("hamilton", "jpl")),
    "maps": ("", ("body-to-world", "world-to-body")),
    "euler": ("e1", ()),
}
"""Key -> the column without which it has no meaning, and its values; none listed where they are checked otherwise."""
_TIME_NAME = re.compile(r"^(?:t|ts|time|timestamp|time_?stamp|stamp)(?:[_ ]?[(\[]?(s|sec|ms|us|ns)[)\]]?)?$")
_QUATERNION_NAME = re.compile(r"^(?:q|quat|quaternion|orientation|rot|rotation)?[_. ]?([wxyz])$")
_POSITION_NAME = re.compile(r"^(?:p|pos|position|t)[_. ]?([xyz])(?:[_ ]?[(\[]?(m|cm|mm)[)\]]?)?$")


@dataclass(frozen=True)
class ColumnSpec:
    """Declared meaning of a file's columns."""

    columns: tuple[tuple[str, str], ...]
    """(key, column name or #number) pairs; keys as in the table above."""
    time: str = "s"
    """Unit of t."""
    angle: str = ""
    """Unit of the Euler angles."""
    euler: str = ""
    """``intrinsic-`` or ``extrinsic-`` and the order."""
    length: str = "m"
    """Unit of the position."""
    accel: str = "mps2"
    """Unit of the acceleration."""
    product: str = "hamilton"
    """Quaternion product the numbers were made for."""
    maps: str = "body-to-world"
    """What the rotation does to coordinates."""
    declared: bool = True
    """False where the meaning was guessed from the names, which the notes of the samples then report."""

    @property
    def names(self) -> dict[str, str]:
        """Key to column name."""
        return dict(self.columns)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys in a fixed order."""
        return tuple(key for key in _COLUMN_KEYS if key in self.names)

    @property
    def convention(self) -> str:
        """The convention in words, for the result."""
        if self.euler:
            kind, order = self.euler.split("-")
            named = ", ".join(plain(self.names[key]) for key in EULER)
            what = f"Euler {kind} {'-'.join(order)} ({named}), {self.angle}"
        else:
            named = ",".join(plain(self.names[key]) for key in QUATERNION)
            what = f"quaternion w,x,y,z = {named}, {'Hamilton' if self.product == 'hamilton' else 'JPL'}"
        return f"{what}, {self.maps.replace('-', ' ')}"


def parse_columns(text: str) -> ColumnSpec:
    """Parse the declaration of a file's columns.

    Parameters
    ----------
    text : str
        ``key=value`` pairs with commas between; the keys are those of this module's table.

    Raises
    ------
    ReaderError
        An unknown key or value, or something missing; names it.
    """
    columns: dict[str, str] = {}
    settings: dict[str, str] = {}
    for part in text.split(","):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or not value:
            raise ReaderError(f"--columns: '{plain(part)}' is not key=value; e.g. t=time,qw=w,qx=x,qy=y,qz=z")
        if key in columns or key in settings:
            raise ReaderError(f"--columns: {plain(key)} is given twice")
        if key in _COLUMN_KEYS:
            columns[key] = value
        elif key in _SETTINGS:
            settings[key] = value = value.lower()
            _, allowed = _SETTINGS[key]
            if allowed and value not in allowed:
                raise ReaderError(f"--columns: {key}={plain(value)} is not one of {', '.join(allowed)}")
        else:
            raise ReaderError(
                f"--columns: unknown key '{plain(key)}'; there are {', '.join((*_COLUMN_KEYS, *_SETTINGS))}"
            )
    _check(columns, settings)
    return ColumnSpec(columns=tuple(columns.items()), declared=True, **settings)


def _check(columns: dict[str, str], settings: dict[str, str]) -> None:
    with_quaternion = any(key in columns for key in QUATERNION)
    with_euler = any(key in columns for key in EULER)
    if with_quaternion == with_euler:
        raise ReaderError("--columns needs either qw, qx, qy, qz or e1, e2, e3 with euler= and angle=")
    for group in (QUATERNION if with_quaternion else EULER, POSITION, ACCELERATION):
        missing = [key for key in group if key not in columns]
        optional = group in (POSITION, ACCELERATION)
        if missing and not (optional and len(missing) == len(group)):
            raise ReaderError(f"--columns: {', '.join(missing)} missing")
    for key, value in settings.items():
        column, _ = _SETTINGS[key]
        if column and column not in columns:
            raise ReaderError(f"--columns: {key}={plain(value)} says something of {column}, which is not there")
    if with_euler:
        kind, _, order = settings.get("euler", "").partition("-")
        axes = order.replace("-", "")
        if kind not in ("intrinsic", "extrinsic") or not _is_order(axes):
            raise ReaderError("--columns: Euler angles need euler=intrinsic-zyx, extrinsic-xyz or the like")
        if "angle" not in settings:
            raise ReaderError("--columns: Euler angles need angle=deg or angle=rad")
        settings["euler"] = f"{kind}-{axes}"
    elif settings.get("product") == "jpl" and "maps" not in settings:
        raise ReaderError("--columns: product=jpl needs maps= as well: JPL data usually have maps=world-to-body")


def _is_order(axes: str) -> bool:
    return len(axes) == 3 and set(axes) <= set("xyz") and axes[0] != axes[1] and axes[1] != axes[2]


def guess_names(header: tuple[str, ...]) -> ColumnSpec | None:
    """Recognise column names: time and the four parts of a quaternion, with the position where there is one.

    Returns
    -------
    What the columns mean, or None where the names leave a doubt.
    """
    found: dict[str, str] = {}
    units: dict[str, str] = {}
    for name in header:
        small = name.lower()
        if match := _TIME_NAME.match(small):
            key, unit = "t", {"sec": "s", None: "s"}.get(match[1], match[1])
            units.setdefault("time", unit)
        elif match := _POSITION_NAME.match(small):
            key = "p" + match[1]
            units.setdefault("length", match[2] or "m")
        elif match := _QUATERNION_NAME.match(small):
            key = "q" + match[1]
        else:
            continue
        if key in found:  # two candidates: a person has to choose
            return None
        found[key] = name
    if not set(QUATERNION) <= set(found):
        return None
    if not set(POSITION) <= set(found):
        found = {key: name for key, name in found.items() if key not in POSITION}
        units.pop("length", None)
    return ColumnSpec(columns=tuple(found.items()), declared=False, **units)


def column_numbers(spec: ColumnSpec, header: Sequence[str], width: int) -> tuple[int, ...]:
    """Find the declared columns.

    Parameters
    ----------
    spec : ColumnSpec
        The declaration.
    header : sequence of str
        Column names; empty where the file has no header.
    width : int
        Number of columns.

    Returns
    -------
    One 0-based column number for each of ``spec.keys``.

    Raises
    ------
    ReaderError
        No such column, or two of the same name.
    """
    found, columns = [], list(header)
    for key in spec.keys:
        name = spec.names[key]
        if name.startswith("#") and name[1:].isdigit() and name not in header:
            if len(name) > 5 or int(name[1:]) >= width:
                raise ReaderError(
                    f"--columns: {key}={plain(name)}, but the file has {width} columns, #0 to #{width - 1}"
                )
            found.append(int(name[1:]))
        elif columns.count(name) > 1:
            raise ReaderError(f"--columns: two columns are called '{plain(name)}'; name it by number, like #3")
        elif name in columns:
            found.append(columns.index(name))
        else:
            there = ", ".join(plain(column) for column in header[:20]) or "no header; name columns by number, like #3"
            raise ReaderError(f"--columns: no column '{plain(name)}' for {key}; the file has {there}")
    return tuple(found)


def orientations(spec: ColumnSpec, values: FloatArray) -> FloatArray:
    """Turn declared columns into Hamilton body-to-world quaternions.

    A JPL quaternion that maps world to body has the same four numbers as the Hamilton one that maps body to world;
    each single departure (JPL, or world to body) conjugates.

    Parameters
    ----------
    spec : ColumnSpec
        The declaration.
    values : array of float
        (n, 4) w, x, y, z or (n, 3) Euler angles, as in the file.

    Returns
    -------
    (n, 4) scalar first; norms are left as they are.
    """
    if spec.euler:
        kind, order = spec.euler.split("-")
        quats = from_euler(values * ANGLE_UNITS[spec.angle], order, intrinsic=kind == "intrinsic")
    else:
        quats = values
    conjugated = (spec.product == "jpl") != (spec.maps == "world-to-body")
    return rotations.conjugate(quats) if conjugated else quats


def samples_of(table: FloatArray, spec: ColumnSpec) -> RawSamples:
    """Turn columns into samples.

    Parameters
    ----------
    table : array of float
        (n, k) values in the order of ``spec.keys``.
    spec : ColumnSpec
        What they mean.
    """
    place = {key: number for number, key in enumerate(spec.keys)}

    def group(keys: tuple[str, ...]) -> FloatArray | None:
        return table[:, [place[key] for key in keys]] if keys[0] in place else None

    rotation = group(EULER if spec.euler else QUATERNION)
    assert rotation is not None
    position, acceleration = group(POSITION), group(ACCELERATION)
    times_s = table[:, place["t"]] * TIME_UNITS[spec.time] if "t" in place else None
    guessed = "columns recognised by their names; Hamilton, body to world assumed (--columns says otherwise)"
    return RawSamples(
        quats_wxyz=orientations(spec, rotation),
        times_s=times_s,
        positions_m=None if position is None else position * LENGTH_UNITS[spec.length],
        accelerations_mps2=None if acceleration is None else acceleration * ACCELERATION_UNITS[spec.accel],
        convention=spec.convention,
        notes=() if spec.declared else (guessed,),
        warnings=_unit_warnings(spec, rotation, times_s),
    )


def _unit_warnings(spec: ColumnSpec, rotation: FloatArray, times_s: FloatArray | None) -> tuple[str, ...]:
    warnings = []
    if spec.euler:
        largest = float(np.abs(rotation).max())
        if spec.angle == "rad" and largest > 2.0 * np.pi + 0.1:
            warnings.append(f"angles reach {largest:.1f} though declared in radians; are they degrees?")
        if spec.angle == "deg" and largest < np.pi + 0.01:
            warnings.append(f"no angle exceeds {largest:.2f} though declared in degrees; are they radians?")
    if times_s is not None and len(times_s) > 1:
        usual = float(np.median(np.abs(np.diff(times_s))))
        if usual > 1.0 or 0.0 < usual < 5e-5:
            warnings.append(f"samples are {usual:.3g} s apart; is the time really in {spec.time}?")
    return tuple(warnings)
