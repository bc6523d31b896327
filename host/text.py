"""Text from devices, files, options and libraries, made safe for terminals."""

from __future__ import annotations

import re
import unicodedata

MAX_TEXT = 200
"""Longer texts are cut: no name on a dashboard needs more."""
_DOUBTFUL = re.compile(r"[^ -~]+")
_BREAKS = re.compile(r"[\t\n\r]")


def printable(text: str, keep: str = "") -> str:
    """Return a text without what a terminal would act on in place of showing it.

    Control characters (C0, DEL, C1), format characters (bidirectional overrides, zero-width joiners, tags), lone
    surrogates of file names, private and unassigned characters, and line separators are removed, so that no escape
    sequence survives and nothing is reordered.

    Parameters
    ----------
    text : str
        Any text.
    keep : str, optional
        Control characters that are meant, such as line ends.
    """
    if text.isprintable():  # in C, and nearly every text is
        return text
    return _DOUBTFUL.sub(lambda run: "".join(c for c in run[0] if c in keep or _is_shown(c)), text)


def _is_shown(character: str) -> bool:
    # What ``isprintable`` refuses beside the kinds above are the other blanks, such as the no-break space.
    return character.isprintable() or unicodedata.category(character) == "Zs"


def one_line(text: object) -> str:
    """Return a text printable and on one line: foreign line ends must not make lines that look like ours."""
    return printable(_BREAKS.sub(" ", str(text)))


def plain(text: object, limit: int = MAX_TEXT) -> str:
    """Return a text of unknown origin harmless to print: printable, bounded, on one line, without double blanks.

    The result may still hold rich markup: show it through :class:`rich.text.Text`, never as a markup string.

    Parameters
    ----------
    text : object
        Anything that ``str()`` turns into text.
    limit : int, optional
        Longest result in characters; a longer one ends in ``…``.
    """
    kept = " ".join(one_line(str(text)[: 4 * limit]).split())
    return kept if len(kept) <= limit else kept[: limit - 1] + "…"


def printable_json(text: str) -> str:
    r"""Return a JSON text with the same values, in which what a terminal would act on is escaped as ``\uXXXX``."""
    if text.isprintable():
        return text
    return _DOUBTFUL.sub(lambda run: "".join(c if c in "\n\t" or _is_shown(c) else _escaped(c) for c in run[0]), text)


def _escaped(character: str) -> str:
    """Return a character as JSON escapes it: beyond U+FFFF as two surrogates."""
    units = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[i]:02x}{units[i + 1]:02x}" for i in range(0, len(units), 2))
