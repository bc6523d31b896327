"""What the columns of a file mean: names, units, order and convention, declared in one line or read off their names.

``t=time,qw=q0,qx=q1,qy=q2,qz=q3,time=ms,product=jpl,maps=world-to-body`` or
``t=ts,e1=yaw,e2=pitch,e3=roll,angle=deg,euler=intrinsic-zyx``

=========== ============================================================ ==============
key         meaning                                                      default
=========== ============================================================ ==============
t           column with time                                             none: give the rate
tn          column with the nanoseconds, where t holds whole seconds     none
qw qx qy qz columns of the quaternion, each named: in any order
e1 e2 e3    columns of the Euler angles, in the order of ``euler``
rv1 rv2 rv3 columns of the rotation vector (axis times angle)
px py pz    columns of the position                                      none
ax ay az    columns of the acceleration, body frame                      none
time        unit of t: s, ms, us, ns, 100us (ticks of 10 kHz)            s
angle       unit of e1 e2 e3 or rv1 rv2 rv3: rad, deg                    must be given, but rad for rv1 rv2 rv3
euler       intrinsic-zyx, extrinsic-xyz, …                              must be given
length      unit of px py pz: m, cm, mm, inch                            m
accel       unit of ax ay az: mps2, g                                    mps2
product     hamilton or jpl                                              hamilton
maps        body-to-world or world-to-body                               body-to-world
=========== ============================================================ ==============

A column is given by its name in the header, or as ``#2`` by its 0-based number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.formats.rows.names import euler_columns, recognise
from analysis.formats.rows.streams import StreamChoice, chosen
from analysis.formats.source import plain
from analysis.formats.time_stamps import RawSamples
from analysis.geometry import rotations
from analysis.geometry.euler_angles import from_euler, is_order
from analysis.series import FloatArray, ReaderError

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "100us": 1e-4}
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}
ANGLE_UNITS = {"rad": 1.0, "deg": np.pi / 180.0}
ACCELERATION_UNITS = {"mps2": 1.0, "g": 9.80665}
QUATERNION = ("qw", "qx", "qy", "qz")
EULER = ("e1", "e2", "e3")
ROTATION_VECTOR = ("rv1", "rv2", "rv3")
POSITION = ("px", "py", "pz")
ACCELERATION = ("ax", "ay", "az")
_COLUMN_KEYS = ("t", "tn", *QUATERNION, *EULER, *ROTATION_VECTOR, *POSITION, *ACCELERATION)
_SETTINGS: dict[str, tuple[str, tuple[str, ...]]] = {
    "time": ("t", tuple(TIME_UNITS)),
    "angle": ("", tuple(ANGLE_UNITS)),
    "length": ("px", tuple(LENGTH_UNITS)),
    "accel": ("ax", tuple(ACCELERATION_UNITS)),
    "product": ("qw", ("hamilton", "jpl")),
    "maps": ("", ("body-to-world", "world-to-body")),
    "euler": ("e1", ()),
}
"""Key -> the column without which it has no meaning, and its values; none listed where they are checked otherwise."""
_GUESSED = "columns recognised by their names; Hamilton, body to world assumed (--columns says otherwise)"
MAX_TURNING_DEG_S = 1_000.0
"""Nobody turns an object faster than this for a quarter of the time: such angles are in another unit."""


@dataclass(frozen=True)
class ColumnSpec:
    """Meaning of a file's columns; the settings are those of the table above."""

    names: dict[str, str]
    """Key to column name or #number, in the order of the table above."""
    time: str = "s"
    angle: str = ""
    euler: str = ""
    length: str = "m"
    accel: str = "mps2"
    product: str = "hamilton"
    maps: str = "body-to-world"
    declared: bool = True
    """False where the meaning was guessed from the names, which the notes of the samples then report."""

    @property
    def convention(self) -> str:
        """The convention in words, for the result."""
        if self.euler:
            kind, order = self.euler.split("-")
            named = ", ".join(plain(self.names[key]) for key in EULER)
            what = f"Euler {kind} {'-'.join(order)} ({named}), {self.angle}"
        elif ROTATION_VECTOR[0] in self.names:
            named = ", ".join(plain(self.names[key]) for key in ROTATION_VECTOR)
            what = f"rotation vector ({named}), {self.angle or 'rad'}"
        else:
            named = ",".join(plain(self.names[key]) for key in QUATERNION)
            what = f"quaternion w,x,y,z = {named}, {'Hamilton' if self.product == 'hamilton' else 'JPL'}"
        return f"{what}, {self.maps.replace('-', ' ')}"


def parse_columns(text: str) -> ColumnSpec:
    """Parse a declaration: ``key=value`` pairs with commas between; the keys are those of this module's table.

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
    return ColumnSpec({key: columns[key] for key in _COLUMN_KEYS if key in columns}, declared=True, **settings)


def _check(columns: dict[str, str], settings: dict[str, str]) -> None:
    with_euler = any(key in columns for key in EULER)
    forms = [form for form in (QUATERNION, EULER, ROTATION_VECTOR) if any(key in columns for key in form)]
    if len(forms) != 1:
        raise ReaderError(
            "--columns needs either qw, qx, qy, qz, or e1, e2, e3 with euler= and angle=, or rv1, rv2, rv3"
        )
    if "tn" in columns and "t" not in columns:
        raise ReaderError("--columns: tn holds the nanoseconds beside t, which is not there")
    if "angle" in settings and forms[0] is QUATERNION:
        raise ReaderError(f"--columns: angle={settings['angle']} describes e1, which is not there")
    for group in (forms[0], POSITION, ACCELERATION):
        missing = [key for key in group if key not in columns]
        optional = group in (POSITION, ACCELERATION)
        if missing and not (optional and len(missing) == len(group)):
            raise ReaderError(f"--columns: {', '.join(missing)} missing")
    for key, value in settings.items():
        column, _ = _SETTINGS[key]
        if column and column not in columns:
            raise ReaderError(f"--columns: {key}={plain(value)} describes {column}, which is not there")
    if with_euler:
        kind, _, order = settings.get("euler", "").partition("-")
        axes = order.replace("-", "")
        if kind not in ("intrinsic", "extrinsic") or not is_order(axes):
            raise ReaderError("--columns: Euler angles need euler=intrinsic-zyx, extrinsic-xyz or the like")
        if "angle" not in settings:
            raise ReaderError("--columns: Euler angles need angle=deg or angle=rad")
        settings["euler"] = f"{kind}-{axes}"
    elif settings.get("product") == "jpl" and "maps" not in settings:
        raise ReaderError("--columns: product=jpl needs maps= as well: JPL data usually have maps=world-to-body")


def guess_names(header: tuple[str, ...], choice: StreamChoice) -> ColumnSpec | None:
    """Recognise time, quaternion and perhaps position by the names of the columns; None where these leave a doubt.

    Raises SeveralStreamsError where there are quaternions of several sensors.
    """
    found = recognise(header)
    if found is None or not found.quaternions:
        return None
    wanted = choice.sensor if len(found.quaternions) > 1 else None
    sensor = chosen("sensor", tuple(found.quaternions), wanted)
    names = found.time | found.quaternions[sensor] | (found.position if len(found.quaternions) == 1 else {})
    units = {"time": found.time_unit} if found.time else {}
    if found.position:
        units["length"] = found.length_unit
    return ColumnSpec({key: names[key] for key in _COLUMN_KEYS if key in names}, declared=False, **units)


def hint(header: Sequence[str]) -> str:
    """Return the declaration to write for a header: in the Euler form where the names are those of Euler angles."""
    angles = euler_columns(header)
    if len(angles) == 3:
        named = ",".join(f"{key}={plain(name)}" for key, name in zip(EULER, angles, strict=True))
        return f"--columns t=…,{named},angle=deg,euler=intrinsic-zyx (order and unit as they are)"
    small = [name.strip().lower() for name in header]
    if {"rx", "ry", "rz"} <= set(small):
        return (
            "--columns t=…,rv1=rx,rv2=ry,rv3=rz where they are a rotation vector (robots, solvePnP), or "
            "t=…,e1=rx,e2=ry,e3=rz,angle=rad,euler=extrinsic-xyz where they are Euler angles"
        )
    return "--columns t=…,qw=…,qx=…,qy=…,qz=…"


def column_numbers(spec: ColumnSpec, header: Sequence[str], width: int) -> tuple[int, ...]:
    """Return the 0-based number of each of ``spec.names`` in a file of ``width`` columns, perhaps without a header.

    Raises
    ------
    ReaderError
        No such column, or two of the same name.
    """
    found, columns = [], list(header)
    for key, name in spec.names.items():
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


def samples_of(table: FloatArray, spec: ColumnSpec, rate_hz: float | None = None) -> RawSamples:
    """Return (n, k) columns, in the order of ``spec.names``, as samples; NaN where the table has a hole.

    ``rate_hz`` is the rate that the file states, for the case that it has no times.
    """
    place = {key: number for number, key in enumerate(spec.names)}

    def group(keys: tuple[str, ...]) -> FloatArray | None:
        return table[:, [place[key] for key in keys]] if keys[0] in place else None

    rotation = group(EULER if spec.euler else ROTATION_VECTOR if ROTATION_VECTOR[0] in place else QUATERNION)
    assert rotation is not None
    whole = np.isfinite(rotation).all(axis=1)
    quats = np.full((len(table), 4), np.nan)
    quats[whole] = _orientations(spec, rotation[whole])
    notes = [] if spec.declared else [_GUESSED]
    optional = {}
    for what, keys in (("positions", POSITION), ("accelerations", ACCELERATION)):
        values = group(keys)
        if values is not None and not np.isfinite(values[whole]).all():
            notes.append(f"the {what} have holes and are left out")
            values = None
        optional[what] = values
    times_s = table[:, place["t"]] * TIME_UNITS[spec.time] if "t" in place else None
    if times_s is not None and "tn" in place:
        times_s = times_s + table[:, place["tn"]] * TIME_UNITS["ns"]
    if times_s is not None and not np.isfinite(times_s).any():
        notes.append(f"the column {plain(spec.names['t'])} is empty")
        times_s = None
    if not whole.any():
        raise ReaderError("no row holds an orientation in the columns named: are they the right ones?")
    if spec.angle and times_s is not None:
        _check_turning(spec, quats, times_s)
    positions, accelerations = optional["positions"], optional["accelerations"]
    return RawSamples(
        quats_wxyz=quats,
        times_s=times_s,
        positions_m=None if positions is None else positions * LENGTH_UNITS[spec.length],
        accelerations_mps2=None if accelerations is None else accelerations * ACCELERATION_UNITS[spec.accel],
        convention=spec.convention,
        notes=tuple(notes),
        warnings=_unit_warnings(spec, rotation[whole], times_s),
        stated_rate_hz=rate_hz,
    )


def _orientations(spec: ColumnSpec, values: FloatArray) -> FloatArray:
    """Return (n, 4) quaternions w, x, y, z or (n, 3) Euler angles as Hamilton body-to-world quaternions."""
    quats = values
    if spec.euler:
        kind, order = spec.euler.split("-")
        quats = from_euler(values * ANGLE_UNITS[spec.angle], order, intrinsic=kind == "intrinsic")
    elif ROTATION_VECTOR[0] in spec.names:
        quats = rotations.exp(values * ANGLE_UNITS[spec.angle or "rad"])
    # A JPL quaternion that maps world to body has the same four numbers as the Hamilton one that maps body to world;
    # each single departure (JPL, or world to body) conjugates.
    conjugated = (spec.product == "jpl") != (spec.maps == "world-to-body")
    return rotations.conjugate(quats) if conjugated else quats


def _check_turning(spec: ColumnSpec, quats_wxyz: FloatArray, times_s: FloatArray) -> None:
    """Refuse angles that, as declared, turn as nobody turns an object."""
    known = np.isfinite(quats_wxyz).all(axis=1) & np.isfinite(times_s)
    steps_s = np.diff(times_s[known])
    forward = steps_s > 0.0
    if np.sum(forward) < 8:
        return
    turned_deg = np.degrees(rotations.distance(quats_wxyz[known][1:], quats_wxyz[known][:-1]))
    fast = float(np.percentile(turned_deg[forward] / steps_s[forward], 75.0))
    if fast > MAX_TURNING_DEG_S:
        other = "deg" if spec.angle == "rad" else "rad"
        raise ReaderError(
            f"as declared the object turns by {fast:.3g}° a second, which no hand does: is it angle={other}, or the "
            f"time not in {spec.time}?"
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
        usual = float(np.nanmedian(np.abs(np.diff(times_s))))
        if usual > 1.0 or 0.0 < usual < 5e-5:
            warnings.append(f"samples are {usual:.3g} s apart; is the time really in {spec.time}?")
    return tuple(warnings)
