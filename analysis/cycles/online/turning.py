"""The extremes of an angle that swings, found as it goes: a state machine of four values."""

from __future__ import annotations

from collections.abc import Callable

from analysis.cycles.online.angle import AnglePoint


class TurningFinder:
    """Watch an angle for the point where it turns.

    The angle rises from the last turning point to a highest point so far; once it has gone back far enough from there,
    that point is the next turning point, and now the lowest point so far is watched. At the start either may come
    first.
    """

    def __init__(self, start: AnglePoint) -> None:
        self.last = start
        """The last turning point, or the start."""
        self._rising: bool | None = None  # None before the first turning point
        self._high = self._low = start

    def add(self, now: AnglePoint, went_back: Callable[[AnglePoint, AnglePoint], bool]) -> int | None:
        """Receive the next point.

        Returns
        -------
        1 where an upper turning point was just confirmed, 0 for a lower one, else None; :attr:`last` is the point.
        ``went_back`` decides whether from the first point, an extreme so far, to the second, which is now, is enough.
        """
        if now.angle_rad > self._high.angle_rad:
            self._high = now
        if now.angle_rad < self._low.angle_rad:
            self._low = now
        if self._rising is not False and went_back(self._high, now):
            self.last, upper = self._high, 1
        elif self._rising is not True and went_back(self._low, now):
            self.last, upper = self._low, 0
        else:
            return None
        self._rising = not upper
        self._high = self._low = now
        return upper
