"""Object, hand and trial cards: what the benchmark asks for beside the score, as TOML.

A card file holds any of the tables ``[object]``, ``[hand]`` and ``[trial]``. An unknown field is left out; it is never
invented. :data:`REQUIRED` lists the fields that a submission needs, each with the bullet of the benchmark card
("Results to Submit") that asks for it. The types below are also published as a JSON Schema
(``docs/cards.schema.json``), with which editors complete and check a card while it is typed.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from enum import Enum
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import tomli_w
from msgspec import Meta

from host.errors import FileError, unreadable
from host.text import plain

MAX_CARD_BYTES = 1_000_000
"""A larger file is not a card."""
MAX_COMMENT = 4000

Text = Annotated[str, Meta(max_length=200)]
Comment = Annotated[str, Meta(max_length=MAX_COMMENT)]
Length = Annotated[float, Meta(gt=0, le=10_000)]
Coordinate = Annotated[float, Meta(ge=-10_000, le=10_000)]
Mass = Annotated[float, Meta(gt=0, le=100_000)]
Spread = Annotated[float, Meta(ge=0, le=100_000)]
Count = Annotated[int, Meta(ge=1, le=100_000)]
Rate = Annotated[float, Meta(gt=0, le=1_000_000)]
Share = Annotated[float, Meta(ge=-1.0001, le=1.0001)]


_Card = TypeVar("_Card", bound=msgspec.Struct)


class ObjectType(Enum):
    """Shapes the benchmark knows."""

    CUBE = "cube"
    CYLINDER = "cylinder"
    SPHERE = "sphere"
    OTHER = "other"


class Protocol(Enum):
    """Manipulation protocols the benchmark card adopts; all start with RAL-SI-2020 and end with V1.0."""

    P2 = "P19-0838.2"
    P3 = "P19-0838.3"
    P4 = "P19-0838.4"


class Weight(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One weight inside the object."""

    slot: Annotated[int, Meta(ge=0, le=255, description="slot number as printed in the object")]
    mass_g: Annotated[float, Meta(ge=0, le=655.35, description="mass, g")]


class Dimensions(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Size in mm. Cube and other: x, y, z. Cylinder: diameter, length. Sphere: diameter."""

    x_mm: Length | None = None
    y_mm: Length | None = None
    z_mm: Length | None = None
    diameter_mm: Length | None = None
    length_mm: Length | None = None


class ObjectCard(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The sensorized object."""

    type: Annotated[ObjectType | None, Meta(description="shape of the object")] = None
    type_note: Annotated[Text | None, Meta(description="what it is, where the type is 'other'")] = None
    dimensions: Annotated[Dimensions | None, Meta(description="size, mm")] = None
    surface: Annotated[Text | None, Meta(description="surface, e.g. 'smooth, layer height 0.2 mm'")] = None
    material: Annotated[Text | None, Meta(description="material, e.g. PLA")] = None
    mass_g: Annotated[Mass | None, Meta(description="total mass with weights, g")] = None
    mass_uncertainty_g: Annotated[Spread | None, Meta(description="uncertainty of the mass, ± g")] = None
    com_mm: Annotated[
        tuple[Coordinate, Coordinate, Coordinate] | None,
        Meta(description="centre of mass from the geometric centre, object frame, mm"),
    ] = None
    com_uncertainty_mm: Annotated[Spread | None, Meta(description="uncertainty of the centre of mass, ± mm")] = None
    weights: Annotated[
        Annotated[tuple[Weight, ...], Meta(max_length=64)] | None,
        Meta(description="internal weights; an empty list means: none"),
    ] = None
    mounting_q_body_sensor: Annotated[
        tuple[Share, Share, Share, Share] | None,
        Meta(description="unit quaternion w, x, y, z from sensor to object coordinates"),
    ] = None
    id: Annotated[Text | None, Meta(description="id of this object")] = None
    name: Annotated[Text | None, Meta(description="name of this object")] = None


class HandCard(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The hand under test."""

    model: Annotated[Text | None, Meta(description="hand model")] = None
    maker: Annotated[Text | None, Meta(description="who makes or made it")] = None
    fingers: Annotated[Count | None, Meta(description="number of fingers")] = None
    actuation: Annotated[Text | None, Meta(description="actuation, e.g. '2 motors, tendons, underactuated'")] = None
    aperture_mm: Annotated[Length | None, Meta(description="aperture, mm")] = None
    aperture_measured: Annotated[Text | None, Meta(description="how the aperture was measured")] = None
    fingertip_material: Annotated[Text | None, Meta(description="material of the fingertips")] = None
    control_mode: Annotated[Text | None, Meta(description="control, e.g. 'open loop, position'")] = None
    control_rate_hz: Annotated[Rate | None, Meta(description="control rate, Hz")] = None
    set_points: Annotated[Text | None, Meta(description="set points or trajectory of the motion")] = None
    software: Annotated[Text | None, Meta(description="controller software and version")] = None


class TrialCard(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One manipulation motion with one object in one hand."""

    motion: Annotated[Text | None, Meta(description="manipulation motion, e.g. 'roll'")] = None
    axis: Annotated[Text | None, Meta(description="axis the motion turns about, e.g. 'object x'")] = None
    protocol: Annotated[Protocol | None, Meta(description="protocol reference")] = None
    repeats: Annotated[Count | None, Meta(description="cycles asked for")] = None
    operator: Annotated[Text | None, Meta(description="who ran the trial")] = None
    comments: Annotated[Comment | None, Meta(description="comments on the result: hand model, control")] = None


class Cards(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of one card file, or of several together."""

    object: ObjectCard = ObjectCard()
    hand: HandCard = HandCard()
    trial: TrialCard = TrialCard()


TABLES: dict[str, type[msgspec.Struct]] = {"object": ObjectCard, "hand": HandCard, "trial": TrialCard}

REQUIRED: dict[str, str] = {
    "object.type": "object type, size and surface",
    "object.dimensions": "object type, size and surface",
    "object.surface": "object type, size and surface",
    "object.mass_g": "object mass and center of mass (internal weight configuration)",
    "object.com_mm": "object mass and center of mass (internal weight configuration)",
    "object.weights": "object mass and center of mass (internal weight configuration)",
    "hand.model": "hand model, aperture and control details",
    "hand.aperture_mm": "hand model, aperture and control details",
    "hand.control_mode": "hand model, aperture and control details",
    "trial.motion": "for each sensorized object and manipulation motion",
    "trial.comments": "comments on obtained results with respect to the hand model and control",
}
"""Field -> the bullet of the benchmark card that asks for it. Without one of these a submission is incomplete."""

CHOICES: dict[str, type[Enum]] = {"object.type": ObjectType, "trial.protocol": Protocol}
"""Field -> its possible values."""

SIZE_KEYS = {
    ObjectType.CUBE: ("x_mm", "y_mm", "z_mm"),
    ObjectType.CYLINDER: ("diameter_mm", "length_mm"),
    ObjectType.SPHERE: ("diameter_mm",),
    ObjectType.OTHER: ("x_mm", "y_mm", "z_mm"),
}
"""Type -> the dimensions that describe it."""


def choices(field: str) -> str:
    """Return the possible values of a field of :data:`CHOICES`, as a list to read."""
    return ", ".join(str(kind.value) for kind in CHOICES[field])


def parse_cards(text: str, name: str = "the card") -> Cards:
    """Return the cards in a TOML text, checked; errors name the card by ``name``.

    Raises
    ------
    FileError
        Not TOML, or :func:`cards_from` refuses its values.
    """
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FileError(f"{name} is not TOML ({plain(error)})", "see docs/cards.md for an example") from error
    values.pop("$schema", None)  # the first line, where editors look for it
    return cards_from(values, name)


def cards_from(values: Mapping[str, Any], name: str) -> Cards:
    """Return the cards that plain values (table -> field -> value) describe, checked.

    Raises
    ------
    FileError
        An unknown or wrong field, or values that contradict each other; the message names the field.
    """
    try:
        cards = msgspec.convert(_cleaned(values), type=Cards)
    except msgspec.ValidationError as error:
        problem = _sentence(error)
    except RecursionError:
        problem = "nested too deeply"
    else:
        problem = _contradiction(cards.object)
        if not problem:
            return cards
    raise FileError(f"{name}: {problem}", "see docs/cards.md for every field")


def load_cards(path: Path) -> Cards:
    """Return the cards in a file.

    Raises
    ------
    FileError
        It cannot be read, or :func:`parse_cards` refuses it.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_CARD_BYTES + 1)
    except OSError as error:
        raise unreadable(path, error) from error
    if len(data) > MAX_CARD_BYTES:
        raise FileError(f"the card {path} is larger than {MAX_CARD_BYTES} bytes", "give a TOML card")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"the card {path} is not UTF-8 text", "save it as UTF-8") from error
    return parse_cards(text, f"the card {path}")


def card_values(cards: Cards) -> dict[str, dict[str, Any]]:
    """Return cards as plain values (for JSON or TOML): only what is set, in the order of the types."""
    return {table: values for table, values in _known(msgspec.to_builtins(cards)).items() if values}


def dump_cards(cards: Cards) -> str:
    """Return cards as TOML; :func:`parse_cards` reads the same cards from it."""
    return tomli_w.dumps(card_values(cards), multiline_strings=False)


def merged(first: Cards, second: Cards) -> Cards:
    """Return ``first``, with what it leaves out from ``second``."""
    return Cards(
        _filled(first.object, second.object), _filled(first.hand, second.hand), _filled(first.trial, second.trial)
    )


def _filled(first: _Card, second: _Card) -> _Card:
    return msgspec.structs.replace(
        second, **{name: value for name, value in msgspec.structs.asdict(first).items() if value is not None}
    )


def missing_fields(cards: Cards) -> tuple[str, ...]:
    """Return the required fields that are not set (``object.mass_g``), in the order of :data:`REQUIRED`."""
    return tuple(field for field in REQUIRED if attrgetter(field)(cards) in (None, ""))


def _contradiction(card: ObjectCard) -> str:
    """Return what cannot be true: sizes that do not describe the type, weights heavier than the object, ..."""
    if card.dimensions is not None and card.type is not None:
        given, wanted = sorted(_known(msgspec.structs.asdict(card.dimensions))), sorted(SIZE_KEYS[card.type])
        if given != wanted:
            is_not = ", ".join(given) or "nothing"
            return f"the dimensions of a {card.type.value} are {', '.join(wanted)}, not {is_not}"
    norm = math.hypot(*(card.mounting_q_body_sensor or (1.0,)))
    if abs(norm - 1.0) > 1e-2:
        return f"object.mounting_q_body_sensor has norm {norm:.4f}, not 1"
    weights = card.weights or ()
    if len({weight.slot for weight in weights}) < len(weights):
        return "two of object.weights are in the same slot"
    total = sum(weight.mass_g for weight in weights)
    if card.mass_g is not None and total > card.mass_g:
        return f"object.weights are {total:g} g together, more than object.mass_g = {card.mass_g:g} g"
    return ""


def cards_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a card file."""
    schema = msgspec.json.schema(Cards)
    reference = schema.pop("$ref").rsplit("/", 1)[1]
    body = schema["$defs"].pop(reference)
    body["properties"]["$schema"] = {"type": "string"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **body,
        "title": "rotdrift cards",
        "description": "Object, hand and trial cards of a Rotation Drift Benchmark submission.",
        "$defs": schema["$defs"],
    }


def _cleaned(value: Any) -> Any:  # noqa: ANN401 - whatever TOML holds
    """Return values with no control characters in any text; lines of a comment stay lines."""
    if isinstance(value, str):
        return "\n".join(plain(line, 10 * MAX_COMMENT) for line in value.split("\n"))
    if isinstance(value, Mapping):
        return {key: _cleaned(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_cleaned(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)  # "Expected float, got str": NaN and infinity are no measurements
    return value


def _known(values: dict[str, Any]) -> dict[str, Any]:
    return {
        name: _known(value) if isinstance(value, dict) else value for name, value in values.items() if value is not None
    }


def _sentence(error: msgspec.ValidationError) -> str:
    """Return ``Expected `float`, got `str` - at `$.object.mass_g``` with the field first and no back-ticks."""
    what, _, where = plain(error).replace("`", "").partition(" - at ")
    what = what.replace(" | null", "")
    what = (what[:1].lower() + what[1:]).replace("expected float", "expected a number")
    field = where.removeprefix("$.")
    if field in CHOICES and what.startswith("invalid enum value "):
        return f"{field}: {what.removeprefix('invalid enum value ')} is not one of {choices(field)}"
    return f"{field}: {what}" if where.removeprefix("$") else what
