"""Opening a link without waiting for ever: drivers connect and shake hands in their constructors, and may block there.

The opening runs in a thread of its own. Whoever waits for it has a limit and a way out; what is opened too late is
closed again at once.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from operator import methodcaller
from typing import Generic, TypeVar

from host.errors import LinkError, NoAnswerError
from host.links.transport import Transport

OPEN_S = 10.0
"""Longest time for the opening of a link: some drivers take 5 s to connect, boards that reset as it opens 3 s."""
POLL_S = 0.02
"""How soon a stop is noticed."""


T = TypeVar("T")


class Opening(Generic[T]):
    """One attempt to open something, under way in a thread; ``close`` closes what is opened too late."""

    def __init__(self, open_it: Callable[[], T], close: Callable[[T], object]) -> None:
        self._open, self._close = open_it, close
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._opened: T | None = None
        self._error: BaseException | None = None
        self._abandoned = False
        threading.Thread(target=self._run, name="rotdrift-opening", daemon=True).start()

    def wait(self, timeout_s: float) -> bool:
        """Return whether the attempt is over, after at most so long."""
        return self._done.wait(timeout_s)

    def result(self) -> T:
        """Return what was opened, or raise what went wrong; only where the attempt is over."""
        if self._error is not None:
            raise self._error
        assert self._opened is not None
        return self._opened

    def abandon(self) -> None:
        """Wait no longer: what is opened yet is closed again."""
        with self._lock:
            self._abandoned = True
            opened, self._opened = self._opened, None
        if opened is not None:
            self._close(opened)

    def _run(self) -> None:
        try:
            opened = self._open()
        except BaseException as error:  # noqa: BLE001 - raised again by whoever waits for it
            self._error = error
        else:
            with self._lock:
                if not self._abandoned:
                    self._opened = opened
            if self._opened is None:
                self._close(opened)
        finally:
            self._done.set()


def open_within(
    open_it: Callable[[], Transport], name: str, stop: threading.Event | None = None, limit_s: float = OPEN_S
) -> Transport:
    """Open a link, at most for so long.

    Parameters
    ----------
    open_it : callable
        Opens it.
    name : str
        What is opened, for people.
    stop : threading.Event, optional
        Ends the waiting.
    limit_s : float, optional
        The limit.

    Raises
    ------
    NoAnswerError
        It did not open within the limit.
    LinkError
        It was stopped.
    """
    opening: Opening[Transport] = Opening(open_it, methodcaller("close"))
    end_s = time.monotonic() + limit_s
    try:
        while not opening.wait(POLL_S):
            if stop is not None and stop.is_set():
                raise LinkError(f"stopped before {name} was open", "start again when the other side is ready")
            if time.monotonic() > end_s:
                raise NoAnswerError(
                    f"{name} does not open within {limit_s:.0f} s", "check what is at the other end, and start it first"
                )
    except BaseException:
        opening.abandon()
        raise
    opened: Transport = opening.result()
    return opened
