"""A link of the host in memory."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterable

from host.errors import LinkLostError
from host.links.transport import AnyChunk, Chunk, LinkEnd, Transport


class MemoryTransport(Transport):
    """Delivers what :meth:`deliver` was given. It does not imitate timing, buffers or driver failures of real ports.

    Parameters
    ----------
    chunks : iterable of AnyChunk
        Delivered first.
    on_write : callable
        Called with everything written: a firmware in memory may answer by calling :meth:`deliver`.
    ends : bool
        Whether the link ends (:class:`LinkEnd`) after the given chunks, as a replay does.
    """

    name = "memory:"

    def __init__(
        self,
        chunks: Iterable[AnyChunk] = (),
        on_write: Callable[[bytes], None] | None = None,
        ends: bool = False,
    ) -> None:
        self._queue: queue.SimpleQueue[AnyChunk | Exception] = queue.SimpleQueue()
        self._on_write = on_write
        self.written: list[bytes] = []
        self.is_live = not ends
        self.closed = False
        for chunk in chunks:
            self._queue.put(chunk)
        if ends:
            self._queue.put(LinkEnd())

    def deliver(self, data: bytes | AnyChunk, host_time_ns: int | None = None) -> None:
        """Hand bytes (or a whole chunk) to the reader; time of reception now unless given."""
        if isinstance(data, bytes):
            data = Chunk(data, time.monotonic_ns() if host_time_ns is None else host_time_ns)
        self._queue.put(data)

    def fail(self, error: Exception) -> None:
        """Let the next read raise ``error``: a cable pulled."""
        self._queue.put(error)

    def read(self, timeout_s: float) -> AnyChunk | None:
        """Wait for the next chunk."""
        if self.closed:
            raise LinkLostError("the link in memory is closed")
        try:
            item = self._queue.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if isinstance(item, Exception):
            self._queue.put(item)  # a lost link stays lost
            raise item
        return item

    def write(self, data: bytes) -> None:
        """Keep what was sent, and hand it to the other side."""
        if self.closed:
            raise LinkLostError("the link in memory is closed")
        self.written.append(data)
        if self._on_write is not None:
            self._on_write(data)

    def close(self) -> None:
        """Refuse everything from now on."""
        self.closed = True
