"""Questions for the cards in the terminal, one field at a time."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgspec

from host.cards.definitions import (
    CHOICES,
    REQUIRED,
    SIZE_KEYS,
    TABLES,
    Cards,
    ObjectType,
    card_values,
    cards_from,
    choices,
)
from host.errors import FileError

Ask = Callable[[str], str]
"""Shows a prompt, returns the line typed; raises EOFError at the end of the input."""
Show = Callable[[str], None]
"""Prints one line."""
Values = dict[str, dict[str, Any]]
"""Table -> field -> value, as TOML has them."""

INTRODUCTION = """\
Enter keeps the value in [brackets], or leaves the field out; `-` removes a
value; Ctrl-D ends without writing. Fields marked * are asked for by the
benchmark card. Leave out what you do not know: nothing is invented.
"""


def ask_for_cards(known: Cards, tables: tuple[str, ...], ask: Ask, show: Show) -> Cards:
    """Return cards from questions about every field of ``tables``; what is ``known`` is the default.

    Each answer is checked at once, and asked for again if wrong.

    Raises
    ------
    EOFError
        The input ended.
    """
    questions = _Questions(card_values(known), ask, show)
    for line in INTRODUCTION.split("\n"):
        show(line)
    for table in tables:
        show(f"[{table}]")
        for field in msgspec.structs.fields(TABLES[table]):
            questions.ask_field(table, field.name)
    return cards_from(questions.values, "this")


@dataclass
class _Questions:
    """The answers so far, valid cards at any time, and the terminal that asks for more."""

    values: Values
    ask: Ask
    show: Show

    def ask_field(self, table: str, name: str) -> None:
        """Ask for one field, if the answers so far leave it open."""
        given = self.values.get(table, {})
        if name == "dimensions":
            self._ask_size()
        elif name == "weights":
            self._ask(
                table, name, "slot:grams, e.g. 1:20, 4:20 (none: empty object)", _shown(given.get(name)), _weights
            )
        elif name != "type_note" or given.get("type") == ObjectType.OTHER.value:
            place, what = f"{table}.{name}", _description(TABLES[table], name)
            what += f": {choices(place)}" if place in CHOICES else ""
            self._ask(table, name, what, _shown(given.get(name)), partial(_parsed, name))

    def _ask_size(self) -> None:
        given = self.values.get("object", {})
        if "type" not in given:
            self.show("  (the size is asked for once the type is known)")
            return
        keys = SIZE_KEYS[ObjectType(given["type"])]
        names = ", ".join(key.removesuffix("_mm") for key in keys)
        size = given.get("dimensions", {})  # of this type: `_set` drops any other
        default = " ".join(f"{size[key]:g}" for key in keys if key in size)
        self._ask("object", "dimensions", f"{names}, mm", default, partial(_size, keys, names))

    def _ask(self, table: str, name: str, what: str, default: str, parse: Callable[[str], object]) -> None:
        """Ask until the answer is valid, empty (keep the default) or ``-`` (remove it)."""
        star = "*" * (f"{table}.{name}" in REQUIRED)
        prompt = f"  {name}{star} ({what}){f' [{default}]' if default else ''}: "
        while answer := self.ask(prompt).strip():
            if answer == "-":
                self.values.get(table, {}).pop(name, None)
                return
            try:
                self._set(table, name, parse(answer))
            except ValueError as error:
                self.show(f"  {error}")
            except FileError as error:
                self.show(f"  {error.message.removeprefix('this: ')}")
            else:
                return

    def _set(self, table: str, name: str, value: object) -> None:
        """Set a field, or raise and leave everything as it was."""
        changed = {key: dict(fields) for key, fields in self.values.items()}
        fields = changed.setdefault(table, {})
        fields[name] = value
        if name == "type" and not any(
            kind.value == value and set(fields.get("dimensions", ())) == set(keys) for kind, keys in SIZE_KEYS.items()
        ):
            fields.pop("dimensions", None)  # they describe another type
        cards_from(changed, "this")
        self.values = changed


def _size(keys: tuple[str, ...], names: str, answer: str) -> dict[str, float]:
    numbers = _bare(answer, "mm").replace(",", " ")
    parts = re.sub(r"(?<=[\d. ])[x×*](?=[\d. ])", " ", numbers).split()  # 60x60 and 60 x 60
    if len(parts) != len(keys):
        raise ValueError(f"give {len(keys)} number{'s' * (len(keys) > 1)}: {names}")
    return {key: _number(part) for key, part in zip(keys, parts, strict=True)}


def _parsed(name: str, answer: str) -> object:
    """Return an answer as a value of its field's type."""
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
    """Return a text without the unit that the question names already."""
    return re.sub(rf"(?<=[\d.)\] ]){unit}$", "", text.strip(), flags=re.IGNORECASE).strip()


def _number(text: str) -> float:
    try:
        return float(text.strip())
    except ValueError as error:
        raise ValueError(f"{text.strip()!r} is not a number") from error


def _description(card: type[msgspec.Struct], name: str) -> str:
    schema = msgspec.json.schema(card)
    properties: dict[str, Any] = schema["$defs"][card.__name__]["properties"][name]
    return str(properties.get("description", name))


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


def template() -> str:
    """Return a card file to fill in: every field, commented out, with its meaning."""
    lines = [
        "# Cards for rotdrift. Take the # from what you know; leave the rest. `*`: asked for by the benchmark card."
    ]
    table = ""
    for line in _EXAMPLES.splitlines():
        if line.startswith("["):
            table = line.strip("[]")
            lines += ["", line]
            continue
        name = line.partition(" = ")[0]
        star = " *" if f"{table}.{name}" in REQUIRED else ""
        lines += [f"# {_description(TABLES[table], name)}{star}", f"#{line}"]
    return "\n".join(lines) + "\n"


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
