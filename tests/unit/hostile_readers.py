"""Readers that behave as a library does on a hostile file; called in a process of their own, or by it."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from analysis.confined.limits import Limits, impose
from analysis.series import ReaderError


def echoes(text):
    print("a library's chatter")
    os.write(1, b"and below Python")
    yield text.encode()
    yield b""
    return [text]


def never_ends():
    yield b"first"
    while True:
        pass


def only_waits():
    yield b"first"
    time.sleep(600)


def sleeps(mark):
    Path(mark).write_text(str(os.getpid()))
    yield b"x" * (1 << 20)  # so much that the parent has read the mark's piece before the next stays in the pipe
    time.sleep(600)


def takes_memory():
    yield b"first"
    yield bytes(3 << 30)


def returns_without_end():
    while True:
        yield bytes(1 << 20)


def crashes():
    yield b"first"
    os.abort()


def refuses():
    yield b"first"
    raise ReaderError("line 7: not a number")


class ChoiceError(ReaderError):
    """With more than a sentence."""

    def __init__(self, message, kind, names):
        super().__init__(message)
        self.kind = kind
        self.names = tuple(names)


def asks():
    raise ChoiceError("two sensors: 1, 2", "sensor", ["1", "2"])
    yield b""


def fails():
    raise KeyError("\x1b[2J")
    yield b""


def grows_where_the_system_does_not_mind():
    """Where a limit of address space is ignored, as on macOS."""
    impose(Limits(200 << 20, 60.0), address_space=False)
    kept = []
    yield b"first"
    for _ in range(4000):
        kept.append(b"\1" * (1 << 20))
        time.sleep(0.001)
    sys.exit(f"{len(kept)} MiB taken")


def fills_the_disk():
    yield b"first"
    with tempfile.TemporaryFile() as file:
        while True:
            file.write(bytes(1 << 20))


def fills_the_disk_in_small_files():
    yield b"first"
    for number in range(100_000):
        Path(tempfile.gettempdir(), str(number)).write_bytes(bytes(1 << 17))
        time.sleep(0.001)
