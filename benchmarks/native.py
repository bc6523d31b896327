"""C code of the benchmarks: compiled once with ``gcc -O2``, called through ctypes."""

from __future__ import annotations

import ctypes
import hashlib
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

FOLDER = Path(__file__).parent
FLAGS = ("-O2", "-std=c11", "-Wall", "-Wextra", "-Werror")
COUNTERS = (
    "delimiters",
    "frames",
    "frame_bytes",
    "skipped_bytes",
    "pending_bytes",
    "cobs_errors",
    "crc_errors",
    "oversize",
    "partial_starts",
    "malformed",
    "samples",
)
"""Fields of ``counters_t`` before ``others``, in its order."""


class NoCompilerError(Exception):
    """There is no gcc on this machine."""


@dataclass(frozen=True, eq=False)
class NativeSamples:
    """What the C decoder made of a stream."""

    sequence: npt.NDArray[np.uint16]
    device_time_us: npt.NDArray[np.uint32]
    quats_wxyz: npt.NDArray[np.float64]
    flags: npt.NDArray[np.uint8]
    counters: dict[str, int]
    others: dict[int, int]


def build(source: str, shared: bool = True) -> Path:
    """Compile a C file of this folder, where that was not done before; return the library or the program.

    Raises
    ------
    NoCompilerError
        No gcc.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        raise NoCompilerError("there is no gcc")
    text = (FOLDER / source).read_bytes()
    digest = hashlib.sha256(text + repr(FLAGS).encode()).hexdigest()[:16]
    built = Path(tempfile.gettempdir()) / f"rotdrift-{Path(source).stem}-{digest}{'.so' if shared else ''}"
    if not built.exists():
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / built.name
            extra = ("-shared", "-fPIC") if shared else ()
            subprocess.run([gcc, *FLAGS, *extra, "-o", made, FOLDER / source, "-lm"], check=True)
            shutil.copy(made, built.with_suffix(f".{Path(folder).name}"))
            built.with_suffix(f".{Path(folder).name}").replace(built)  # whole or not at all, also when two build it
    return built


def compiler_version() -> str:
    """First line of ``gcc --version``."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return "no gcc"
    return subprocess.run([gcc, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]


@cache
def _library() -> ctypes.CDLL:
    library = ctypes.CDLL(str(build("native_decoder.c")))
    library.rd_decode.restype = ctypes.c_size_t
    library.rd_decode.argtypes = [ctypes.c_char_p, ctypes.c_size_t] + [ctypes.c_void_p] * 5
    library.rd_crc.restype = ctypes.c_uint16
    library.rd_crc.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
    library.rd_init()
    return library


def native_crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE by the C code."""
    return int(_library().rd_crc(data, len(data)))


def native_decode(data: bytes) -> NativeSamples:
    """Decode a whole stream with the C decoder.

    Raises
    ------
    NoCompilerError
        No gcc.
    """
    library = _library()
    room = len(data) // 20 + 1
    sequence = np.empty(room, np.uint16)
    times = np.empty(room, np.uint32)
    quats = np.empty((room, 4))
    flags = np.empty(room, np.uint8)
    counted = np.zeros(len(COUNTERS) + 256, np.uint64)
    arrays = (sequence, times, quats, flags, counted)
    n = library.rd_decode(data, len(data), *(array.ctypes.data for array in arrays))
    values = counted.tolist()
    others = {code: value for code, value in enumerate(values[len(COUNTERS) :]) if value}
    counters = dict(zip(COUNTERS, values, strict=False))
    return NativeSamples(sequence[:n], times[:n], quats[:n], flags[:n], counters, others)
