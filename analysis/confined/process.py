"""The child: calls one function under limits and writes what it yields to standard output, piece by piece.

The first line of its standard input is the request: limits, the function as ``module:name``, and its arguments. The
function is a generator of bytes whose return value can be written as JSON.
"""

from __future__ import annotations

import errno
import importlib
import json
import os
import struct
import sys
from typing import BinaryIO

from analysis.confined.limits import Limits, impose
from analysis.series import ReaderError

HEAD = struct.Struct("<cQ")
"""In front of every piece: its kind, its length."""
PIECE, DONE, REFUSED, NO_MEMORY, NO_ROOM, FAILED = b"P", b"D", b"R", b"M", b"S", b"F"
"""Bytes of the function; its return value; a ReaderError's class, arguments and attributes; two limits; the text of any
other error."""


def main() -> int:
    """Answer the request; return the exit code."""
    # Whatever a library prints must not stand among the pieces.
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        request = json.loads(sys.stdin.buffer.readline())
        impose(Limits(**request["limits"]))
        try:
            _call(request["function"], request["arguments"], out)
        except ReaderError as error:
            _write(out, REFUSED, json.dumps([type(error).__name__, error.args, vars(error)], default=str).encode())
        except MemoryError:
            _write(out, NO_MEMORY, b"")
        except OSError as error:
            _write(out, *((NO_ROOM, b"") if error.errno == errno.EFBIG else (FAILED, _described(error))))
        except Exception as error:  # noqa: BLE001 - hostile bytes make libraries raise anything
            _write(out, FAILED, _described(error))
        # Not through the interpreter's end: what a library left behind there must not turn a whole result into a crash.
        os._exit(0)


def _described(error: Exception) -> bytes:
    return f"{type(error).__name__}: {error}"[:1000].encode("utf-8", "replace")


def _call(function: str, arguments: list[object], out: BinaryIO) -> None:
    module, _, name = function.partition(":")
    pieces = getattr(importlib.import_module(module), name)(*arguments)
    while True:
        try:
            piece = next(pieces)
        except StopIteration as end:
            _write(out, DONE, json.dumps(end.value).encode())
            return
        _write(out, PIECE, piece)


def _write(out: BinaryIO, kind: bytes, payload: bytes | memoryview) -> None:
    out.write(HEAD.pack(kind, memoryview(payload).nbytes))
    out.write(payload)
    out.flush()  # what has been read is kept, whatever ends this process


if __name__ == "__main__":
    sys.exit(main())
