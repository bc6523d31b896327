"""What is to happen at given times."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable


class Agenda:
    """Actions in order of time; of those at the same time, in the order in which they were planned."""

    def __init__(self) -> None:
        self._actions: list[tuple[float, int, Callable[[], None]]] = []  # heap: when, order, what
        self._order = itertools.count()

    @property
    def next_due_s(self) -> float:
        """When the next action is due, s; infinite where none is planned."""
        return self._actions[0][0] if self._actions else float("inf")

    def plan(self, time_s: float, action: Callable[[], None]) -> None:
        """Plan an action."""
        heapq.heappush(self._actions, (time_s, next(self._order), action))

    def take_due(self, now_s: float) -> tuple[float, Callable[[], None]] | None:
        """Return the next action due by now with its time, and cross it out; None where there is none."""
        if self.next_due_s > now_s:
            return None
        time_s, _, action = heapq.heappop(self._actions)
        return time_s, action
