"""Ctrl-C, SIGTERM and a closed terminal as an event, so that a capture ends in order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Yield an event that the signals which ask a program to end set, in place of ending it.

    The first signal restores the former handlers, so that a second one acts as usual and a program that hangs can be
    interrupted. Outside the main thread, where Python allows no handlers, nothing changes.
    """
    stop = threading.Event()
    previous: dict[signal.Signals, Any] = {}

    def restore() -> None:
        while previous:
            number, handler = previous.popitem()
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    def handle(_number: int, _frame: FrameType | None) -> None:
        stop.set()
        restore()

    try:
        if threading.current_thread() is threading.main_thread():
            for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
                previous[number] = signal.signal(number, handle)
        yield stop
    finally:
        restore()
