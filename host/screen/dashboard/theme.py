"""How the dashboard is shown: colours for dark and light terminals, characters for those of only ASCII, what is open.

Colour is never the only carrier of a meaning: what is doubtful or bad is also a word or a sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from rich.style import Style
from rich.text import Text

_DARK = {
    "plain": "",
    "strong": "bold",
    "accent": "cyan",
    "number": "bold cyan",
    "good": "green",
    "doubtful": "yellow",
    "bad": "bold red",
    "quiet": "dim",
    "frame": "grey50",
    "x": "red",
    "y": "green",
    "z": "bright_blue",
}
_LIGHT = _DARK | {
    "accent": "blue",
    "number": "bold blue",
    "good": "dark_green",
    "doubtful": "dark_orange3",
    "quiet": "grey37",
    "frame": "grey58",
    "z": "blue",
}
_ASCII = str.maketrans("·−━─│×✓", "|-=-|x+") | str.maketrans(
    {"θ": "theta", "\u0304": "", "°": "deg", "…": "...", "±": "+-", "≤": "<=", "≥": ">=", "→": "->"}
)
"""Characters of texts -> those of ASCII; U+0304 is the bar over θ."""

Part = str | tuple[str, str]
"""A text, or a text and its meaning."""


def counted(n: int, what: str) -> str:
    """Return so many of something: ``1 cycle``, ``2 cycles``."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


@dataclass(frozen=True)
class Theme:
    """Colours and characters.

    Texts go through :meth:`text`, which is where ASCII terminals get their own words; nothing is ever read as markup.
    """

    ascii_only: bool = False
    light: bool = False
    color: str | None = "standard"
    """Colours of the terminal as rich names them: ``standard``, ``256``, ``truecolor``; None without any."""

    @cached_property
    def styles(self) -> Mapping[str, Style]:
        """Meaning -> rich style."""
        return {name: Style.parse(style) for name, style in (_LIGHT if self.light else _DARK).items()}

    def words(self, text: str) -> str:
        """Write a text in the characters the terminal has."""
        if not self.ascii_only or text.isascii():
            return text
        return text.translate(_ASCII).encode("ascii", "replace").decode()

    def vector(self, parts: Sequence[float], places: int) -> str:
        """Write the parts of a vector with their signs; what rounds to nothing is +0."""
        return " ".join(f"{round(part, places) + 0.0:+.{places}f}" for part in parts)

    def text(self, text: str, meaning: str = "plain") -> Text:
        """Make a text of one meaning."""
        return Text(self.words(text), style=self.styles[meaning], no_wrap=True, end="")

    def join(self, *parts: Part) -> Text:
        """Put texts together; each is plain or (text, meaning)."""
        line = Text(no_wrap=True, end="")
        for part in parts:
            text, meaning = (part, "plain") if isinstance(part, str) else part
            line.append(self.words(text), self.styles[meaning])
        return line

    def listed(self, parts: Sequence[Part], width: int | None = None, between: str = " · ") -> Text:
        """Put texts in a row with a dot, or what is ``between``, between them; empty ones are left out.

        With a ``width`` in cells, parts that do not fit are left out, later ones that do are not: the most important
        come first, and the first is always there.
        """
        line = Text(no_wrap=True, end="")
        for part in parts:
            if not (part if isinstance(part, str) else part[0]):
                continue
            piece = self.join((between, "quiet"), part) if line else self.join(part)
            if not line or width is None or line.cell_len + piece.cell_len <= width:
                line.append_text(piece)
        return line


@dataclass(frozen=True, slots=True)
class View:
    """What a person at the terminal does with the picture: never part of the trial itself."""

    theme: Theme = Theme()
    focus: int = 0
    """Which of several objects is shown whole."""
    paused: bool = False
    """The picture stands still; the capture goes on."""
    help_open: bool = False
    prompt: str = ""
    """What is asked for while a person types; empty otherwise."""
    typed: str = ""
    """What was typed so far."""
    message: str = ""
    """Answer to the last key."""
