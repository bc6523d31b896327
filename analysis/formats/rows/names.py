"""Columns recognised by their names: time, quaternions, positions, and columns that tell sensors apart."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

_UNIT_WORDS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "millis": "ms", "millisecond": "ms", "milliseconds": "ms",
    "us": "us", "µs": "us", "usec": "us", "micros": "us", "microsecond": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nanos": "ns", "nanosecond": "ns", "nanoseconds": "ns",
}  # fmt: skip
_UNIT = "|".join(sorted(_UNIT_WORDS, key=len, reverse=True))
_USUAL_TIME = re.compile(rf"(?:t|ts|time|time_?stamp|stamp)(?:[_ ]*,?[_ ]?[(\[]?({_UNIT})[)\]]?)?")
_OTHER_TIME = re.compile(
    r"(?:elapsed|elapsed[_ ]?time|time[_ ]?elapsed|time ?stamp|sampletimefine|rosbagtimestamp|date|date[_ ]?time|utc|"
    r"(?:utc|epoch|unix|device|host|sensor|system|log|local|rec|recording|relative|sample|capture|packet|header|gps|"
    r"reception|arrival|world|sim)[_ ]?(?:time|time ?stamp|time_stamp|stamp|clock|ticks)|unix|epoch|clock|"
    rf"(?:field\.)?header\.stamp|ticks|seconds|millis|micros)(?:[_ ]*,?[_ ]?[(\[]?({_UNIT})[)\]]?)?"
)
_OWN_UNITS = {
    "sampletimefine": "us",
    "sampletime": "100us",
    "rosbagtimestamp": "ns",
    "%time": "ns",
    "field.header.stamp": "ns",
    "millis": "ms",
    "micros": "us",
}
_NANOSECONDS = re.compile(r"(.*?)(?:nsecs?|nanosecs?|nanoseconds?)")
_PART = re.compile(r"(?P<prefix>.*?)[\s_./\[(-]*(?P<part>w|x|y|z|scalar)[\])]?", re.DOTALL)
_XSENS_PART = re.compile(r"(?P<prefix>quat)_?q(?P<part>[0-3])")  # MT Manager; bare q0 … q3 may end with the scalar
_KEYWORD = re.compile(r"(?:^|(?<=[\W_]))(?:q|quat|quaternion|orientation|ori|rot|rotation|attitude)$")
_PARTS = {"scalar": "w", "0": "w", "1": "x", "2": "y", "3": "z"}
_POSITION = re.compile(r"(?:.*[\s_./])?(?:p|pos|position|t|translation)[\s_./]?([xyz])(?:[_ ]?[(\[]?(m|cm|mm)[)\]]?)?")
_LABEL = re.compile(
    r"(?:sensor|device|imu|tracker|object|body|rigid ?body|node|segment|source|publisher|child_frame|topic)"
    r"(?:[ _]?(?:id|name|no|nr|number|tag|label|serial))?|frame_id|channel|id|serial(?:[ _]?number)?|station"
)
EULER_NAMES = frozenset({
    "yaw", "pitch", "roll", "heading", "azimuth", "elevation", "psi", "theta", "phi",
    "euler_x", "euler_y", "euler_z", "eulerx", "eulery", "eulerz",
})  # fmt: skip
"""Names that Euler angles go by."""


@dataclass(frozen=True)
class Recognised:
    """What the names of a table's columns show."""

    time: dict[str, str]
    """``t``, and perhaps ``tn``, to a column's name; empty where no column, or more than one, can be the time."""
    time_unit: str
    quaternions: dict[str, dict[str, str]]
    """Sensor -> ``qw`` … ``qz`` to a column's name."""
    position: dict[str, str]
    """``px`` … ``pz`` to a column's name, where there is one position."""
    length_unit: str


def recognise(header: Sequence[str]) -> Recognised | None:
    """Return what the names show; None where two columns of one name leave a doubt."""
    quaternions = _quaternions(header)
    if quaternions is None:
        return None
    time, unit, doubt = _time(header)
    if doubt:
        return None
    position, length = _position(header)
    return Recognised(time, unit, quaternions, position, length)


def label_column(name: str) -> bool:
    """Return whether a column by its name tells sensors apart."""
    small = name.lower().strip().lstrip("_%")
    return any(_LABEL.fullmatch(part) is not None for part in {small, _last(small), small.rpartition(".")[2]})


def euler_columns(header: Sequence[str]) -> list[str]:
    """Return the columns whose names are those of Euler angles."""
    found = []
    for name in header:
        small = re.sub(r"[\s_]*[(\[].*", "", name.lower().strip())
        if {small, re.split(r"[\s_./]", small)[-1]} & EULER_NAMES:
            found.append(name)
    return found


def _last(name: str) -> str:
    """Return the last part of a path like ``/imu/orientation/x``."""
    return name.rpartition("/")[2] if name.startswith("/") else name


def _time(header: Sequence[str]) -> tuple[dict[str, str], str, bool]:
    """Return the time's columns, its unit, and whether there is a doubt: usual names go before unusual ones."""
    usual, other = [], []
    pair = _seconds_and_nanoseconds(header)
    for name in header:
        if name in pair.values():
            continue
        small = name.lower().strip()
        plain = _last(small.lstrip("_%").strip())
        if match := _USUAL_TIME.fullmatch(plain):
            usual.append((name, _OWN_UNITS.get(small, _UNIT_WORDS.get(match[1] or "s", "s"))))
        elif match := _OTHER_TIME.fullmatch(plain):
            other.append((name, _OWN_UNITS.get(small, _OWN_UNITS.get(plain, _UNIT_WORDS.get(match[1] or "s", "s")))))
    if len(usual) > 1:
        return {}, "s", True
    if usual:
        return {"t": usual[0][0]}, usual[0][1], False
    if pair:
        return pair, "s", False
    if len(other) == 1 or (other and _last(other[0][0].lower()) == "sampletimefine"):
        return {"t": other[0][0]}, other[0][1], False
    return {}, "s", bool(other)


def _seconds_and_nanoseconds(header: Sequence[str]) -> dict[str, str]:
    small = [name.lower().strip() for name in header]
    for place, name in enumerate(small):
        match = _NANOSECONDS.fullmatch(name)
        partners = [] if match is None else [match[1] + word for word in ("sec", "secs", "seconds", "s")]
        partner = next((word for word in partners if word in small), None)
        if partner is not None:
            return {"t": header[small.index(partner)], "tn": header[place]}
    return {}


def _quaternions(header: Sequence[str]) -> dict[str, dict[str, str]] | None:
    """Return the whole quaternions by sensor; None where one has a part twice."""
    groups: dict[str, dict[str, str]] = {}
    twice: set[str] = set()
    for name in header:
        small = name.strip().lower()
        match = _XSENS_PART.fullmatch(small) or _PART.fullmatch(small)
        if match is None:
            continue
        prefix = match["prefix"]
        key = "q" + _PARTS.get(match["part"], match["part"])
        group = groups.setdefault(prefix, {})
        if key in group:
            twice.add(prefix)
        group[key] = name
    whole = {prefix: parts for prefix, parts in groups.items() if len(parts) == 4}
    if twice & set(whole):
        return None
    labels = {prefix: _KEYWORD.sub("", prefix).strip(" _./[(-") for prefix in whole}
    if len(set(labels.values())) < len(whole):
        labels = {prefix: prefix for prefix in whole}
    return {labels[prefix] or "(unnamed)": parts for prefix, parts in whole.items()}


def _position(header: Sequence[str]) -> tuple[dict[str, str], str]:
    found: dict[str, str] = {}
    unit = "m"
    for name in header:
        match = _POSITION.fullmatch(name.strip().lower())
        if match is None:
            continue
        if "p" + match[1] in found:
            return {}, "m"  # two candidates: better none
        found["p" + match[1]] = name
        unit = match[2] or unit
    return (found, unit) if len(found) == 3 else ({}, "m")
