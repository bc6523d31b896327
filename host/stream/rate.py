"""How many samples a second come, over the last seconds."""

from __future__ import annotations

from collections import deque

BIN_NS = 100_000_000
N_BINS = 30


class RateMeter:
    """Counts over the last three seconds of host time, in tenths; bounded, whatever the rate."""

    def __init__(self) -> None:
        self._bins: deque[tuple[int, int]] = deque(maxlen=N_BINS + 1)  # number of the tenth, samples in it
        self._first: int | None = None

    def add(self, n: int, host_time_ns: int) -> None:
        """Enter ``n`` samples received at a time."""
        tenth = host_time_ns // BIN_NS
        if self._first is None:
            self._first = tenth
        if self._bins and self._bins[-1][0] >= tenth:
            self._bins[-1] = (self._bins[-1][0], self._bins[-1][1] + n)
        else:
            self._bins.append((tenth, n))

    def rate_hz(self, now_ns: int) -> float | None:
        """Return the rate over the last whole tenths, 1/s; None during the first half second."""
        if self._first is None:
            return None
        end = now_ns // BIN_NS  # the tenth under way is not counted, nor the first, which started anywhere
        start = max(self._first + 1, end - N_BINS)
        if end - start < 4:
            return None
        n = sum(count for tenth, count in self._bins if start <= tenth < end)
        return n / ((end - start) * BIN_NS / 1e9)
