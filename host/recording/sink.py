"""The file under a recording: what cannot be written now is kept in memory, bounded, and tried again."""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from collections.abc import Iterable
from pathlib import Path

from host.errors import FileError

MAX_KEPT_BYTES = 256 * 2**20
"""Bytes kept in memory while nothing can be written: five hours at 200 Hz. Beyond it, what is lost is reported."""
RETRY_NS = 1_000_000_000
SYNC_NS = 500_000_000
"""How often the system is asked to write what it holds to the disk. A power cut may cost this and how long the disk
needs for it, together at most a second."""
SYNC_WAIT_S = 0.2
"""How long closing waits for a disk that is still at it, and again for the last bytes."""


class RecordingSink:
    """A new file, in a folder that is made for it, that is only ever appended to.

    Python's own buffered writer raises on a full disk at a moment of its choosing and leaves open what it has kept.
    Here nothing is lost silently: :meth:`write` never fails, :meth:`flush_pending` writes what it can, keeps the rest,
    and reports why in :attr:`problem`. Records go to the file whole and in order, so that the recording continues as if
    nothing had happened when the disk has room again.

    Raises
    ------
    FileError
        The file exists, or cannot be created here.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problem: str | None = None
        self.closed = False
        self.bytes_discarded = 0
        self._pending = bytearray()
        self._position = 0
        self._retry_at_ns = 0
        self._sync_at_ns = 0
        self._syncing: threading.Thread | None = None
        self.bytes_synced = 0
        """Bytes known to be on the disk itself."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o644)
        except FileExistsError as error:
            if path.exists():
                raise FileError(f"{path} exists already", "give another name with --out, or move it away") from error
            raise FileError(f"{path.parent} is not a folder", "give another place with --out") from error
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise FileError(f"{path} cannot be created ({reason})", "give another place with --out") from error

    @property
    def pending(self) -> bytes:
        """What is not on the disk yet."""
        return bytes(self._pending)

    def tell(self) -> int:
        """Return where the next byte will stand."""
        return self._position + len(self._pending)

    def write(self, data: bytes | bytearray | memoryview) -> int:
        """Write one whole record (or several); never fails."""
        if self.bytes_discarded or (self.problem and len(self._pending) + len(data) > MAX_KEPT_BYTES):
            # From here on everything is discarded: a later record without the earlier ones would look like a loss
            # on the link.
            self.bytes_discarded += len(data)
        else:
            self._pending += data
        return len(data)

    def flush(self) -> None:
        """Hand everything to the system, if it accepts it."""
        if not self.closed:
            self.flush_pending()

    def flush_pending(self, now_ns: int | None = None) -> bool:
        """Hand everything to the system; return whether nothing is left in memory.

        On failure it is kept and tried again a second later; without ``now_ns``, monotonic, at once.
        """
        if now_ns is not None and self.problem and now_ns < self._retry_at_ns:
            return False
        try:
            while self._pending:
                written = os.write(self._descriptor, memoryview(self._pending)[: 4 * 2**20])
                self._position += written
                del self._pending[:written]
        except OSError as error:
            self.problem = _sentence(error)
            if now_ns is not None:
                self._retry_at_ns = now_ns + RETRY_NS
            return False
        self.problem = None
        return True

    def sync_if_due(self, now_ns: int) -> None:
        """Have what was handed to the system written to the disk, now and then, beside the capture: it may be slow."""
        if now_ns >= self._sync_at_ns and not self.closed and self._start_sync():
            self._sync_at_ns = now_ns + SYNC_NS

    def _start_sync(self) -> bool:
        """Start to sync what is not on the disk itself; False where there is nothing, or the disk is still at it."""
        busy = self._syncing is not None and self._syncing.is_alive()
        if busy or self.bytes_synced == self._position:
            return False
        # A descriptor of its own: closing the file meanwhile must not let it sync another.
        arguments = (os.dup(self._descriptor), self._position)
        self._syncing = threading.Thread(target=self._sync, args=arguments, name="rotdrift-sync", daemon=True)
        self._syncing.start()
        return True

    def _sync(self, descriptor: int, position: int) -> None:
        try:
            with contextlib.suppress(OSError):  # pipes and some network disks cannot
                getattr(os, "fdatasync", os.fsync)(descriptor)
                if not self.bytes_synced:
                    self._sync_folder()
                self.bytes_synced = position
        finally:
            os.close(descriptor)

    def _sync_folder(self) -> None:
        """Have the name of the file on the disk as well: on some file systems its bytes alone do not bring it there."""
        if os.name == "posix":  # elsewhere folders cannot be opened
            with contextlib.suppress(OSError):
                folder = os.open(self.path.parent, os.O_RDONLY)
                try:
                    os.fsync(folder)
                finally:
                    os.close(folder)

    def removed(self) -> bool:
        """Return whether the file was deleted or replaced under us; what is written then is in nobody's folder."""
        try:
            there = self.path.stat()
        except OSError:
            return True
        here = os.fstat(self._descriptor)
        return (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)

    def restore(self) -> bool:
        """Write a deleted recording again from the still open file; never over another file."""
        return not self.path.exists() and self._copy(self.path, b"")

    def rescue(self, folders: Iterable[Path]) -> Path | None:
        """Write the whole recording, with what is in memory, to the first of other folders where that works.

        Return where it is now; None if nowhere.
        """
        for folder in folders:
            path = folder / f"{self.path.stem}-rescued-{os.getpid()}{self.path.suffix}"
            if self._copy(path, self._pending):
                return path
        return None

    def _copy(self, path: Path, more: bytes | bytearray) -> bool:
        """Write what is in the file, and more, to a new one; False, and nothing is left of it, where that fails."""
        try:
            with path.open("xb") as copy:
                os.lseek(self._descriptor, 0, os.SEEK_SET)
                while block := os.read(self._descriptor, 2**20):
                    copy.write(block)
                copy.write(more)
        except FileExistsError:
            return False
        except OSError:
            with contextlib.suppress(OSError):
                path.unlink()
            return False
        finally:
            os.lseek(self._descriptor, self._position, os.SEEK_SET)
        return True

    def close(self) -> None:
        """Flush and close; what cannot be written stays in :attr:`pending`."""
        if self.closed:
            return
        self.flush_pending()
        if self._syncing is not None:
            self._syncing.join(SYNC_WAIT_S)
        if self._start_sync() and self._syncing is not None:  # the last bytes: the system would keep them for a while
            self._syncing.join(SYNC_WAIT_S)
        os.close(self._descriptor)
        self.closed = True


def _sentence(error: OSError) -> str:
    if error.errno in {errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)}:
        return "the disk is full"
    return f"the file cannot be written ({(error.strerror or str(error)).lower()})"
