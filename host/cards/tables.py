"""Cards as the report shows them: labels, values with units, and short names for tables."""

from __future__ import annotations

from enum import Enum

import msgspec

from analysis.reporting.trial_report import CardRow, CardTable
from host.cards.definitions import REQUIRED, TABLES, Cards, Dimensions, ObjectType, Weight

_UNITS = {"mm": "mm", "g": "g", "hz": "Hz"}
_LABELS = {
    "com": "centre of mass (x, y, z)",
    "com_uncertainty": "uncertainty of the centre of mass",
    "mass_uncertainty": "uncertainty of the mass",
    "mounting_q_body_sensor": "mounting, q body←sensor (w, x, y, z)",
    "weights": "internal weights",
    "repeats": "cycles asked for",
}


def card_tables(cards: Cards) -> tuple[CardTable, ...]:
    """Return the three cards as tables of all fields, also those not given."""
    tables = []
    for table, card in TABLES.items():
        values = getattr(cards, table)
        rows = []
        for field in msgspec.structs.fields(card):
            if field.name == "comments" or (field.name == "type_note" and values.type is not ObjectType.OTHER):
                continue
            label, unit = _label(field.name)
            text = value_text(getattr(values, field.name), unit)
            rows.append(CardRow(label, text, f"{table}.{field.name}" in REQUIRED))
        tables.append(CardTable(table.capitalize(), tuple(rows)))
    return tuple(tables)


def object_name(cards: Cards) -> str:
    """Return the name of the object by type and size: ``cube 60 × 60 × 60 mm``."""
    card = cards.object
    if card.type is None:
        return card.name or "unknown object"
    kind = card.type_note or card.type.value if card.type is ObjectType.OTHER else card.type.value
    return f"{kind} {_size(card.dimensions)}".strip()


def hand_name(cards: Cards) -> str:
    """Return the name of the hand, its model."""
    return cards.hand.model or "unknown hand"


def motion_name(cards: Cards) -> str:
    """Return the name of the manipulation motion."""
    return cards.trial.motion or "unknown motion"


def _label(name: str) -> tuple[str, str]:
    stem, _, ending = name.rpartition("_")
    unit = _UNITS.get(ending, "")
    quantity = stem if unit else name
    return _LABELS.get(quantity, quantity.replace("_", " ")), unit


def value_text(value: object, unit: str = "") -> str:
    """Return the value of a card's field as a person reads it; empty where it is not known."""
    if value is None:
        return ""
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, Dimensions):
        return _size(value)
    if isinstance(value, tuple):
        if not value:
            return "none"
        if isinstance(value[0], Weight):
            return ", ".join(f"slot {weight.slot}: {weight.mass_g:g} g" for weight in value)
        return f"({', '.join(f'{part:g}' for part in value)}) {unit}".strip()
    return f"{value:g} {unit}".strip() if isinstance(value, float) else f"{value} {unit}".strip()


def _size(size: Dimensions | None) -> str:
    if size is None:
        return ""
    if size.diameter_mm is not None:
        length = "" if size.length_mm is None else f" × {size.length_mm:g}"
        return f"⌀ {size.diameter_mm:g}{length} mm"
    edges = [edge for edge in (size.x_mm, size.y_mm, size.z_mm) if edge is not None]
    return " × ".join(f"{edge:g}" for edge in edges) + " mm" if edges else ""
