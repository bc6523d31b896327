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
_ASCII_GLYPHS = {
    "0": (" _ ", "| |", "|_|"),
    "1": ("   ", "  |", "  |"),
    "2": (" _ ", " _|", "|_ "),
    "3": (" _ ", " _|", " _|"),
    "4": ("   ", "|_|", "  |"),
    "5": (" _ ", "|_ ", " _|"),
    "6": (" _ ", "|_ ", "|_|"),
    "7": (" _ ", "  |", "  |"),
    "8": (" _ ", "|_|", "|_|"),
    "9": (" _ ", "|_|", " _|"),
    ".": (" ", " ", "."),
    "-": ("   ", " _ ", "   "),
    "°": ("deg", "   ", "   "),
    " ": (" ", " ", " "),
}


def big_text(text: str, ascii_only: bool = False) -> tuple[str, str, str]:
    """Write figures in block characters.

    Parameters
    ----------
    text : str
        Digits, point, minus, degree sign and space.
    ascii_only : bool
        Draw with lines of ASCII in place of blocks.

    Returns
    -------
    tuple of str
        Three lines of equal length.

    Raises
    ------
    ValueError
        There is no figure for a character.
    """
    glyphs = _ASCII_GLYPHS if ascii_only else _GLYPHS
    unknown = sorted(set(text) - set(glyphs))
    if unknown:
        raise ValueError(f"no large figure for {''.join(unknown)!r}")
    top, middle, bottom = (" ".join(glyphs[character][line] for character in text) for line in range(3))
    return top, middle, bottom
