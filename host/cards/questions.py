"""Asking for the cards in the terminal, one field at a time."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from typing import Any

import msgspec
import tomli_w

from host.cards.definitions import (
    CHOICES,
    REQUIRED,
    SIZE_KEYS,
    TABLES,
    Cards,
    ObjectType,
    card_values,
    choices,
    parse_cards,
)
from host.errors import FileError

Ask = Callable[[str], str]
"""Shows a prompt, returns the line typed; raises EOFError at the end of the input."""
Say = Callable[[str], None]

INTRODUCTION = """\
Enter keeps what stands in [brackets] or leaves the field out; `-` takes a
value out; Ctrl-D ends without writing. Fields marked * are asked for by the
benchmark card. Leave out what you do not know: nothing is invented.
"""


def ask_for_cards(known: Cards, tables: tuple[str, ...], ask: Ask, say: Say) -> Cards:
    """Ask for every field of some cards, check each answer at once, and ask again where it is wrong.

    Parameters
    ----------
    known : Cards
        Defaults.
    tables : tuple of str
        Which of ``object``, ``hand``, ``trial``.
    ask, say : callable
        The terminal.

    Returns
    -------
    Cards
        The defaults with the answers.

    Raises
    ------
    EOFError
        The input ended.
    """
    values: dict[str, dict[str, Any]] = card_values(known)
    say(INTRODUCTION)
    for table in tables:
        say(f"[{table}]")
        for field in msgspec.structs.fields(TABLES[table]):
            if field.name == "type_note" and values.get(table, {}).get("type") != ObjectType.OTHER.value:
                continue
            if field.name == "dimensions":
                _ask_size(values, ask, say)
            elif field.name == "weights":
                _ask_field(values, table, field.name, "slot:grams, e.g. 1:20, 4:20 (none: empty object)", ask, say)
            else:
                what = _description(TABLES[table], field.name)
                place = f"{table}.{field.name}"
                _ask_field(
                    values, table, field.name, f"{what}: {choices(place)}" if place in CHOICES else what, ask, say
                )
    return _checked(values)


def _ask_size(values: dict[str, dict[str, Any]], ask: Ask, say: Say) -> None:
    kind = values.get("object", {}).get("type")
    if kind is None:
        say("  (the size is asked for once the type is known)")
        return
    keys = SIZE_KEYS[ObjectType(kind)]
    old = values["object"].get("dimensions", {})
    default = " ".join(f"{old[key]:g}" for key in keys if key in old) if set(old) == set(keys) else ""
    names = ", ".join(key.removesuffix("_mm") for key in keys)
    while True:
        answer = ask(_prompt("dimensions", f"{names}, mm", default, required=True)).strip()
        if not answer:
            if set(old) != set(keys):
                values["object"].pop("dimensions", None)  # they belong to another type
            return
        if answer == "-":
            values["object"].pop("dimensions", None)
            return
        numbers = _bare(answer, "mm").replace(",", " ")
        parts = re.sub(r"(?<=[\d. ])[x×*](?=[\d. ])", " ", numbers).split()  # 60x60 and 60 x 60
        try:
            if len(parts) != len(keys):
                raise ValueError(f"give {len(keys)} number{'s' if len(keys) > 1 else ''}: {names}")
            size = {key: _number(part) for key, part in zip(keys, parts, strict=True)}
            _try(values, "object", "dimensions", size)
        except (ValueError, FileError) as error:
            say(f"  {_why(error)}")
            continue
        return


def _ask_field(values: dict[str, dict[str, Any]], table: str, name: str, what: str, ask: Ask, say: Say) -> None:
    old = values.get(table, {}).get(name)
    while True:
        answer = ask(_prompt(name, what, _shown(old), required=f"{table}.{name}" in REQUIRED)).strip()
        if not answer:
            return
        if answer == "-":
            values.get(table, {}).pop(name, None)
            return
        try:
            _try(values, table, name, _parsed(name, answer))
        except (ValueError, FileError) as error:
            say(f"  {_why(error)}")
            continue
        return


def _try(values: dict[str, dict[str, Any]], table: str, name: str, value: object) -> None:
    """Set a field, or raise and leave everything as it was."""
    trial = {key: dict(fields) for key, fields in values.items()}
    trial.setdefault(table, {})[name] = value
    if name == "type":
        trial[table].pop("dimensions", None)  # checked together; kept where they still fit
        kept = values.get(table, {}).get("dimensions", {})
        if any(kind.value == value and set(kept) == set(keys) for kind, keys in SIZE_KEYS.items()):
            trial[table]["dimensions"] = kept
    _checked(trial)
    values.clear()
    values.update(trial)


def _parsed(name: str, answer: str) -> object:
    """Read an answer as the type of its field."""
    if name == "weights":
        return _weights(answer)
    if name in {"com_mm", "mounting_q_body_sensor"}:
        return [_number(part) for part in _bare(answer, "mm").replace(",", " ").strip("()[] ").split()]
    if name.endswith(("_g", "_mm", "_hz")):
        return _number(_bare(answer, name.rpartition("_")[2]))
    if name in {"fingers", "repeats"}:
        try:
            return int(answer)
        except ValueError as error:
            raise ValueError(f"{answer!r} is not a whole number") from error
    return answer


def _weights(answer: str) -> list[dict[str, float | int]]:
    if answer.lower() in {"none", "no", "0", "[]"}:
        return []
    weights: list[dict[str, float | int]] = []
    for part in answer.replace(";", ",").split(","):
        slot, colon, grams = part.partition(":")
        if not colon or not slot.strip().isdigit():
            raise ValueError(f"{part.strip()!r} is not slot:grams")
        weights.append({"slot": int(slot), "mass_g": _number(_bare(grams, "g"))})
    return weights


def _bare(text: str, unit: str) -> str:
    """Take off the unit that the question names, where it was typed all the same."""
    return re.sub(rf"(?<=[\d.)\] ]){unit}$", "", text.strip(), flags=re.IGNORECASE).strip()


def _number(text: str) -> float:
    try:
        return float(text.strip())
    except ValueError as error:
        raise ValueError(f"{text.strip()!r} is not a number") from error


def _checked(values: dict[str, dict[str, Any]]) -> Cards:
    return parse_cards(tomli_w.dumps(values), "this")


def _description(card: type[msgspec.Struct], name: str) -> str:
    schema = msgspec.json.schema(card)
    properties: dict[str, Any] = schema["$defs"][card.__name__]["properties"][name]
    return str(properties.get("description", name))


def _prompt(name: str, what: str, default: str, *, required: bool) -> str:
    return f"  {name}{'*' if required else ''} ({what}){f' [{default}]' if default else ''}: "


def _shown(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, list):
        if not value:
            return "none"
        if isinstance(value[0], dict):
            return ", ".join(f"{weight['slot']}:{weight['mass_g']:g}" for weight in value)
        return " ".join(f"{part:g}" for part in value)
    return str(value)


def _why(error: Exception) -> str:
    if isinstance(error, FileError):
        return error.message.removeprefix("this: ")
    return str(error)


def template() -> str:
    """Write a card file to fill in: every field, commented out, with what it means."""
    lines = [
        "# Cards for rotdrift. Take the # from what you know; leave the rest. `*`: asked for by the benchmark card."
    ]
    examples = tomllib.loads(_EXAMPLES)
    for table, card in TABLES.items():
        lines += ["", f"[{table}]"]
        for field in msgspec.structs.fields(card):
            star = " *" if f"{table}.{field.name}" in REQUIRED else ""
            lines.append(f"# {_description(card, field.name)}{star}")
            lines.append(f"#{field.name} = {_toml(examples[table][field.name])}")
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


_EXAMPLES = """\
[object]
type = "cube"
type_note = "hexagonal prism"
dimensions = { x_mm = 60.0, y_mm = 60.0, z_mm = 60.0 }
surface = "smooth"
material = "PLA"
mass_g = 180.0
mass_uncertainty_g = 0.5
com_mm = [0.0, 0.0, 2.5]
com_uncertainty_mm = 0.5
weights = [{ slot = 1, mass_g = 20.0 }]
mounting_q_body_sensor = [1.0, 0.0, 0.0, 0.0]
id = "0000000000000001"
name = "cube 1"
[hand]
model = "model of the hand"
maker = "who made it"
fingers = 2
actuation = "2 motors, tendons, underactuated"
aperture_mm = 90.0
aperture_measured = "calliper between the fingertips, fully open"
fingertip_material = "urethane rubber"
control_mode = "open loop, position"
control_rate_hz = 50.0
set_points = "both motors 0.3 rad, sine, 0.2 Hz"
software = "controller 1.0"
[trial]
motion = "roll"
axis = "object x"
protocol = "P19-0838.3"
repeats = 20
operator = "initials"
comments = "what the hand and its control have to do with the result"
"""
