"""CSV whose columns are declared with ``--columns``, or named so that nothing needs declaring."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.readers.column_spec import (
    ACCELERATION,
    ACCELERATION_UNITS,
    EULER,
    LENGTH_UNITS,
    POSITION,
    QUATERNION,
    TIME_UNITS,
    ColumnSpec,
    column_numbers,
    orientations,
)
from analysis.readers.number_table import (
    Layout,
    delimiter_of,
    header_lines,
    is_numeric_row,
    plain,
    read_table,
    split_header,
    split_row,
)
from analysis.readers.time_stamps import RawSamples
from analysis.series import FloatArray, ReaderError

_TIME_NAME = re.compile(r"^(?:t|ts|time|timestamp|time_?stamp|stamp)(?:[_ ]?[(\[]?(s|sec|ms|us|ns)[)\]]?)?$")
_QUATERNION_NAME = re.compile(r"^(?:q|quat|quaternion|orientation|rot|rotation)?[_. ]?([wxyz])$")
_POSITION_NAME = re.compile(r"^(?:p|pos|position|t)[_. ]?([xyz])(?:[_ ]?[(\[]?(m|cm|mm)[)\]]?)?$")


def guess_columns(lines: list[str]) -> ColumnSpec | None:
    """Recognise a header that names time and the four parts of a quaternion.

    Parameters
    ----------
    lines
        The first lines of the file.

    Returns
    -------
    What the columns mean, or None where the header does not say so beyond doubt.
    """
    if not lines:
        return None
    return guess_names(split_header(lines[0], delimiter_of(lines)))


def guess_names(header: tuple[str, ...]) -> ColumnSpec | None:
    """Recognise column names; see :func:`guess_columns`.

    Parameters
    ----------
    header
        Column names.
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
        if key in found:  # two candidates: a person has to say which
            return None
        found[key] = name
    if not set(QUATERNION) <= set(found):
        return None
    if not set(POSITION) <= set(found):
        found = {key: name for key, name in found.items() if key not in POSITION}
        units.pop("length", None)
    return ColumnSpec(columns=tuple(found.items()), **units)


def read_named(path: Path, lines: list[str], spec: ColumnSpec, *, declared: bool = True) -> RawSamples:
    """Read a CSV by its column names.

    Parameters
    ----------
    path
        The file.
    lines
        Its first lines.
    spec
        What the columns mean.
    declared
        False when ``spec`` was guessed from the header, which the notes then say.

    Returns
    -------
    RawSamples

    Raises
    ------
    ReaderError
        No such column, or a cell that is no number.
    """
    if not lines:
        raise ReaderError(f"{plain(path.name, 80)} is empty: record again, or give another file")
    delimiter = delimiter_of(lines)
    first = split_header(lines[0], delimiter)
    header = () if is_numeric_row(split_row(lines[0], delimiter)) else first
    numbers = column_numbers(spec, header, len(first))
    names = tuple(spec.names[key] for key in spec.keys)
    layout = Layout(delimiter, header_lines(lines) if header else 0, numbers, names)
    table, cut = read_table(path, layout)
    samples = samples_of(table, spec, str(path), declared=declared)
    return replace(samples, notes=(*samples.notes, *cut))


def samples_of(table: FloatArray, spec: ColumnSpec, source: str, *, declared: bool = True) -> RawSamples:
    """Turn declared columns into samples; used by every reader of named columns.

    Parameters
    ----------
    table
        (n, k) values in the order of ``spec.keys``.
    spec
        What they mean.
    source
        For people.
    declared
        False when ``spec`` was guessed.

    Returns
    -------
    RawSamples
    """
    place = {key: number for number, key in enumerate(spec.keys)}

    def group(keys: tuple[str, ...]) -> FloatArray | None:
        return table[:, [place[key] for key in keys]] if keys[0] in place else None

    rotation = group(EULER if spec.euler else QUATERNION)
    assert rotation is not None
    position, acceleration = group(POSITION), group(ACCELERATION)
    times_s = table[:, place["t"]] * TIME_UNITS[spec.time] if "t" in place else None
    notes = []
    if not declared:
        notes.append("columns recognised by their names; Hamilton, body to world assumed (--columns says otherwise)")
    return RawSamples(
        quats_wxyz=orientations(spec, rotation),
        times_s=times_s,
        positions_m=None if position is None else position * LENGTH_UNITS[spec.length],
        accelerations_mps2=None if acceleration is None else acceleration * ACCELERATION_UNITS[spec.accel],
        convention=spec.convention,
        source=source,
        notes=tuple(notes),
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
