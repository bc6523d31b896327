"""A recording as a link: the same chunks, with the same times of reception."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from host.errors import UsageError
from host.links.transport import AnyChunk, GapChunk, LinkEnd, Transport
from host.links.uri import LinkUri
from host.recording.reader import RecordingReader


def open_transport(uri: LinkUri) -> ReplayTransport:
    """Open a ``replay:FILE[?speed=X]`` link; without a speed it delivers as fast as it is read.

    Raises
    ------
    UsageError
        Impossible speed.
    FileError
        Not a recording.
    """
    uri.allow_options({"speed"})
    text = uri.options.get("speed", "0")
    try:
        speed = float(text)
    except ValueError:
        speed = -1.0
    if not 0 <= speed <= 1e6:
        raise UsageError(f"speed={text} in the link {uri} is not a speed", "give 1 for real time, 0 for no pacing")
    return ReplayTransport(Path(uri.target), speed)


class ReplayTransport(Transport):
    """Delivers a recording's raw chunks; what is written to it goes nowhere.

    Parameters
    ----------
    path : Path
        The recording.
    speed : float
        1 is real time, 10 ten times as fast, 0 as fast as it is read.
    now_ns, sleep : callable
        The clock that paces, and how to wait for it.
    """

    is_live = False

    def __init__(
        self,
        path: Path,
        speed: float = 0.0,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.name = f"replay:{path}"
        self.recording = RecordingReader(path)
        self._chunks = self.recording.delivered()
        self._speed = speed
        self._now_ns = now_ns
        self._sleep = sleep
        self._next: AnyChunk | None = None
        self._anchor: tuple[int, int] | None = None

    def read(self, timeout_s: float) -> AnyChunk | None:
        """Return the next chunk when its time has come."""
        if self._next is None:
            self._next = next(self._chunks, None)
            if self._next is None:
                raise LinkEnd
        if self._speed > 0 and not isinstance(self._next, GapChunk):  # which has no time of its own
            now_ns = self._now_ns()
            if self._anchor is None:
                self._anchor = (now_ns, self._next.host_time_ns)
            due_ns = self._anchor[0] + (self._next.host_time_ns - self._anchor[1]) / self._speed
            wait_s = (due_ns - now_ns) / 1e9
            if wait_s > 0:
                self._sleep(min(wait_s, timeout_s))
                if wait_s > timeout_s:
                    return None
        chunk, self._next = self._next, None
        return chunk

    def write(self, data: bytes) -> None:
        """Ignore: nobody listens in a recording."""

    def close(self) -> None:
        """Close the file."""
        self._chunks = iter(())
