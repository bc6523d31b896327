"""A disk that keeps what is written in a cache until it is told to flush, and a journal of what it has kept when.

The kernel sees a network block device (nbd); its other end is :func:`serve`. A write is answered at once and stands in
memory only; a FLUSH (or a write with FUA) is what makes it last, as with the write cache of a real disk. Whatever lasts
is added to a journal, batch by batch. The disk after a power cut at any moment is then the image before, with the
batches up to there: nothing else can have lasted.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

BLOCK = 4096
SET_SOCK, SET_BLOCK_SIZE, DO_IT, CLEAR_SOCK, SET_SIZE_BLOCKS, SET_FLAGS = 0xAB00, 0xAB01, 0xAB03, 0xAB04, 0xAB07, 0xAB0A
HAS_FLAGS, SEND_FLUSH, SEND_FUA = 1, 4, 8
READ, WRITE, DISCONNECT, FLUSH = range(4)
FUA = 1 << 16
_REQUEST = struct.Struct(">IIQQI")
_REPLY = struct.Struct(">IIQ")
_HEAD = struct.Struct("<4sQQI")
_WRITE = struct.Struct("<QI")


@dataclass(frozen=True)
class Batch:
    """What became lasting at once."""

    synced: int
    """Bytes of its file that the program had been told are on the disk, just before."""
    received: int
    """Bytes of the log of what was received, just before: what came later was lost if power failed then."""
    writes: tuple[tuple[int, bytes], ...]


def serve(end: socket.socket, image: bytearray, journal: int, marks: Callable[[], tuple[int, int]]) -> None:
    """Answer the kernel until it disconnects; ``journal`` is the descriptor of what lasts."""
    unsynced: list[tuple[int, bytes]] = []

    def flush() -> None:
        if unsynced:
            body = b"".join(_WRITE.pack(at, len(data)) + data for at, data in unsynced)
            _append(journal, _HEAD.pack(b"BTCH", *marks(), len(unsynced)) + body)
            unsynced.clear()

    while True:
        head = _receive(end, _REQUEST.size)
        if not head:
            return
        magic, kind, handle, at, length = _REQUEST.unpack(head)
        assert magic == 0x25609513
        answer = b""
        if kind & 0xFFFF == READ:
            answer = bytes(image[at : at + length])
        elif kind & 0xFFFF == WRITE:
            data = _receive(end, length)
            image[at : at + length] = data
            unsynced.append((at, data))
            if kind & FUA:  # of the cache only this write has to last; that all of it does is allowed, and simpler
                flush()
        elif kind & 0xFFFF == FLUSH:
            flush()
        elif kind & 0xFFFF == DISCONNECT:
            return
        end.sendall(_REPLY.pack(0x67446698, 0, handle) + answer)


def attach(device: str, size: int) -> socket.socket:
    """Make a network block device of so many bytes, in a process of its own; return the end to :func:`serve`."""
    ours, kernels = socket.socketpair()
    if os.fork() == 0:
        ours.close()
        with contextlib.suppress(OSError):
            descriptor = os.open(device, os.O_RDWR)
            fcntl.ioctl(descriptor, CLEAR_SOCK)
            fcntl.ioctl(descriptor, SET_BLOCK_SIZE, BLOCK)
            fcntl.ioctl(descriptor, SET_SIZE_BLOCKS, size // BLOCK)
            fcntl.ioctl(descriptor, SET_FLAGS, HAS_FLAGS | SEND_FLUSH | SEND_FUA)
            fcntl.ioctl(descriptor, SET_SOCK, kernels.fileno())
            fcntl.ioctl(descriptor, DO_IT)
        os._exit(0)
    kernels.close()
    return ours


def batches(journal: Path) -> Iterator[Batch]:
    """Yield what the journal holds, in order."""
    data, at = journal.read_bytes(), 0
    while data[at : at + 4] == b"BTCH":
        _, synced, received, n = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        writes = []
        for _ in range(n):
            place, length = _WRITE.unpack_from(data, at)
            at += _WRITE.size
            writes.append((place, data[at : at + length]))
            at += length
        yield Batch(synced, received, tuple(writes))


def _append(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]
    os.fsync(descriptor)


def _receive(end: socket.socket, n: int) -> bytes:
    data = b""
    while len(data) < n:
        more = end.recv(n - len(data))
        if not more:
            return b""
        data += more
    return data
