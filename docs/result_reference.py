"""The tables of ``docs/result.md``, made from the result type: ``python -m docs.result_reference`` writes them.

A test compares the document with what this makes.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from analysis.scoring.result import Result
from docs.source_reading import filled, meanings

PAGE = Path(__file__).with_name("result.md")
NAMES = {float: "number", int: "whole number", str: "text", bool: "true or false", type(None): "null", object: "any"}


def parts(cls: type[Any], path: str = "") -> Iterator[tuple[str, type[Any]]]:
    """Return every object of the JSON with its place, the outer ones first; one that recurs at its first place."""
    seen: set[type[Any]] = set()

    def walk(part: type[Any], place: str) -> Iterator[tuple[str, type[Any]]]:
        if part in seen:
            return
        seen.add(part)
        yield place, part
        for name, hint in _hints(part).items():
            for inner, is_list in _objects(hint):
                yield from walk(inner, f"{place}.{name}".lstrip(".") + "[]" * is_list)

    yield from walk(cls, path)


def tables() -> str:
    """Return a table of the keys of every object in a result."""
    lines: list[str] = []
    first_place = {part: place for place, part in parts(Result)}
    for place, part in parts(Result):
        found = meanings(part)
        lines += [f"### {f'`{place}`' if place else 'At the top'}", "", _first_line(part), ""]
        lines += ["| key | type | meaning |", "|---|---|---|"]
        for name, hint in _hints(part).items():
            see = [f"→ [`{first_place[inner]}`](#{_anchor(first_place[inner])})" for inner, _ in _objects(hint)]
            meaning = " ".join([found.get(name, ""), *see]).strip().replace("None", "null")
            lines.append(f"| `{name}` | {_type_name(hint)} | {meaning} |")
        lines.append("")
    return "\n".join(lines).rstrip()


def missing_meanings() -> list[str]:
    """Return the keys of which the code says nothing."""
    return [
        f"{place}.{name}".lstrip(".")
        for place, part in parts(Result)
        for name, hint in _hints(part).items()
        if name not in meanings(part) and not list(_objects(hint))
    ]


def fill(document: str) -> str:
    """Return a document with its marked place filled from the code."""
    return filled(document, {"keys": tables()})


def _hints(part: type[Any]) -> dict[str, Any]:
    names = getattr(part, "__struct_fields__", None) or [field.name for field in dataclasses.fields(part)]
    hints = typing.get_type_hints(part)
    return {name: hints[name] for name in names}


def _objects(hint: Any) -> Iterator[tuple[type[Any], bool]]:  # noqa: ANN401
    """Return the objects in a type, and whether they stand in a list."""
    if isinstance(hint, type) and (issubclass(hint, msgspec.Struct) or dataclasses.is_dataclass(hint)):
        yield hint, False
    for inner in typing.get_args(hint):
        for found, in_list in _objects(inner):
            yield found, in_list or typing.get_origin(hint) is tuple


def _type_name(hint: Any) -> str:  # noqa: ANN401
    if hint is msgspec.UnsetType:
        return "absent"
    if hint in NAMES:
        return NAMES[hint]
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) in {typing.Union, types.UnionType}:
        return " or ".join(dict.fromkeys(map(_type_name, arguments)))
    if typing.get_origin(hint) is tuple:
        if arguments[-1] is Ellipsis:
            return f"list of {_type_name(arguments[0])}"
        return f"list of {len(arguments)} × {_type_name(arguments[0])}"
    if typing.get_origin(hint) is dict:
        return "object"
    return "object"


def _first_line(part: type[Any]) -> str:
    return (part.__doc__ or "").strip().partition("\n")[0].replace("``", "`").replace("None", "null")


def _anchor(place: str) -> str:
    return "".join(character for character in place if character.isalnum() or character in "_-")


if __name__ == "__main__":
    PAGE.write_text(fill(PAGE.read_text()))
