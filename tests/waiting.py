"""Waiting in tests: for a condition, with a bound, and with a message that states what did not come.

The bound guards against hanging and is decided here alone. It promises no speed: on an idle machine everything comes
within seconds, and a machine that is busy with other work may take twenty times as long.
"""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

HANG_S = 240.0
"""Longest wait for one thing. The limit of a whole test (pyproject.toml) is longer, so that the message comes first."""

SLOW_S = 30.0
"""Processor time that some tenths of a second of work never take, unless their cost has come to grow with the square.

How fast anything is: `make bench`.
"""

T = TypeVar("T")


def short_pause() -> None:
    """Leave the processor to whoever is waited for."""
    time.sleep(0.005)


def wait_for(condition: Callable[[], T], what: str | Callable[[], str], turn: Callable[[], object] = short_pause) -> T:
    """Return the first true value of a condition.

    Parameters
    ----------
    condition : callable
        Asked again and again.
    what : str or callable returning str
        What is waited for, for the message; a callable may add what is there instead.
    turn : callable
        Called between two looks: what brings the condition nearer.

    Raises
    ------
    AssertionError
        When `HANG_S` has passed.
    """
    deadline = time.monotonic() + HANG_S
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {HANG_S:.0f} s for {what if isinstance(what, str) else what()}")
        turn()
    return value


def wait_for_event(event: threading.Event, what: str) -> None:
    """Wait until an event is set."""
    assert event.wait(HANG_S), f"waited {HANG_S:.0f} s for {what}"


def wait_for_thread(thread: threading.Thread) -> None:
    """Wait for the end of a thread."""
    thread.join(HANG_S)
    assert not thread.is_alive(), f"waited {HANG_S:.0f} s for the end of {thread.name}"
