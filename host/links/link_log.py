"""``--debug-link FILE``: everything that crosses a link, in hexadecimal with times, as text to send to somebody.

One line for each read and write::

    # serial:/dev/ttyACM0, times in seconds of the monotonic clock since 2026-03-04T05:06:07+01:00
         0.001234 >    9  00 04 81 01 c6 7b 00 ...
         0.004321 <   22  00 03 01 ...
         9.100200 !       serial:/dev/ttyACM0 is gone (input/output error)

``>`` is what the host sent, ``<`` what one read returned, ``!`` what happened.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from host.errors import FileError, LinkLostError, already_there, reason_of
from host.links.transport import AnyChunk, FrameChunk, LinkEnd, Transport, TransportAround
from host.text import plain

MAX_LOG_BYTES = 512 * 2**20
"""A log does not grow beyond this: it would fill the disk the recording needs."""


class LinkLog(TransportAround):
    """A transport that writes down what crosses the one inside it.

    A log that cannot be written any more ends, and the capture goes on.

    Parameters
    ----------
    inner : Transport
        Open.
    path : Path
        Must not exist.
    now_ns : callable
        The clock that stamps chunks.

    Raises
    ------
    FileError
        The file exists or cannot be created; ``inner`` is closed then.
    """

    def __init__(self, inner: Transport, path: Path, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._inner = inner
        self._now_ns = now_ns
        self._start_ns = now_ns()
        self._lock = threading.Lock()  # reads and writes come from two threads
        self._problem: str | None = None
        self._was_connected = True
        self.name = inner.name
        self.is_live = inner.is_live
        try:
            self._file = path.open("x", encoding="utf-8")
        except OSError as error:
            inner.close()
            if isinstance(error, FileExistsError):
                raise already_there(path, "give another name with --debug-link") from error
            message = f"{path} cannot be created ({reason_of(error)})"
            raise FileError(message, "give another place with --debug-link") from error
        date = datetime.now().astimezone().isoformat(timespec="milliseconds")
        self._write_line(f"# {plain(self.name)}, times in seconds of the monotonic clock since {date}")

    @property
    def problems(self) -> tuple[str, ...]:
        """Those of the link, and why its log has ended."""
        return (*self._inner.problems, *(() if self._problem is None else (self._problem,)))

    def read(self, timeout_s: float) -> AnyChunk | None:
        """Wait for the next chunk and write it down."""
        try:
            chunk = self._inner.read(timeout_s)
        except LinkLostError as error:
            self._note("!", self._now_ns(), plain(str(error)))
            raise
        except LinkEnd:
            self._note("!", self._now_ns(), "the end")
            raise
        if self._was_connected and not self.connected:
            self._note("!", self._now_ns(), "the link is lost")
        self._was_connected = self.connected
        if isinstance(chunk, FrameChunk):
            for frame in chunk.frames:
                text = f"{frame.arbitration_id:03x}#{frame.data.hex(' ')} flags={int(frame.flags):#x}"
                self._note("<", frame.host_time_ns, f"{len(frame.data):4d}  {text}")
        elif chunk is not None and chunk.data:
            self._note("<", chunk.host_time_ns, f"{len(chunk.data):4d}  {chunk.data.hex(' ')}")
        elif chunk is not None:
            self._note("!", chunk.host_time_ns, "the link is open again")
        return chunk

    def write(self, data: bytes) -> None:
        """Write bytes down, then send them."""
        self._note(">", self._now_ns(), f"{len(data):4d}  {data.hex(' ')}")
        self._inner.write(data)

    def close(self) -> None:
        """Close the link and the log."""
        self._inner.close()
        with self._lock:
            self._file.close()

    def _note(self, sign: str, at_ns: int, text: str) -> None:
        self._write_line(f"{(at_ns - self._start_ns) / 1e9:13.6f} {sign} {text}")

    def _write_line(self, line: str) -> None:
        with self._lock:
            if self._problem is not None or self._file.closed:
                return
            try:
                if self._file.tell() > MAX_LOG_BYTES:
                    raise OSError("it is full")
                self._file.write(line + "\n")
                self._file.flush()
            except OSError as error:
                self._problem = f"the log of the link has ended ({reason_of(error)}); the capture goes on"
