"""The extremes of an angle that swings, found as it goes: a state machine of four values."""

from __future__ import annotations

from collections.abc import Callable

from analysis.cycles.online.angle import AnglePoint

Turned = tuple[AnglePoint, int]
"""A turning point, and 1 for an upper or 0 for a lower one."""


class TurningFinder:
    """Watch an angle for the point where it turns.

    The angle rises from the last turning point to a highest point so far; once it has gone back far enough from there,
    that point is the next turning point, and now the lowest point so far is watched. At the start either may come
    first.

    Parameters
    ----------
    start : AnglePoint
        The first point.
    """

    def __init__(self, start: AnglePoint) -> None:
        self.last = start
        """The turning point before, or the start."""
        self._rising: bool | None = None  # None before the first turning point
        self._high = self._low = start

    def add(self, now: AnglePoint, went_back: Callable[[AnglePoint, AnglePoint], bool]) -> Turned | None:
        """Receive the next point.

        Parameters
        ----------
        now : AnglePoint
            The point.
        went_back : callable
            Whether from the first point, an extreme so far, to the second, which is now, is far enough.

        Returns
        -------
        The extreme just confirmed, or None; :attr:`last` is still the one before.
        """
        if now.angle_rad > self._high.angle_rad:
            self._high = now
        if now.angle_rad < self._low.angle_rad:
            self._low = now
        if self._rising is not False and went_back(self._high, now):
            return self._high, 1
        if self._rising is not True and went_back(self._low, now):
            return self._low, 0
        return None

    def turn(self, extreme: AnglePoint, now: AnglePoint, upper: int) -> None:
        """Go on from a confirmed extreme."""
        self.last = extreme
        self._rising = not upper
        self._high = self._low = now
