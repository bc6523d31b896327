"""Figures three lines high, to be read from a distance."""

from __future__ import annotations

_GLYPHS = {
    "0": ("█▀█", "█ █", "█▄█"),
    "1": (" ▀█", "  █", " ▄█"),
    "2": ("▀▀█", "█▀▀", "█▄▄"),
    "3": ("▀▀█", " ▀█", "▄▄█"),
    "4": ("█ █", "▀▀█", "  █"),
    "5": ("█▀▀", "▀▀█", "▄▄█"),
    "6": ("█▀▀", "█▀█", "█▄█"),
    "7": ("▀▀█", "  █", "  █"),
    "8": ("█▀█", "█▀█", "█▄█"),
    "9": ("█▀█", "▀▀█", "▄▄█"),
    ".": (" ", " ", "▄"),
    "-": ("   ", "▀▀▀", "   "),
    "°": ("▄▄", "▀▀", "  "),
    " ": (" ", " ", " "),
}


def big_text(text: str) -> tuple[str, str, str]:
    """Write figures in block characters.

    Parameters
    ----------
    text : str
        Digits, point, minus, degree sign and space.

    Returns
    -------
    tuple of str
        Three lines of equal length.

    Raises
    ------
    ValueError
        There is no figure for a character.
    """
    unknown = sorted(set(text) - set(_GLYPHS))
    if unknown:
        raise ValueError(f"no large figure for {''.join(unknown)!r}")
    top, middle, bottom = (" ".join(_GLYPHS[character][line] for character in text) for line in range(3))
    return top, middle, bottom
