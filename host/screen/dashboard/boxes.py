"""Lines of exact width: cut, padded, framed, side by side, kept until a cycle changes them. A picture is a list.

Plain lists on purpose: rich's own tables and panels measure everything several times, which costs more than the rest
of a frame.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rich.cells import cell_len
from rich.text import Text

from host.screen.dashboard.theme import Theme
from host.trial.state import CycleRow, Quaternion, TrialState

Lines = list[Text]


def fitted(line: Text, width: int, theme: Theme) -> Text:
    """Return a line cut or padded to a width; what is cut ends in an ellipsis (ASCII: ``~``)."""
    missing = width - line.cell_len
    if missing == 0:
        return line
    line = line.copy()
    if missing < 0 and theme.ascii_only:
        line.truncate(max(0, width - 1), overflow="crop")
        line.append("~"[:width])
    elif missing < 0:
        line.truncate(width, overflow="ellipsis")
    return line.append(" " * (width - line.cell_len))


def end_of(words: str, width: int, theme: Theme) -> str:
    """Return a text without its start where it is too long, as is right for paths, URIs, and what is being typed."""
    words, cut = theme.words(words), theme.words("…")
    if cell_len(words) <= width:
        return words
    while words and cell_len(words) > width - len(cut):
        words = words[1:]
    return cut + words


def block(lines: Lines, width: int, height: int, theme: Theme) -> Lines:
    """Return lines cut or filled to a rectangle."""
    lines = lines[:height]
    return [fitted(line, width, theme) for line in lines] + [Text(" " * width, end="")] * (height - len(lines))


def framed(
    lines: Lines,
    title: str,
    width: int,
    height: int,
    theme: Theme,
    meaning: str = "frame",
    right_title: str = "",
    foot: Text | None = None,
) -> Lines:
    """Return lines with a frame around them; width and height are those of the frame.

    A title at the right is left out where there is no room for both; ``foot`` stands in the lower edge.
    """
    corners, bar, side = ("++++", "-", "|") if theme.ascii_only else ("╭╮╰╯", "─", "│")
    inner = max(0, width - 4)
    head = _title(title, inner, theme)
    tail = _title(right_title, inner, theme)
    if head.cell_len + tail.cell_len + 3 > inner:
        tail = Text(end="")
    top = theme.join((corners[0] + bar, meaning))
    top.append_text(head)
    top.append(bar * (width - 4 - head.cell_len - tail.cell_len), theme.styles[meaning])
    top.append_text(tail)
    top.append((bar + corners[1])[: max(0, width - top.cell_len)], theme.styles[meaning])
    left, right = theme.text(f"{side} ", meaning), theme.text(f" {side}", meaning)
    body = [Text.assemble(left, line, right, end="") for line in block(lines, inner, max(0, height - 2), theme)]
    bottom = theme.text(corners[2], meaning)
    if foot:
        bottom = theme.join((f"{corners[2]}{bar} ", meaning)).append_text(foot).append(" ")
    bottom.append(bar * (width - 1 - bottom.cell_len) + corners[3], theme.styles[meaning])
    return [top, *body, bottom]


def _title(words: str, width: int, theme: Theme) -> Text:
    if not words:
        return Text(end="")
    title = theme.text(f" {words} ")
    return fitted(title, min(width, title.cell_len), theme)


def beside(*parts: Lines) -> Lines:
    """Return rectangles of equal height side by side."""
    return [Text.assemble(*row, end="") for row in zip(*parts, strict=True)]


Drawing = Callable[[TrialState, Theme, int, int], Lines]
"""Most drawings take the moment, colours and characters, and the width and height of the rectangle that they fill."""
_Key = tuple[Quaternion | None, bool, bool, Theme, int, int]
KEPT = 16
"""Drawings remembered of each kind: enough for several objects."""


def once_a_cycle(drawing: Drawing) -> Drawing:
    """Return a drawing that remembers what it drew until a cycle changes it.

    Of the state, the drawing may depend on the cycles, the origin, and whether there is data and movement at all.
    """
    kept: deque[tuple[tuple[CycleRow, ...], _Key, Lines]] = deque(maxlen=KEPT)

    def remembered(state: TrialState, theme: Theme, width: int, height: int) -> Lines:
        has_data = state.sensor.orientation_wxyz is not None
        key = (state.score.origin_wxyz, has_data, state.motion.at_rest, theme, width, height)
        for cycles, known, lines in kept:
            # The very same cycles: to compare hundreds would cost as much as to draw them.
            if cycles is state.score.cycles and known == key:
                return lines
        lines = drawing(state, theme, width, height)
        kept.append((state.score.cycles, key, lines))
        return lines

    return remembered
