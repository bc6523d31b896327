"""CRC-32 of many short byte strings at once: what makes a recording of short reads quick to check.

zlib has the fastest CRC of one long string; of a million short ones the calls are what costs. Here the strings are laid
out as rows that end together, and each column of four bytes is one step of all checksums. A row is longer than its
string by zeros in front, which leave a register of zero as it is; so strings of different lengths take the same steps.
"""

from __future__ import annotations

import zlib
from functools import cache

import numpy as np
import numpy.typing as npt

from firmware_protocol.serial.overlapping import overlapping

ByteArray = npt.NDArray[np.uint8]
IntArray = npt.NDArray[np.int64]
VoidArray = npt.NDArray[np.void]
CrcArray = npt.NDArray[np.uint32]

POLYNOMIAL = 0xEDB88320
"""Of CRC-32 as zlib has it, reflected."""
LONGEST = 256
"""Longer rows are for zlib, one by one: it is faster then. Measured."""
FEWEST = 256
"""And so are up to so many rows."""
ONES = 0xFFFFFFFF
"""What the register begins with. The first bytes exclusive-or these have the same effect on one of zero."""
STEP = 16
"""Rows are a multiple of so many bytes."""
_BLOCK = 4096  # rows at a time: registers and columns stay in the cache


def checksums(prefixes: ByteArray, data: memoryview, starts: IntArray, ends: IntArray) -> CrcArray:
    """CRC-32 of each prefix with the bytes that follow it, as ``zlib.crc32`` gives it.

    Parameters
    ----------
    prefixes : (n, k) uint8
        What each string begins with, k >= 4.
    data : memoryview
        Where the rest of each lies.
    starts, ends : (n,) int64
        Places of the rest in ``data``.

    Returns
    -------
    (n,) uint32
    """
    out = np.empty(len(starts), np.uint32)
    n_steps = (ends - starts + (prefixes.shape[1] + STEP - 1)) // STEP
    n_steps[(n_steps * STEP > LONGEST) | (n_steps * STEP > ends)] = 0
    counts = np.bincount(n_steps, minlength=1)
    alone = counts <= FEWEST
    alone[0] = True
    inverted = prefixes.copy()
    np.ndarray(len(prefixes), "<u4", inverted, strides=inverted.strides[:1])[:] ^= ONES
    heads = inverted.view(f"V{inverted.shape[1]}")[:, 0]
    for number in np.flatnonzero(~alone).tolist():
        chosen = np.flatnonzero(n_steps == number)
        for first in range(0, len(chosen), _BLOCK):
            part = slice(first, first + _BLOCK)
            block = part if len(chosen) == len(starts) else chosen[part]
            out[block] = _block_checksums(heads[block], data, starts[block], ends[block], number * STEP)
    rest = np.flatnonzero(alone[n_steps])
    if len(rest):
        heads = prefixes[rest].view(heads.dtype)[:, 0]
        places = zip(heads.tolist(), starts[rest].tolist(), ends[rest].tolist(), strict=True)
        out[rest] = [zlib.crc32(data[start:end], zlib.crc32(head)) for head, start, end in places]
    return out


@cache
def _tables() -> tuple[CrcArray, CrcArray]:
    """Register after two more bytes, by its low half exclusive-or these; and after two of zero behind them."""
    table = np.zeros(1 << 16, dtype=np.uint32)
    step = POLYNOMIAL
    for bit in reversed(range(16)):  # the higher a bit, the later it counts; the effects of bits add up
        table[1 << bit :: 2 << bit] = table[:: 2 << bit] ^ np.uint32(step)
        step = step >> 1 ^ (POLYNOMIAL if step & 1 else 0)
    return table, table[table & 0xFFFF] ^ table >> 16


@cache
def _masks() -> npt.NDArray[np.uint64]:
    """Masks (STEP / 8, STEP) for the first bytes of a row, by how many of them are to be zero."""
    kept = np.arange(STEP) >= np.arange(STEP)[:, None]
    return np.ascontiguousarray((kept * np.uint8(0xFF)).view(np.uint64).T)


def _block_checksums(heads: VoidArray, data: memoryview, starts: IntArray, ends: IntArray, width: int) -> CrcArray:
    n, k = len(heads), heads.itemsize
    rows = overlapping(data, width)[ends - width].view(np.uint8)
    n_before = width - k - (ends - starts)
    for column, masks in enumerate(_masks()):
        rows.view(np.uint64)[column :: width // 8] &= masks[n_before]
    overlapping(rows.data, k)[np.arange(0, n * width, width) + n_before] = heads

    columns = np.ascontiguousarray(rows.view("<u4").reshape(n, -1).T)
    after_two, after_four = _tables()
    crc = np.zeros(n, dtype="<u4")
    low, high = crc.view("<u2")[::2], crc.view("<u2")[1::2]
    place, changed = np.empty(n, dtype=np.intp), np.empty(n, dtype=np.uint32)
    for column in columns:
        np.bitwise_xor(crc, column, out=crc)
        np.copyto(place, low)
        after_four.take(place, out=changed, mode="clip")  # in range anyhow; "raise" would copy
        np.copyto(place, high)
        after_two.take(place, out=crc, mode="clip")
        np.bitwise_xor(crc, changed, out=crc)
    return np.invert(crc)
