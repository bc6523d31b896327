"""Reads one BLF in a process of its own, with limits, and writes its frames to standard output.

Started by :mod:`host.links.can.logs`. A file that makes the reader loop or ask for memory without end ends this
process and nothing else.
"""

from __future__ import annotations

import sys
from pathlib import Path

import can

from host.links.can.logs import write_chunks

BASE_BYTES = 1 << 30
"""Address space of the interpreter and its libraries."""
BYTES_PER_FILE_BYTE = 50
LEAST_CPU_S = 20
CPU_S_PER_MB = 20


def limit(file_bytes: int) -> None:
    """Limit memory and processor time, where the system can."""
    try:
        import resource
    except ImportError:  # Windows: the parent's time limit remains
        return
    memory = BASE_BYTES + BYTES_PER_FILE_BYTE * file_bytes
    seconds = LEAST_CPU_S + CPU_S_PER_MB * file_bytes // 1_000_000
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))


def main(path: Path) -> int:
    """Read the file; return 0 where it was sound to its end."""
    size = path.stat().st_size
    limit(size)
    try:
        with can.BLFReader(path) as reader:
            write_chunks(reader, sys.stdout.buffer)
            whole = reader.file_size
    except Exception as error:  # noqa: BLE001 - a damaged file makes it raise anything
        sys.stdout.buffer.flush()
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        return 1
    if size < whole:  # to the library, the end of the file is the end of the log
        sys.stderr.write(f"it is cut: {size} of {whole} bytes are there\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
