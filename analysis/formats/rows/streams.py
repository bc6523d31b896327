"""More than one of something in a source: which there are, which was chosen, and one sentence about it.

Publishers on a topic, sensors in a table, channels and nodes of a bus, sessions in a file: one number is never computed
across two of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.formats.source import plain
from analysis.series import ReaderError

LabelArray = npt.NDArray[np.str_]

MAX_STREAMS = 64
"""A column with more different values names something else."""
MIN_ROWS_EACH = 10
"""Rows of a stream, on average: fewer, and the column numbers rows."""
MIN_CHANGES = 0.2
"""Share of rows at which a column changes that tells streams apart though its name does not show it."""
MIN_APART_DEG = 0.3
MIN_ALONE = 0.2
"""Share of quiet rows that stand alone, from which on they are another sensor's: fewer are set aside as outliers."""
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_PLURALS = {"sensor": "sensors", "channel": "channels", "node": "nodes", "session": "sessions"}
_LISTED = 20


class SeveralStreamsError(ReaderError):
    """A source holds several of something and none was chosen.

    Parameters
    ----------
    message : str
        The sentence about it.
    kind : str
        ``sensor``, ``channel``, ``node`` or ``session``.
    names : sequence of str
        What there is.
    """

    def __init__(self, message: str, kind: str, names: Sequence[str]) -> None:
        super().__init__(message)
        self.kind = kind
        self.names = tuple(names)


@dataclass(frozen=True)
class StreamChoice:
    """What a person chose of several."""

    sensor: str | None = None
    """Publisher, frame or sensor id in a table or a bag."""
    channel: str | None = None
    """Channel of a bus's log, or of an MCAP file."""
    session: int | None = None
    """Number of the session, from 1 on."""


def counted(kind: str, names: Sequence[str]) -> str:
    """Return how many there are, and which: ``two sensors: 1, 2``."""
    number = _NUMBERS[len(names)] if len(names) < len(_NUMBERS) else str(len(names))
    word = kind if len(names) == 1 else _PLURALS[kind]
    listed = ", ".join(plain(name) for name in names[:_LISTED])
    return f"{number} {word}: {listed}{', …' if len(names) > _LISTED else ''}"


def chosen(kind: str, names: Sequence[str], wanted: str | None, option: str | None = None) -> str:
    """Return the one that counts: the wanted one, or the only one.

    Parameters
    ----------
    kind : str
        ``sensor``, ``channel``, ``node`` or ``session``.
    names : sequence of str
        What there is, at least one.
    wanted : str, optional
        What a person chose.
    option : str, optional
        The option that chooses, where it is not called as ``kind`` is.

    Raises
    ------
    SeveralStreamsError
        There are several, and none is wanted.
    ReaderError
        The wanted one is not there.
    """
    option = option or kind
    if wanted is not None:
        found = next((name for name in names if name == wanted), None)
        if found is None:
            found = next((name for name in names if name.strip().lower() == wanted.strip().lower()), None)
        if found is None:
            raise ReaderError(f"no {kind} {plain(wanted)}; there is {counted(kind, names)}")
        return found
    if len(names) > 1:
        raise SeveralStreamsError(f"{counted(kind, names)}; choose with --{option} {plain(names[0])}", kind, names)
    return names[0]


def tells_apart(labels: LabelArray, named: bool) -> bool:
    """Return whether the values of a column tell several sensors apart.

    Parameters
    ----------
    labels : array of str
        (n,) the cells of the column; empty ones belong to no sensor.
    named : bool
        Whether its name is that of such a column. Any other has to change from row to row, as the rows of several
        sensors do and the state of one does not.
    """
    values = np.unique(labels[labels != ""])
    if not 2 <= len(values) <= MAX_STREAMS or len(labels) < MIN_ROWS_EACH * len(values):
        return False
    return named or float(np.mean(labels[1:] != labels[:-1])) >= MIN_CHANGES


def alternating_deg(steps_deg: npt.NDArray[np.float64], double_steps_deg: npt.NDArray[np.float64]) -> float | None:
    """Return by how much rows alternate between two orientations, deg: two streams without a name; None where not.

    Parameters
    ----------
    steps_deg, double_steps_deg : array of float
        (n - 1,) and (n - 2,) angles from each row to the next, and to the one after that.
    """
    if len(double_steps_deg) < 2 * MIN_ROWS_EACH:
        return None
    # One moving object is further away after two rows than after one, noise is as far. Of two streams the rarer one's
    # rows stand alone: far from both neighbours, which are near each other.
    nearer = np.minimum(steps_deg[1:], steps_deg[:-1])
    alone = (nearer > MIN_APART_DEG) & (double_steps_deg < 0.3 * nearer)
    quiet = double_steps_deg <= np.median(double_steps_deg)  # while the object moves, rows of one stream are apart too
    return float(np.median(nearer[alone])) if float(alone[quiet].mean()) > MIN_ALONE else None
