"""Differences between a table, JSON or text of a submission and the same file made again.

Numbers are compared as numbers, because another processor rounds the last digits otherwise; everything else is exact.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator

from host.text import plain

ABSOLUTE, RELATIVE = 1e-9, 1e-14
"""Numbers that differ by less than either are equal. Whole numbers are exact."""
MAX_DIFFERENCES = 20
"""Differences listed per file; the rest is counted."""
_NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?|-?\.\d+")


def content_differences(name: str, claimed: bytes, made: bytes) -> list[str]:
    """Return how a file that a submission claims differs from the same file made again; empty where last digits do.

    The suffix of its name decides how it is read: JSON and CSV by value, any other file byte by byte. Nothing in what
    is claimed is trusted, and what cannot be read is a difference.
    """
    if claimed == made:
        return []
    try:
        if name.endswith(".json"):
            found = list(_value_differences("", json.loads(claimed, object_pairs_hook=_once), json.loads(made)))
        elif name.endswith(".csv"):
            found = list(_table_differences(_rows(claimed), _rows(made)))
        else:
            return ["differs"]
        if not found and _NUMBER.sub("#", claimed.decode()) != _NUMBER.sub("#", made.decode()):
            found = ["the same values are written otherwise: order, spaces or line ends"]
    except (ValueError, OverflowError, csv.Error, RecursionError) as error:
        return [f"cannot be read ({plain(error)})"]
    if len(found) > MAX_DIFFERENCES:
        return [*found[:MAX_DIFFERENCES], f"and {len(found) - MAX_DIFFERENCES} more differences"]
    return found


def numbers_equal(one: object, other: object) -> bool:
    """Return whether two values are equal, floating-point numbers within ``ABSOLUTE`` or ``RELATIVE``."""
    if isinstance(one, bool) or isinstance(other, bool):
        return one is other
    if isinstance(one, int | float) and isinstance(other, int | float):
        if isinstance(one, int) and isinstance(other, int):
            return one == other
        return math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return type(one) is type(other) and one == other


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Refuse a name that stands twice in an object: one reader takes the first value, the next one the last."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a name stands twice in one object")
    return found


def _value_differences(at: str, claimed: object, made: object) -> Iterator[str]:
    if isinstance(claimed, dict) and isinstance(made, dict):
        for key in dict.fromkeys([*made, *claimed]):
            place = f"{at}.{plain(key, 60)}" if at else plain(key, 60)
            if key not in claimed:
                yield f"{place} is missing"
            elif key not in made:
                yield f"{place} does not belong there"
            else:
                yield from _value_differences(place, claimed[key], made[key])
    elif isinstance(claimed, list) and isinstance(made, list):
        if len(claimed) != len(made):
            yield f"{at} has {len(claimed)} entries, recomputed {len(made)}"
            return
        for number, (one, other) in enumerate(zip(claimed, made, strict=True)):
            yield from _value_differences(f"{at}[{number}]", one, other)
    elif not numbers_equal(claimed, made):
        yield f"{at} is {_shown(claimed)}, recomputed {_shown(made)}{_by(claimed, made)}"


def _table_differences(claimed: list[list[str]], made: list[list[str]]) -> Iterator[str]:
    if len(claimed) != len(made):
        yield f"{len(claimed)} lines, recomputed {len(made)}"
        return
    # Sequence numbers and counts are exact; a measured value may happen to be a whole number here and not there.
    whole = [all(row[place].isdigit() for row in made[1:] if place < len(row)) for place in range(len(made[0]))]
    for number, (one, other) in enumerate(zip(claimed, made, strict=True), start=1):
        if len(one) != len(other):
            yield f"line {number} has {len(one)} cells, recomputed {len(other)}"
            continue
        for place, (cell, again, column) in enumerate(zip(one, other, made[0], strict=False)):
            ours, theirs = _number(again), _number(cell)
            if cell != again and (whole[place] or not numbers_equal(theirs, ours)):
                yield f"line {number}, {column}: {_shown(cell)}, recomputed {_shown(again)}{_by(theirs, ours)}"


def _rows(data: bytes) -> list[list[str]]:
    return list(csv.reader(io.StringIO(data.decode("utf-8"), newline="")))


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def _by(one: object, other: object) -> str:
    if isinstance(one, bool) or isinstance(other, bool):
        return ""
    if isinstance(one, int | float) and isinstance(other, int | float):
        return f" (differs by {one - other:+.3g})"
    return ""


def _shown(value: object) -> str:
    return plain(json.dumps(value, ensure_ascii=False) if not isinstance(value, str) else value, 80)
