"""What distinguishes trials by name: objects of the same type and size, or the same hand under other control, are two.

The summary pools trials of one hand, object and motion. So wherever cards differ in what the benchmark card asks for,
the names must differ too: ``cube 60 × 60 × 60 mm (rough)`` beside ``cube 60 × 60 × 60 mm (smooth)``.
"""

from __future__ import annotations

from collections.abc import Sequence

from host.cards.definitions import Cards
from host.cards.tables import card_tables, hand_name, motion_name, object_name

OBJECT_LABELS = ("name", "surface", "material", "mass", "centre of mass (x, y, z)", "internal weights")
HAND_LABELS = (
    "maker", "fingers", "actuation", "aperture", "fingertip material", "control mode", "control rate", "set points",
    "software",
)  # fmt: skip
MOTION_LABELS = ("axis", "protocol")
MAX_LABEL = 60
"""Longest text that is put beside a name."""


def trial_labels(cards: Sequence[Cards], files: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return hand, object and motion of every trial, so that only repeats have all three in common.

    The cards are those filled from the object's own. ``files`` are the names of the recordings, without their ending:
    recordings of which no motion is known are not repeats.
    """
    rows = [
        {table.title: {row.label: row.value for row in table.rows} for table in card_tables(card)} for card in cards
    ]
    everywhere = [""] * len(cards)
    objects = _apart([object_name(card) for card in cards], everywhere, [row["Object"] for row in rows], OBJECT_LABELS)
    motions = [
        motion_name(card) if card.trial.motion else f"{motion_name(card)} ({file})"
        for card, file in zip(cards, files, strict=True)
    ]
    names = [hand_name(card) for card in cards]
    # A hand may well have other set points for another motion: only what would be pooled is distinguished.
    pooled = [f"{thing}\0{motion}" for thing, motion in zip(objects, motions, strict=True)]
    hands = _apart(names, pooled, [row["Hand"] for row in rows], HAND_LABELS)
    pooled = [f"{thing}\0{hand}" for thing, hand in zip(objects, hands, strict=True)]
    motions = _apart(motions, pooled, [row["Trial"] for row in rows], MOTION_LABELS)
    return list(zip(hands, objects, motions, strict=True))


def _apart(
    names: Sequence[str], within: Sequence[str], values: Sequence[dict[str, str]], labels: Sequence[str]
) -> list[str]:
    """Return the names, equal ones within one group with the values in which they differ."""
    found = []
    for name, group, own in zip(names, within, values, strict=True):
        twins = [v for n, g, v in zip(names, within, values, strict=True) if (n, g) == (name, group)]
        differing = [label for label in labels if len({twin.get(label, "") for twin in twins}) > 1]
        apart = [text for label in differing if (text := own.get(label) or f"{label} not given") != name]
        found.append(f"{name} ({', '.join(text[:MAX_LABEL] for text in apart)})" if apart else name)
    return found
