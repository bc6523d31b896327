"""Text from devices and files, made safe for terminals."""

from __future__ import annotations

import unicodedata

MAX_TEXT = 200
"""Longer texts are cut: no name on a dashboard needs more."""


def plain(text: object, limit: int = MAX_TEXT) -> str:
    """Return a text of unknown origin harmless to print: no control characters, bounded, on one line.

    Control, format (bidirectional overrides), surrogate and private characters and line separators are removed, so
    that no escape sequence survives. The result may still hold rich markup: show it through
    :class:`rich.text.Text`, never as a markup string.

    Parameters
    ----------
    text : object
        Anything that ``str()`` turns into text.
    limit : int, optional
        Longest result in characters; a longer one ends in ``…``.
    """
    kept = "".join(
        " " if character in "\t\n\r" else character
        for character in str(text)[: 4 * limit]
        if character in "\t\n\r" or unicodedata.category(character) not in {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
    )
    kept = " ".join(kept.split())
    return kept if len(kept) <= limit else kept[: limit - 1] + "…"
