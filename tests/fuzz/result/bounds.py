"""What an input may cost: processor time, and memory of the whole process."""

from __future__ import annotations

import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

MAX_MEMORY_BYTES = 2**30
MAX_INPUT_S = 4.0
"""Processor time of one input, ten times what the slowest take; what else the machine does is no part of it."""


class TooSlowError(BaseException):
    """An input took more processor time than it may; no guard around a part of the program catches it."""


def limit_memory() -> None:
    """Let the process have so much address space and no more: beyond it Python raises MemoryError."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))


@contextmanager
def limited_time(seconds: float = MAX_INPUT_S) -> Iterator[None]:
    """Raise :class:`TooSlowError` in what runs inside once it has had its processor time."""

    def ring(_signal: int, _frame: FrameType | None) -> None:
        raise TooSlowError(f"more than {seconds} s of processor time")

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def peak_memory_mb() -> float:
    """Return the most memory that the process ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
