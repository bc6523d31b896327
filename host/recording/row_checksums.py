"""CRC-32 of many byte strings of one length at once: what makes a recording of short reads quick to check.

zlib has the fastest CRC of one long string; of a million short ones the calls are what costs. Here the rows are laid
out as columns of two bytes, and each column is one step of all checksums together.
"""

from __future__ import annotations

import zlib
from functools import cache

import numpy as np
import numpy.typing as npt

ByteArray = npt.NDArray[np.uint8]
CrcArray = npt.NDArray[np.uint32]

POLYNOMIAL = 0xEDB88320
"""Of CRC-32 as zlib has it, reflected."""
LONGEST = 128
"""Of longer strings zlib itself is faster, one by one. Measured."""
FEWEST = 256
"""And up to so many strings."""
_BLOCK = 4096  # rows at a time: registers and columns stay in the cache


@cache
def _word_table() -> CrcArray:
    """Register after two more bytes, by its low half exclusive-or these bytes."""
    table = np.arange(1 << 16, dtype=np.uint32)
    for _ in range(16):
        table = np.where(table & 1, table >> 1 ^ POLYNOMIAL, table >> 1).astype(np.uint32)
    return table


def _byte_step(crc: CrcArray, column: ByteArray) -> CrcArray:
    # The table of bytes is within that of words: a byte shifted up by eight, after eight steps of zeros, is the byte.
    table = _word_table()[np.arange(256, dtype=np.uint16) << 8]
    stepped: CrcArray = table[(crc & 0xFF).astype(np.uint8) ^ column] ^ crc >> 8
    return stepped


def checksums(rows: ByteArray) -> CrcArray:
    """CRC-32 of each row, as ``zlib.crc32`` gives it.

    Parameters
    ----------
    rows : (n, length) uint8
        One string a row.

    Returns
    -------
    (n,) uint32
    """
    n, length = rows.shape
    if n <= FEWEST or length > LONGEST:
        data = memoryview(rows.tobytes())
        places = range(0, n * length, length) if length else [0] * n
        return np.array([zlib.crc32(data[at : at + length]) for at in places], dtype=np.uint32)
    out = np.empty(n, dtype=np.uint32)
    for start in range(0, n, _BLOCK):
        out[start : start + _BLOCK] = _block_checksums(rows[start : start + _BLOCK])
    return out


def _block_checksums(rows: ByteArray) -> CrcArray:
    n, length = rows.shape
    even = length - length % 2
    words = np.ascontiguousarray(np.ascontiguousarray(rows[:, :even]).view("<u2").T)
    crc = np.full(n, 0xFFFFFFFF, dtype="<u4")
    halves = crc.view("<u2")
    place, change = np.empty(n, dtype=np.intp), np.empty(n, dtype=np.uint32)
    table = _word_table()
    for column in words:
        np.bitwise_xor(halves[::2], column, out=place)
        np.right_shift(crc, 16, out=crc)
        table.take(place, out=change, mode="clip")  # in range anyhow; "raise" would copy
        np.bitwise_xor(crc, change, out=crc)
    if length % 2:
        crc = _byte_step(crc, rows[:, -1])
    inverted: CrcArray = np.invert(crc)
    return inverted
