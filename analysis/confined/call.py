"""The parent's side: starts the reading process, counts what it returns, and ends it at a limit.

A process costs 0.15 s, mostly for importing numpy, and every file pays it: the size of a file says nothing about what
comes out of it, so none is small enough to be trusted.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Generator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO

from analysis.confined.limits import OUT_OF_MEMORY, OUT_OF_SCRATCH, WALL_FACTOR, Limits
from analysis.confined.process import DONE, FAILED, HEAD, NO_MEMORY, NO_ROOM, PIECE, REFUSED
from analysis.series import ReaderError

_ROOT = Path(__file__).parents[2]
"""The child runs the code of this very process, from wherever it is started."""
_ENVIRONMENT = {
    # Threads and their arenas would take gigabytes of address space on a machine with many cores.
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MALLOC_ARENA_MAX": "2",
    "ARROW_IO_THREADS": "1",
    "ARROW_DEFAULT_MEMORY_POOL": "system",
}


class StoppedError(Exception):
    """A reading process ended before its result: at a limit, or of what it read; the text is half a sentence."""


def pieces_of(function: str, *arguments: object, limits: Limits) -> Generator[bytearray, None, object]:
    """Call a generator of bytes in a process of its own; yield its pieces and return its value.

    Parameters
    ----------
    function : str
        ``module:name``; see :mod:`analysis.confined.process`.
    *arguments : object
        Its arguments, as JSON can hold them.
    limits : Limits
        What the process may use.

    Raises
    ------
    ReaderError
        Raised by the function.
    StoppedError
        The process reached a limit, raised something else, or crashed.
    """
    with TemporaryDirectory(prefix="rotdrift-") as scratch:  # removed even where the process was ended
        return (yield from _pieces({"function": function, "arguments": arguments}, scratch, limits))


def _pieces(request: dict[str, object], scratch: str, limits: Limits) -> Generator[bytearray, None, object]:
    environment = {**os.environ, **_ENVIRONMENT, **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), scratch)}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "analysis.confined.process"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    late = threading.Event()

    def end() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(WALL_FACTOR * limits.seconds, end)
    timer.daemon = True
    timer.start()
    try:
        request["limits"] = asdict(limits)
        with contextlib.suppress(OSError):  # it ended at once: its exit code is what counts
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
        return (yield from _answer(process.stdout, limits))
    except EOFError:
        raise StoppedError(_why_ended(process.wait(), limits, late=late.is_set())) from None
    finally:
        timer.cancel()
        process.kill()
        process.stdout.close()
        with contextlib.suppress(OSError):
            process.stdin.close()
        process.wait()


def _answer(stream: IO[bytes], limits: Limits) -> Generator[bytearray, None, object]:
    """Yield the pieces and return the value, or raise what the child reports; EOFError where the answer is cut."""
    total = 0
    while True:
        kind, length = HEAD.unpack(_exactly(stream, HEAD.size))
        total += length
        if total > limits.output_bytes:
            raise StoppedError(_too_much(limits))
        payload = _exactly(stream, length)
        if kind == PIECE:
            yield payload
        elif kind == DONE:
            return json.loads(payload)
        elif kind == REFUSED:
            raise _refusal(*json.loads(payload))
        elif kind == NO_MEMORY:
            raise StoppedError(_too_large(limits))
        elif kind == NO_ROOM:
            raise StoppedError(_too_much(limits))
        else:
            assert kind == FAILED
            # A library may name want of memory as it likes, so the limits are part of the sentence.
            text = payload.decode("utf-8", "replace")
            raise StoppedError(f"{text} (with {_size(limits.memory_bytes)} of memory and {limits.seconds:.3g} s)")


def _refusal(name: str, arguments: list[str], attributes: dict[str, object]) -> ReaderError:
    """Return the error that the function raised; of a class that is not known here, as its base."""
    kinds: list[type[ReaderError]] = [ReaderError]
    for kind in kinds:
        kinds += kind.__subclasses__()
    kind = next((kind for kind in kinds if kind.__name__ == name), ReaderError)
    error = kind.__new__(kind, *arguments)
    vars(error).update({key: tuple(item) if isinstance(item, list) else item for key, item in attributes.items()})
    return error


def _exactly(stream: IO[bytes], length: int) -> bytearray:
    data = bytearray(length)
    if stream.readinto(data) < length:  # type: ignore[attr-defined]  # a buffered stream has it
        raise EOFError
    return data


def _why_ended(code: int, limits: Limits, *, late: bool) -> str:
    if late:
        return f"reading it did not end within {WALL_FACTOR * limits.seconds:.3g} s"
    if code == -getattr(signal, "SIGXCPU", 0):
        return f"reading it did not end within {limits.seconds:.3g} s of processor time"
    if code == OUT_OF_MEMORY:
        return _too_large(limits)
    if code == OUT_OF_SCRATCH:
        return _too_much(limits)
    return f"its reader crashed (exit code {code}): it is damaged, or needs more than {_size(limits.memory_bytes)}"


def _too_large(limits: Limits) -> str:
    return f"it needs more than {_size(limits.memory_bytes)} of memory"


def _too_much(limits: Limits) -> str:
    return f"more than {_size(limits.output_bytes)} come out of it"


def _size(n_bytes: int) -> str:
    return f"{n_bytes / 2**30:.3g} GiB" if n_bytes >= 2**30 else f"{n_bytes / 2**20:.3g} MiB"
