"""The one thread that reads a link: read, stamp, hand over, nothing else.

Waking it costs some 50 us whatever is read then. So where several links share a processor it is given a pause: what
comes meanwhile is read in one go. The estimate of an object's clock lives on samples that are stamped right as they
arrive, so after each pause the thread waits for one more, and stamps all by that.
"""

from __future__ import annotations

import threading
import time
from collections import deque

from host.errors import HostError, LinkLostError
from host.links.transport import AnyChunk, FrameChunk, LinkEnd, Transport, joined

READ_TIMEOUT_S = 0.05
"""How long one read waits: also how soon a stop is noticed."""
GATHER_S = 0.005
"""Chunks of a live link are returned at most so often. Waking at 1 kHz for each costs as much as all that is done with
it; the time of reception is stamped where the link is read, so nothing is known later."""
MAX_QUEUED_CHUNKS = 65536
"""A minute of 1 kHz chunks: beyond it the newest are counted and dropped, for waiting would lose them in the driver."""


class ReaderThread:
    """Reads a transport in a thread of its own and closes it there.

    On a live link the thread never waits for whoever processes the chunks: a full queue drops the newest chunk and
    counts it. A replay can wait, so it does and loses nothing.

    Parameters
    ----------
    transport : Transport
        Open; belongs to the thread from :meth:`start` on, except for its ``write``.
    pause_s : float
        Rest after a read on which more bytes followed within this time; 0 reads them as they come.
    """

    def __init__(self, transport: Transport, pause_s: float = 0.0) -> None:
        self._transport = transport
        self._pause_s = pause_s
        self._chunks: deque[AnyChunk] = deque()
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._ended = False
        self.error: HostError | None = None
        """Why the link ended; None while it runs, and after an orderly end."""
        self.overflow_chunks = 0
        """Chunks dropped because the queue was full."""
        self._taken_s = -GATHER_S
        self._thread = threading.Thread(target=self._run, name="rotdrift-reader", daemon=True)

    @property
    def ended(self) -> bool:
        """Whether the link is over and every chunk of it was returned."""
        return self._ended and not self._chunks

    def start(self) -> None:
        """Start to read."""
        self._thread.start()

    def take(self, timeout_s: float) -> list[AnyChunk]:
        """Wait for chunks, at most ``timeout_s``, and return all that are there; empty when none came.

        On a live link that delivers many, calls come back at most every :data:`GATHER_S`, or once a pause.
        """
        early_s = self._taken_s + max(GATHER_S, self._pause_s) - time.monotonic()
        if early_s > 0 and self._transport.is_live and not self._ended and not self._stop.is_set():
            time.sleep(early_s)
        with self._changed:
            if not self._chunks and not self._ended:
                self._changed.wait(timeout_s)
            chunks = list(self._chunks)
            self._chunks.clear()
            self._changed.notify_all()
        self._taken_s = time.monotonic()
        return chunks

    def stop(self, timeout_s: float = 2.0) -> bool:
        """Ask the thread to end and return whether it did in time; chunks already read can still be taken.

        A driver that hangs in a call is left to the daemon flag. A thread that was never started closes nothing.
        """
        self._stop.set()
        if self._thread.ident is None:
            self._transport.close()
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                chunk = self._transport.read(READ_TIMEOUT_S)
                if chunk is None:
                    continue
                if self._pause_s and chunk.data and not isinstance(chunk, FrameChunk):  # every frame has its own stamp
                    self._read_on(chunk)
                else:
                    self._hand_over(chunk)
        except LinkEnd:
            pass
        except HostError as error:
            self.error = error
        except Exception as error:  # noqa: BLE001 - a thread must not die in silence
            self.error = LinkLostError(f"{self._transport.name} failed ({type(error).__name__}: {error})")
            self.error.__cause__ = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()
            self._transport.close()

    def _read_on(self, chunk: AnyChunk) -> None:
        """Hand over what was read together with what follows, and rest; what follows late comes alone."""
        after: AnyChunk | None = None
        try:
            after = self._transport.read(self._pause_s)
        finally:
            if after is not None and after.data:
                chunk = joined([chunk, after])
            self._hand_over(chunk)
        if after is None:
            return
        if not after.data:  # the link was opened again
            self._hand_over(after)
        time.sleep(self._pause_s)

    def _hand_over(self, chunk: AnyChunk) -> None:
        with self._changed:
            while len(self._chunks) >= MAX_QUEUED_CHUNKS:
                if self._transport.is_live or self._stop.is_set():
                    self.overflow_chunks += 1
                    return
                self._changed.wait(READ_TIMEOUT_S)
            self._chunks.append(chunk)
            self._changed.notify_all()
