"""A file that is opened once for everything that reads it: the host's readers, and every format here."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Self, TextIO

HEAD_BYTES = 262_144
"""Read at once: enough to recognise any format, and for the first lines of any table."""


def plain(text: str, limit: int = 40) -> str:
    """Return the first ``limit`` characters of text from a file, without what could steer a terminal."""
    kept = "".join(c if c.isprintable() else "?" for c in text[: limit + 1])
    return kept[:limit] + "…" if len(kept) > limit else kept


class SourceFile:
    """An open file of a recording, or the folder of a ROS 2 bag; a context manager.

    The file is opened once and read from its start as often as needed. Readers in a process of their own
    (:mod:`analysis.formats.apart`) open it again by :attr:`path`.

    Parameters
    ----------
    path : Path
        Where it is.
    label : str, optional
        What a series read from it is called; the path by default.

    Raises
    ------
    OSError
        The file cannot be opened or read.
    """

    def __init__(self, path: Path, label: str = "") -> None:
        self.path = path
        self.label = label or str(path)
        self.name = plain(path.name, 80)
        """For messages."""
        self.file: BinaryIO = io.BytesIO() if path.is_dir() else path.open("rb")
        """From the start on after :meth:`rewound`; empty for a folder."""
        self.head = self.file.read(HEAD_BYTES)
        """What every format is recognised from."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    @property
    def n_bytes(self) -> int:
        """Size of the file, or of all files in the folder together."""
        if self.path.is_dir():
            return sum(place.stat().st_size for place in self.path.iterdir() if place.is_file())
        return os.fstat(self.file.fileno()).st_size

    def rewound(self) -> BinaryIO:
        """Return the open file, at its start."""
        self.file.seek(0)
        return self.file

    @contextmanager
    def text(self) -> Iterator[TextIO]:
        """Open the content as text from its start: UTF-8, what is not replaced; no byte order mark; any line ends."""
        wrapper = io.TextIOWrapper(self.rewound(), "utf-8-sig", "replace")
        try:
            yield wrapper
        finally:
            wrapper.detach()  # closing a wrapper, as its end of life does, would close the file
