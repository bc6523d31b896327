"""The least delayed chunk of every second: what the lower envelope is drawn through."""

from __future__ import annotations

from collections import deque

from host.clock.envelope import Point

SECOND_NS = 10**9
"""Of every second of host time the least delay is kept."""


class Seconds:
    """Keeps one point a second, and those apart that came so late that they mean nothing for the line.

    Chunks of one late second are chance; many such seconds in a row are a step of the clock. So late seconds wait
    outside the kept ones until the next good second forgets them, or they are enough to be believed.
    """

    def __init__(self) -> None:
        self.kept: deque[Point] = deque()
        """In order of device time."""
        self.late: list[Point] = []
        """Seconds in a row, up to the last one, far above the line."""
        self.late_least_ns = float("inf")
        """How far at least."""
        self.best: Point | None = None
        """Of the second under way; None before its first chunk."""
        self._best_residual_ns = float("inf")
        self._number = 0  # of the second under way

    def is_new(self, host_time_ns: int) -> bool:
        """Return whether a chunk belongs to another second than the one under way."""
        return host_time_ns // SECOND_NS != self._number

    def enter(self, point: Point, residual_ns: float, host_time_ns: int) -> None:
        """Enter a chunk, and how far above the present line it lies; one on it has lowered it, and is the best."""
        self._number = host_time_ns // SECOND_NS
        if residual_ns < self._best_residual_ns or residual_ns == 0.0:
            self.best, self._best_residual_ns = point, residual_ns

    def close(self) -> tuple[Point | None, float]:
        """End the second under way; return its best point (None without one), and how far above the line it lay."""
        closed = self.best, self._best_residual_ns
        self.best, self._best_residual_ns = None, float("inf")
        return closed

    def keep(self, point: Point, oldest_us: float) -> None:
        """Keep a second's point, forget the late ones, and those before ``oldest_us``."""
        self.late, self.late_least_ns = [], float("inf")
        if not self.kept or point[0] > self.kept[-1][0]:
            self.kept.append(point)
        while self.kept and self.kept[0][0] < oldest_us:
            self.kept.popleft()

    def put_aside(self, point: Point, residual_ns: float) -> int:
        """Put a late second's point aside; return how many there are in a row."""
        self.late.append(point)
        self.late_least_ns = min(self.late_least_ns, residual_ns)
        return len(self.late)
