"""The cards that belong to a recording: from files, and from what the object reports about itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import msgspec

from firmware_protocol.packets import Info
from host.cards.definitions import SIZE_KEYS, Cards, Dimensions, ObjectCard, ObjectType, Weight, load_cards, merged
from host.cards.tables import value_text
from host.errors import FileError
from host.text import plain

CARD_FILES = ("cards.toml", "object.toml", "hand.toml", "trial.toml")
"""Files looked for beside a recording and in the folder above, after ``<name of the recording>.toml``."""

TOLERANCE = 0.05
"""Differences up to this, g or mm, are rounding: the object sends float32."""


def find_cards(recording: Path, given: Sequence[Path] = (), defaults: Sequence[Path] = ()) -> Cards:
    """Return the cards of a recording.

    The order is: the files given, which must exist; ``<stem>.toml`` beside the recording; :data:`CARD_FILES` beside it;
    the same in the folder above; the ``defaults``, which must exist. Each field comes from the first file that has it.

    Raises
    ------
    FileError
        A card is wrong; the message names the file and the field.
    """
    folders = (recording.parent, recording.parent.parent) if recording.parent.name else (recording.parent,)
    candidates = [*given, recording.with_suffix(".toml")]
    candidates += [folder / name for folder in folders for name in CARD_FILES]
    candidates += defaults
    cards = Cards()
    for path in candidates:
        if path.is_file():
            cards = merged(cards, load_cards(path))
        elif path in given or path in defaults:
            raise FileError(f"there is no card {path}", "check the path, or make one with `rotdrift init`")
    return cards


def card_of_object(info: Info) -> ObjectCard:
    """Return what the object reports about itself (INFO) as a card; what it does not know is left out."""
    sent = info.card
    kind = ObjectType.__members__.get(sent.shape.name)
    keys = () if kind is None else SIZE_KEYS[kind]
    size = dict(zip(keys, map(_round, sent.size_mm), strict=False))
    known_mass = _known(sent.mass_g)
    return ObjectCard(
        type=kind,
        dimensions=Dimensions(**size) if size and _known(*sent.size_mm[: len(keys)]) else None,
        surface=plain(sent.surface) or None,
        mass_g=_round(sent.mass_g) if known_mass else None,
        com_mm=(_round(sent.com_mm[0]), _round(sent.com_mm[1]), _round(sent.com_mm[2]))
        if all(map(math.isfinite, sent.com_mm))
        else None,
        weights=tuple(Weight(weight.slot, _round(weight.mass_g)) for weight in sent.weights) if known_mass else None,
        mounting_q_body_sensor=_mounting(sent.mounting_q_body_sensor),
        id=f"{info.device_id:016x}",
        name=plain(info.name) or None,
    )


def with_object(cards: Cards, info: Info | None) -> tuple[Cards, tuple[str, ...]]:
    """Return cards completed by what the object reports, and notes on both.

    Where card and object differ the card counts, because a person measured it, and a note names the difference.
    """
    if info is None:
        return cards, ()
    reported = card_of_object(info)
    notes, filled = [], []
    for name in ObjectCard.__struct_fields__:
        from_card, from_object = getattr(cards.object, name), getattr(reported, name)
        if from_object is None:
            continue
        if from_card is None:
            filled.append(name)
        elif not _agree(name, from_card, from_object):
            notes.append(
                f"object.{name}: the card says {_shown(from_card)}, the object says {_shown(from_object)}; "
                "the card is reported"
            )
    if filled:
        notes.append(f"told by the object itself: {', '.join('object.' + name for name in filled)}")
    return merged(cards, Cards(reported)), tuple(notes)


def _agree(name: str, one: object, other: object) -> bool:
    """Return whether two values of a field are the same but for rounding."""
    if isinstance(one, str) and isinstance(other, str):
        return one.strip().lower() == other.strip().lower()
    first, second = _numbers(one), _numbers(other)
    if first.keys() != second.keys() or not first:
        return one == other
    if name == "mounting_q_body_sensor":
        return abs(sum(first[key] * second[key] for key in first)) > 1.0 - 1e-6  # q and -q are the same
    return all(abs(first[key] - second[key]) <= TOLERANCE for key in first)


def _numbers(value: object) -> dict[object, float]:
    """Return the numbers of a value by what they belong to; empty for a value without."""
    if isinstance(value, Dimensions):
        return {key: size for key, size in msgspec.structs.asdict(value).items() if size is not None}
    if isinstance(value, tuple):
        return dict((part.slot, part.mass_g) if isinstance(part, Weight) else (i, part) for i, part in enumerate(value))
    return {"": float(value)} if isinstance(value, float | int) else {}


def _mounting(q_wxyz: tuple[float, float, float, float]) -> tuple[float, float, float, float] | None:
    """Return the mounting as sent; None for the identity, which objects also send when they do not know it."""
    if not all(map(math.isfinite, q_wxyz)) or abs(math.hypot(*q_wxyz) - 1.0) > 1e-2 or abs(q_wxyz[0]) > 1.0 - 1e-9:
        return None
    w, x, y, z = (round(part, 7) for part in q_wxyz)
    return (w, x, y, z)


def _known(*values: float) -> bool:
    return all(math.isfinite(value) and value > 0 for value in values)


def _round(value: float) -> float:
    return round(float(value), 4)


def _shown(value: object) -> str:
    if isinstance(value, Dimensions):
        return ", ".join(f"{key} = {size:g}" for key, size in _numbers(value).items())
    return plain(value) if isinstance(value, str) else value_text(value)
