"""Differences between a table, JSON or text of a submission and the same file made again.

Numbers are compared as numbers, because another processor rounds the last digits otherwise; everything else is exact. A
number that differs must still be written as the program writes one, so a file whose bytes differ holds other last
digits and nothing else.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import msgspec

from host.text import plain

ABSOLUTE, RELATIVE = 1e-9, 1e-14
"""Numbers that differ by less than either are equal. Whole numbers are exact."""
MAX_DIFFERENCES = 20
"""Differences listed per file; the rest is counted."""
SENTENCES = {"warnings", "reasons", "notes", "note", "flags"}
"""Keys of sentences for a person: the next release may word them otherwise, or add one."""
_NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?|-?\.\d+")
_SPELLINGS: tuple[Callable[[float], str], ...] = (
    repr,
    "%.17g".__mod__,
    "%.9f".__mod__,
    lambda value: msgspec.json.encode(value).decode(),
)
"""The ways in which files of a submission write a floating-point number."""


@dataclass(frozen=True)
class Difference:
    """One difference, as a sentence."""

    text: str
    of_program: bool = False
    """Whether another release of the program explains it: a key that it does not know, a sentence in other words."""


def content_differences(name: str, claimed: bytes, made: bytes) -> list[Difference]:
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
            same_numbers = _NUMBER.findall(claimed.decode()) == _NUMBER.findall(made.decode())
            return [Difference("differs", of_program=same_numbers and not name.endswith(".toml"))]
        if not found and not _only_last_digits(claimed.decode(), made.decode()):
            found = [Difference("the same values are written otherwise: order, spaces, line ends or digits")]
    except (ValueError, OverflowError, csv.Error, RecursionError) as error:
        return [Difference(f"cannot be read ({plain(error)})")]
    if len(found) > MAX_DIFFERENCES:
        rest = found[MAX_DIFFERENCES:]
        more = Difference(f"and {len(rest)} more differences", all(difference.of_program for difference in rest))
        return [*found[:MAX_DIFFERENCES], more]
    return found


def numbers_equal(one: object, other: object) -> bool:
    """Return whether two values are equal, floating-point numbers within ``ABSOLUTE`` or ``RELATIVE``."""
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    return type(one) is type(other) and one == other  # True is not 1, and 1 is not 1.0


def _only_last_digits(claimed: str, made: str) -> bool:
    """Return whether two texts of equal values differ in the digits of numbers alone, each in the program's spelling.

    Otherwise 0.5 could stand as 0.50 or 5e-1: the same value, but bytes that no program here writes.
    """
    if _NUMBER.sub("#", claimed) != _NUMBER.sub("#", made):
        return False
    return all(
        ours == theirs or any(spell(float(ours)) == ours and spell(float(theirs)) == theirs for spell in _SPELLINGS)
        for theirs, ours in zip(_NUMBER.findall(claimed), _NUMBER.findall(made), strict=True)
    )


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Refuse a name that stands twice in an object: one reader believes the first value, the next one the last."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a name stands twice in one object")
    return found


def _value_differences(at: str, claimed: object, made: object, *, sentence: bool = False) -> Iterator[Difference]:
    """Yield the differences below one place of a JSON file; ``sentence`` where its texts are for a person.

    Yields
    ------
    Difference
        In the order of what was made.
    """
    if isinstance(claimed, dict) and isinstance(made, dict):
        for key in dict.fromkeys([*made, *claimed]):
            place = f"{at}.{plain(key, 60)}" if at else plain(key, 60)
            if key not in claimed:
                yield Difference(f"{place} is missing", of_program=True)
            elif key not in made:
                yield Difference(f"{place} does not belong there")
            else:
                yield from _value_differences(place, claimed[key], made[key], sentence=sentence or key in SENTENCES)
    elif isinstance(claimed, list) and isinstance(made, list):
        if len(claimed) != len(made):
            yield Difference(f"{at} has {len(claimed)} entries, recomputed {len(made)}", of_program=sentence)
            return
        for number, (one, other) in enumerate(zip(claimed, made, strict=True)):
            yield from _value_differences(f"{at}[{number}]", one, other, sentence=sentence)
    elif not numbers_equal(claimed, made):
        worded = sentence and isinstance(claimed, str) and isinstance(made, str)
        yield Difference(f"{at} is {_shown(claimed)}, recomputed {_shown(made)}{_by(claimed, made)}", of_program=worded)


def _table_differences(claimed: list[list[str]], made: list[list[str]]) -> Iterator[Difference]:
    if len(claimed) != len(made):
        yield Difference(f"{len(claimed)} lines, recomputed {len(made)}")
        return
    # Sequence numbers and counts are exact; a measured value may happen to be a whole number here and not there.
    whole = [all(row[place].isdigit() for row in made[1:] if place < len(row)) for place in range(len(made[0]))]
    for number, (one, other) in enumerate(zip(claimed, made, strict=True), start=1):
        if len(one) != len(other):
            yield Difference(f"line {number} has {len(one)} cells, recomputed {len(other)}")
            continue
        for place, (cell, again, column) in enumerate(zip(one, other, made[0], strict=False)):
            ours, theirs = _number(again), _number(cell)
            if cell != again and (whole[place] or not numbers_equal(theirs, ours)):
                yield Difference(
                    f"line {number}, {column}: {_shown(cell)}, recomputed {_shown(again)}{_by(theirs, ours)}",
                    of_program=column in SENTENCES,
                )


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
