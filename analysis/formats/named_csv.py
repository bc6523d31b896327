"""CSV whose columns are declared with ``--columns``, or named so that nothing needs declaring.

Written with units in the names, so that reading it back needs no declaration.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.formats.columns import (
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
from analysis.formats.errors import WriterError
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
from analysis.series import FloatArray, OrientationSeries, ReaderError

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


WRITTEN_POSITION = ("px_m", "py_m", "pz_m")
"""Names of the position's columns in tables written here."""


def csv_text(series: OrientationSeries) -> str:
    """Write samples: name of the sample, time in s, quaternion, position in m where there is one.

    Numbers carry 17 digits, so that reading them back gives the very same values.

    Parameters
    ----------
    series
        What to write.
    """
    names = [series.index_kind, "t_s", *QUATERNION]
    columns = [series.index.astype(np.float64), series.times_s, *series.quats_wxyz.T]
    formats = ["%d", "%.9f", *["%.17g"] * 4]
    if series.positions_m is not None:
        names += WRITTEN_POSITION
        columns += list(series.positions_m.T)
        formats += ["%.17g"] * 3
    buffer = io.StringIO()
    np.savetxt(buffer, np.stack(columns, axis=1), fmt=formats, delimiter=",", header=",".join(names), comments="")
    return buffer.getvalue()


def endpoints_csv_text(result: dict[str, Any]) -> str:
    """Write end points: number, sample, time in s, the quaternion that was scored, flags, reason.

    Parameters
    ----------
    result
        A score as JSON values.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    points = result.get("endpoints") or []
    kind = "sequence" if points and "sequence" in points[0] else "row"
    writer.writerow(["endpoint", kind, "t_s", *QUATERNION, "flags", "reason"])
    for number, point in enumerate(points, start=1):
        quat = [repr(float(part)) for part in point["quat_wxyz"]]
        flags = "; ".join(point.get("flags") or [])
        writer.writerow(
            [number, point[kind], repr(float(point["time_s"])), *quat, flags, safe_cell(point.get("reason", ""))]
        )
    return buffer.getvalue()


def safe_cell(text: str) -> str:
    """Keep a spreadsheet from taking a text for a formula; also where it drops what stands before it.

    Parameters
    ----------
    text
        What a person wrote.
    """
    return f"'{text}" if text.lstrip()[:1] in {"=", "+", "-", "@", "|", "%"} or text[:1] in {"\t", "\r"} else text


def write_csv(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write samples as CSV; see :func:`csv_text`."""
    del result
    path.write_text(csv_text(series), encoding="utf-8")
    return ()


def write_endpoints_csv(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write end points as CSV; see :func:`endpoints_csv_text`.

    Raises
    ------
    WriterError
        No score was given.
    """
    del series
    if result is None:
        raise WriterError("end points need a score")
    path.write_text(endpoints_csv_text(result), encoding="utf-8")
    return () if result.get("valid") else ("these end points make no valid score: " + "; ".join(result["reasons"]),)
