"""A live link that comes back: a cable pulled out and put in again is a gap, not the end of a capture.

When the link is lost, it is closed and opened again under the same name, at first after 20 ms, then less and less
often, up to :data:`LONGEST_PAUSE_S`, for a bounded time. The first chunk after that is an empty one
(:class:`host.links.transport.Chunk`), so that everything behind, and the recording, knows of it. Who is at the
other end then is for the session to ask.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from host.errors import HostError, LinkLostError
from host.links.transport import AnyChunk, Chunk, Transport, TransportAround

FIRST_PAUSE_S = 0.02
LONGEST_PAUSE_S = 0.25
"""A port that is back is found within this, plus the time its opening takes."""


class ReconnectingTransport(TransportAround):
    """A live transport that is opened again when it is lost.

    It belongs to its reader like any other: reading, closing and opening happen in the reading thread. What is written
    while the link is away goes nowhere: commands are repeated.

    Parameters
    ----------
    reopen : callable
        Opens the link; raises HostError where it cannot.
    give_up_s : float
        How long a lost link may take to come back, s.
    now_ns, sleep : callable
        The clock that stamps and times, and how to wait.

    Raises
    ------
    HostError
        The link cannot be opened now: what was never there is not waited for.
    """

    def __init__(
        self,
        reopen: Callable[[], Transport],
        give_up_s: float,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._reopen = reopen
        self._give_up_s = give_up_s
        self._now_ns = now_ns
        self._sleep = sleep
        self._inner = reopen()
        self._away: LinkLostError | None = None  # why it was lost, while it is away
        self._lost_ns = 0
        self._next_try_ns = 0
        self._pause_s = FIRST_PAUSE_S
        self._closed = False
        self.name = self._inner.name
        self.reconnects = 0
        """How often the link was lost and came back."""

    @property
    def connected(self) -> bool:
        """Whether the link is open now."""
        return self._away is None

    @property
    def problems(self) -> tuple[str, ...]:
        """Those of the link itself, and that it is away."""
        away = self._away
        if away is None:
            return self._inner.problems
        return (*self._inner.problems, f"{away.message}; it is opened again when it is back")

    def read(self, timeout_s: float) -> AnyChunk | None:
        """Wait for the next chunk; an empty one when the link is open again.

        Raises
        ------
        LinkLostError
            The link was lost and did not come back in time.
        """
        if self._away is not None:
            return self._try_again(timeout_s, self._away)
        try:
            return self._inner.read(timeout_s)
        except LinkLostError as error:
            self._inner.close()
            if self._give_up_s <= 0:
                raise
            self._lost_ns = self._now_ns()
            self._pause_s = FIRST_PAUSE_S
            self._next_try_ns = self._lost_ns + round(1e9 * FIRST_PAUSE_S)
            self._away = error
            return None

    def write(self, data: bytes) -> None:
        """Send bytes, if the link is there; the reader finds where it is not."""
        if self._away is None:
            try:
                self._inner.write(data)
            except LinkLostError:
                if self._give_up_s <= 0:
                    raise

    def close(self) -> None:
        """Close the link, and try no more."""
        self._closed = True
        self._inner.close()

    def _try_again(self, timeout_s: float, lost: LinkLostError) -> AnyChunk | None:
        now_ns = self._now_ns()
        if now_ns < self._next_try_ns:
            self._sleep(min(timeout_s, (self._next_try_ns - now_ns) / 1e9))
            return None
        try:
            if self._closed:
                raise lost
            inner = self._reopen()
        except HostError as error:
            away_s = (self._now_ns() - self._lost_ns) / 1e9
            if self._closed or away_s >= self._give_up_s:
                raise LinkLostError(
                    f"{lost.message}, and did not come back within {away_s:.0f} s", lost.remedy
                ) from error
            self._pause_s = min(LONGEST_PAUSE_S, 2 * self._pause_s)
            self._next_try_ns = self._now_ns() + round(1e9 * self._pause_s)
            return None
        self._inner, self._away = inner, None
        self.reconnects += 1
        return Chunk(b"", self._now_ns())
