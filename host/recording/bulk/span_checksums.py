"""CRC-32 of many spans of a block that overlap as they like, each byte of the block checksummed once.

A damaged file can claim a long message at every few bytes; a checksum of each from its first byte to its last would
take time with the square of the file. But CRC-32 is linear: with the checksum P(a) of all bytes in front of a place a,
that of the n bytes from a to b is P(b) ^ P(a) · x^(8n), polynomials modulo CRC-32's own. One pass over the block gives
every P, a table every power of x, and a product costs the same for any length.
"""

from __future__ import annotations

import zlib
from functools import cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from host.recording.bulk.row_checksums import POLYNOMIAL

IntArray = npt.NDArray[np.int64]
CrcArray = npt.NDArray[np.uint32]

_ONE = 1 << 31
"""The polynomial 1: bits are reflected, the highest is the coefficient of x^0."""
_X_TO_8 = _ONE >> 8


def span_checksums(data: memoryview, starts: IntArray, ends: IntArray, seeds: CrcArray) -> CrcArray:
    """Return ``zlib.crc32(data[start:end], seed)`` of n spans.

    Parameters
    ----------
    data : memoryview
        The block.
    starts, ends : (n,) int64
        Where in it each span starts and ends.
    seeds : (n,) uint32
        Checksum of what stands in front of each span.

    Returns
    -------
    (n,) uint32
    """
    if not len(starts):
        return np.empty(0, np.uint32)
    places, index = np.unique(np.concatenate((starts, ends)), return_inverse=True)
    crc, crcs = 0, [0]
    for start, end in pairwise(places.tolist()):
        crc = zlib.crc32(data[start:end], crc)
        crcs.append(crc)
    prefixes: CrcArray = np.array(crcs, np.uint32).take(index.ravel())
    before, behind = prefixes[: len(starts)], prefixes[len(starts) :]
    sizes = ends - starts
    return behind ^ _product(before ^ seeds, _powers(int(sizes.max()).bit_length()).take(sizes))


def _product(a: CrcArray, b: CrcArray) -> CrcArray:
    """Return the products of polynomials modulo that of CRC-32, as zlib's ``crc32_combine`` makes them."""
    product = np.zeros(len(a), np.uint32)
    for bit in reversed(range(32)):
        product ^= b * (a >> np.uint32(bit) & np.uint32(1))
        b = b >> np.uint32(1) ^ (b & np.uint32(1)) * np.uint32(POLYNOMIAL)
    return product


@cache
def _powers(n_bits: int) -> CrcArray:
    """Return x^(8n) for every n of so many bits, the table of half its length shifted behind itself again and again."""
    powers, step = np.array([_ONE], np.uint32), np.array([_X_TO_8], np.uint32)
    for _ in range(n_bits):
        powers = np.concatenate((powers, _product(powers, np.broadcast_to(step, powers.shape))))
        step = _product(step, step)
    return powers
