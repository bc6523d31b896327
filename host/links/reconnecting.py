"""A live link that comes back: a cable pulled out and put in again is a gap, not the end of a capture.

When the link is lost, it is closed and opened again under the same name, at first after 20 ms, then less and less
often, up to :data:`LONGEST_PAUSE_S`, for a bounded time: one for all attempts until the object is heard again, so that
a server which accepts and closes does not start it again each time. The first chunk after that is an empty one
(:class:`host.links.transport.Chunk`), so that everything behind, and the recording, knows of it. Who is at the
other end then is for the session to ask.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from operator import methodcaller

from host.errors import HostError, LinkLostError
from host.links.opening import OPEN_S, Opening
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
    opened : Transport, optional
        The link, if it is open already.

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
        opened: Transport | None = None,
    ) -> None:
        self._reopen = reopen
        self._give_up_s = give_up_s
        self._now_ns = now_ns
        self._sleep = sleep
        self._inner = reopen() if opened is None else opened
        self._away: LinkLostError | None = None  # why it was lost, while it is away
        self._lost_ns = 0
        self._next_try_ns = 0
        self._pause_s = FIRST_PAUSE_S
        self._opening: Opening[Transport] | None = None
        self._opening_ns = 0  # when that began
        self._is_proven = True  # whether the object was heard since the link was lost
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

    def proven(self) -> None:
        """Note that the object was heard: when the link is lost the next time, it has all its time again."""
        self._is_proven = True

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
            now_ns = self._now_ns()
            if self._is_proven:
                self._lost_ns, self._pause_s, self._is_proven = now_ns, FIRST_PAUSE_S, False
            elif now_ns - self._lost_ns >= self._give_up_s * 1e9:
                raise self._given_up(error) from error
            else:
                self._pause_s = min(LONGEST_PAUSE_S, 2 * self._pause_s)
            self._next_try_ns = now_ns + round(1e9 * self._pause_s)
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
        self._abandon()
        self._inner.close()

    def _try_again(self, timeout_s: float, lost: LinkLostError) -> AnyChunk | None:
        now_ns = self._now_ns()
        if self._closed:
            raise self._given_up(lost)
        if self._opening is None:
            if now_ns < self._next_try_ns:
                self._sleep(min(timeout_s, (self._next_try_ns - now_ns) / 1e9))
                return None
            self._opening, self._opening_ns = Opening(self._reopen, methodcaller("close")), now_ns
        # Drivers may block as they open, so each attempt has a thread: this one goes on to notice a stop.
        if not self._opening.wait(timeout_s):
            if now_ns - min(self._lost_ns + self._give_up_s * 1e9, self._opening_ns + OPEN_S * 1e9) >= 0:
                self._abandon()
                self._plan_next(lost, None)
            return None
        opening, self._opening = self._opening, None
        try:
            inner = opening.result()
        except HostError as error:
            self._plan_next(lost, error)
            return None
        self._inner, self._away = inner, None
        if self._closed:
            inner.close()
        self.reconnects += 1
        return Chunk(b"", self._now_ns())

    def _plan_next(self, lost: LinkLostError, error: HostError | None) -> None:
        """Plan the next attempt after one that failed."""
        now_ns = self._now_ns()
        if self._closed or now_ns - self._lost_ns >= self._give_up_s * 1e9:
            raise self._given_up(lost) from error
        self._pause_s = min(LONGEST_PAUSE_S, 2 * self._pause_s)
        self._next_try_ns = now_ns + round(1e9 * self._pause_s)

    def _given_up(self, lost: LinkLostError) -> LinkLostError:
        away_s = (self._now_ns() - self._lost_ns) / 1e9
        return LinkLostError(f"{lost.message}, and did not come back within {away_s:.0f} s", lost.remedy)

    def _abandon(self) -> None:
        opening, self._opening = self._opening, None
        if opening is not None:
            opening.abandon()
