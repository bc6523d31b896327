"""The limits of a reading process, and how each system holds it to them."""

from __future__ import annotations

import contextlib
import math
import os
import select
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

BASE_MEMORY_BYTES = 2**30
"""Address space of the interpreter, the libraries, and what a file of no size may need."""
MEMORY_PER_FILE_BYTE = 50
"""A sound file unpacks to less than ten times its size, and is copied twice or thrice on the way."""
MOST_MEMORY_BYTES = 4 * 2**30
LEAST_S = 20.0
S_PER_MB = 20.0
"""A hundred times what a sound file needs."""
MOST_S = 1800.0
WALL_FACTOR = 10.0
"""A process that works gets so much longer on a busy machine; one that only waits is ended then."""
MAX_OUTPUT_BYTES = 2 * 2**30
"""What one reading process may return; and what it may unpack to its temporary folder, as rosbags does."""

OUT_OF_MEMORY, OUT_OF_SCRATCH = 77, 78
"""Exit codes of a process that found itself, or its temporary folder, too large."""
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Limits:
    """What a reading process may use."""

    memory_bytes: int
    """Address space on Linux, resident memory on macOS; not limited on Windows."""
    seconds: float
    """Of processor time; ten times as long on the wall, and on Windows that alone."""
    output_bytes: int = MAX_OUTPUT_BYTES
    """Returned; and as many in files of its temporary folder."""

    @staticmethod
    def of_file(n_bytes: int) -> Limits:
        """Return the limits for a file of so many bytes: a small file that unpacks to gigabytes does not get them."""
        return Limits(
            memory_bytes=min(BASE_MEMORY_BYTES + MEMORY_PER_FILE_BYTE * n_bytes, MOST_MEMORY_BYTES),
            seconds=min(LEAST_S + S_PER_MB * n_bytes / 1e6, MOST_S),
            output_bytes=MAX_OUTPUT_BYTES,
        )


def impose(limits: Limits, *, address_space: bool = sys.platform != "darwin") -> None:
    """Hold this process to its limits from now on, and end it when its parent has gone (its standard input ends).

    Linux refuses memory beyond ``RLIMIT_AS``. macOS takes that limit and ignores it, so there a thread watches the
    resident memory and ends the process; it may grow for 50 ms longer. The same thread watches the temporary folder.
    Windows has none of these: there the time, and the bytes that the parent counts, are the only limits.
    """
    if resource is not None:
        if address_space:
            _lower(resource.RLIMIT_AS, limits.memory_bytes)
        _lower(resource.RLIMIT_CPU, math.ceil(limits.seconds), beyond=5)  # first a signal that tells why, then the end
        _lower(resource.RLIMIT_FSIZE, limits.output_bytes)
        _lower(resource.RLIMIT_CORE, 0)
    watched = (math.inf if address_space else limits.memory_bytes, limits.output_bytes)
    threading.Thread(target=_watch, args=watched, daemon=True).start()


def _lower(which: int, value: int, beyond: int = 0) -> None:
    """Set a limit, and the hard one so far beyond it; never above what holds already."""
    assert resource is not None
    _, most = resource.getrlimit(which)
    most = value + beyond if most == resource.RLIM_INFINITY else min(value + beyond, most)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(which, (min(value, most), most))


def _watch(memory_bytes: float, scratch_bytes: int) -> None:
    """End this process when its standard input ends, or when its memory or temporary folder holds more."""
    scratch = Path(tempfile.gettempdir())
    while resource is not None:
        ready, _, _ = select.select([0], [], [], _POLL_S)
        if ready:
            break
        held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if held * (1 if sys.platform == "darwin" else 1024) > memory_bytes:
            os._exit(OUT_OF_MEMORY)
        if _size(scratch) > scratch_bytes:
            os._exit(OUT_OF_SCRATCH)
    while os.read(0, 1):
        pass
    os._exit(1)


def _size(folder: Path) -> int:
    """Return the bytes of all files in a folder; one that vanishes meanwhile counts nothing."""
    total = 0
    for place in folder.rglob("*"):
        with contextlib.suppress(OSError):
            total += place.lstat().st_size
    return total
