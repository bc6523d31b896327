"""Unit quaternions to and from their two wire forms, with the error each form can make.

*Q15*: four int16, each component times 32767. Used by ORIENTATION.

*Smallest three*: 56 bits. The component of largest magnitude is left out (its index has 2 bits; its sign is made
positive, which q ≡ −q allows); the other three lie in ±1/√2 and have 18 bits each. Used where a sample must fit one
classic CAN frame.

Decoded quaternions are scaled to unit norm in float64. Scalar and batch functions agree to the last bit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from firmware_protocol.errors import MalformedPacketError, PacketValueError

FloatArray = npt.NDArray[np.float64]
Quaternion = tuple[float, float, float, float]

NORM_TOLERANCE = 1e-2
"""A quaternion whose norm is further from 1 than this is refused, not silently normalised."""

Q15_SCALE = 32767
Q15_MAX_ERROR_RAD = 2.0 / Q15_SCALE
"""Largest rotation angle between a unit quaternion and what Q15 makes of it.

Each component is off by at most half a step, so the four-vector by at most one step (√4 / 2); the rotation angle is
twice the angle between the four-vectors. 6.1037e-5 rad = 0.003497°.
"""
Q15_MAX_ERROR_DEG = math.degrees(Q15_MAX_ERROR_RAD)

SMALLEST_THREE_BITS = 18
SMALLEST_THREE_OFFSET = 1 << (SMALLEST_THREE_BITS - 1)
SMALLEST_THREE_SCALE = (SMALLEST_THREE_OFFSET - 1) * math.sqrt(2.0)
"""A code is ``SMALLEST_THREE_OFFSET + round(component * SMALLEST_THREE_SCALE)``: zero is exact, code 0 never sent."""
SMALLEST_THREE_MAX_ERROR_RAD = 2.02 / SMALLEST_THREE_SCALE
"""Largest rotation angle of what :func:`quats_to_smallest_three` makes: 1.0897e-5 rad = 0.00063°.

An error δ of the three sent components v moves the fourth, a, by −v·δ/a: the four-vector is off by
√(δᵀ(I + vvᵀ/a²)δ). The encoder picks the best of the eight neighbouring code triples, which keeps this within one
step for every v with |v_i| ≤ a (found by search; at v = (a, a, a) it is the covering radius of the face-centred cubic
lattice). The angle is twice that; 1 % is left for curvature.
"""
SMALLEST_THREE_MAX_ERROR_DEG = math.degrees(SMALLEST_THREE_MAX_ERROR_RAD)
SMALLEST_THREE_PLAIN_MAX_ERROR_RAD = 2.0 * math.sqrt(3.0) * 1.01 / SMALLEST_THREE_SCALE
"""The same bound for an encoder that rounds each component by itself, as simple firmware does: 0.0011°."""
SMALLEST_THREE_PLAIN_MAX_ERROR_DEG = math.degrees(SMALLEST_THREE_PLAIN_MAX_ERROR_RAD)

# Norms are judged on the integers, where the sum of squares is exact: scalar, batch and firmware agree on every sample.
Q15_MIN_SQUARE = math.ceil(((1.0 - NORM_TOLERANCE) * Q15_SCALE) ** 2)
Q15_MAX_SQUARE = math.floor(((1.0 + NORM_TOLERANCE) * Q15_SCALE) ** 2)

_CODE_MASK = (1 << SMALLEST_THREE_BITS) - 1
# The component left out is the largest, so it is at least 1/2 and the other three have squares of at most 3/4 together.
_MAX_THREE_SQUARE = 0.7501
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
_CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))


def _unit(q_wxyz: Sequence[float]) -> Quaternion:
    if len(q_wxyz) != 4:
        raise PacketValueError(f"a quaternion has 4 components, not {len(q_wxyz)}")
    w, x, y, z = (float(component) for component in q_wxyz)
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(norm - 1.0) <= NORM_TOLERANCE:  # also true for NaN
        raise PacketValueError(f"quaternion norm {norm:.6g} is not 1 within {NORM_TOLERANCE}")
    return w / norm, x / norm, y / norm, z / norm


def _units(quats_wxyz: npt.ArrayLike) -> FloatArray:
    quats = np.asarray(quats_wxyz, dtype=np.float64)
    if quats.ndim != 2 or quats.shape[1] != 4:
        raise PacketValueError(f"quaternions must have shape (n, 4), not {quats.shape}")
    w, x, y, z = quats.T
    norms = np.sqrt(w * w + x * x + y * y + z * z)
    bad = ~(np.abs(norms - 1.0) <= NORM_TOLERANCE)
    if bad.any():
        first = int(np.argmax(bad))
        raise PacketValueError(f"quaternion {first}: norm {norms[first]:.6g} is not 1 within {NORM_TOLERANCE}")
    units: FloatArray = quats / norms[:, None]
    return units


def quat_to_q15(q_wxyz: Sequence[float]) -> tuple[int, int, int, int]:
    """Quantise one unit quaternion to four int16.

    Raises
    ------
    PacketValueError
        The norm is off by more than ``NORM_TOLERANCE``.
    """
    w, x, y, z = _unit(q_wxyz)
    return round(w * Q15_SCALE), round(x * Q15_SCALE), round(y * Q15_SCALE), round(z * Q15_SCALE)


def quats_to_q15(quats_wxyz: npt.ArrayLike) -> npt.NDArray[np.int16]:
    """Quantise quaternions (n, 4) to int16 (n, 4); see :func:`quat_to_q15`."""
    return np.rint(_units(quats_wxyz) * Q15_SCALE).astype(np.int16)


def quat_from_q15(w: int, x: int, y: int, z: int) -> Quaternion:
    """Return the unit quaternion of four int16.

    Raises
    ------
    MalformedPacketError
        The norm is off by more than ``NORM_TOLERANCE``.
    """
    square = w * w + x * x + y * y + z * z
    if not Q15_MIN_SQUARE <= square <= Q15_MAX_SQUARE:
        raise MalformedPacketError(f"quaternion norm {math.sqrt(square) / Q15_SCALE:.6g} is not 1")
    scale = 1.0 / math.sqrt(square)
    return w * scale, x * scale, y * scale, z * scale


def quats_from_q15(codes: npt.NDArray[np.int16]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return the unit quaternions of int16 (n, 4).

    Returns
    -------
    quats_wxyz : (n, 4) float64
        Unit quaternions; rows that are not ``valid`` hold no meaning.
    valid : (n,) bool
        False where the norm is off by more than ``NORM_TOLERANCE``.
    """
    values = codes.astype(np.float64)
    square = np.einsum("ij,ij->i", values, values)  # exact: integers below 2**33
    valid = (square >= Q15_MIN_SQUARE) & (square <= Q15_MAX_SQUARE)
    scale = 1.0 / np.sqrt(np.where(valid, square, 1.0))
    return values * scale[:, None], valid


def quats_to_smallest_three(quats_wxyz: npt.ArrayLike) -> npt.NDArray[np.uint64]:
    """Quantise quaternions (n, 4) to 56-bit codes (n,): index in bits 54-55, then 18 bits each, component order kept.

    Of the eight code triples around the exact one, the one whose quaternion is nearest is sent (error bound
    ``SMALLEST_THREE_MAX_ERROR_RAD``).

    Raises
    ------
    PacketValueError
        A norm is off by more than ``NORM_TOLERANCE``.
    """
    quats = _units(quats_wxyz)
    rows = np.arange(len(quats))
    index = np.argmax(np.abs(quats), axis=1)
    largest = quats[rows, index]
    three = quats[rows[:, None], _OTHERS[index]] * np.where(largest < 0.0, -1.0, 1.0)[:, None]
    steps = three * SMALLEST_THREE_SCALE
    low = np.floor(steps)
    tangent = three / np.abs(largest)[:, None]
    best = low
    best_cost = np.full(len(quats), np.inf)
    for corner in _CORNERS:
        candidate = low + corner
        error = candidate - steps
        cost = (error * error).sum(axis=1) + (tangent * error).sum(axis=1) ** 2
        better = (cost < best_cost) & (np.abs(candidate) < SMALLEST_THREE_OFFSET).all(axis=1)
        best = np.where(better[:, None], candidate, best)
        best_cost = np.where(better, cost, best_cost)
    codes = (best.astype(np.int64) + SMALLEST_THREE_OFFSET).astype(np.uint64)
    bits = np.uint64(SMALLEST_THREE_BITS)
    packed: npt.NDArray[np.uint64] = index.astype(np.uint64)
    for k in range(3):
        packed = (packed << bits) | codes[:, k]
    return packed


def quats_from_smallest_three(codes: npt.NDArray[np.uint64]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return the unit quaternions of 56-bit codes (n,); the component left out comes back positive.

    Returns
    -------
    quats_wxyz : (n, 4) float64
        Unit quaternions; rows that are not ``valid`` hold no meaning.
    valid : (n,) bool
        False where no quaternion has this code.
    """
    mask = np.uint64(_CODE_MASK)
    shifts = np.array([2, 1, 0], dtype=np.uint64) * np.uint64(SMALLEST_THREE_BITS)
    three_codes = ((codes[:, None] >> shifts) & mask).astype(np.int64) - SMALLEST_THREE_OFFSET
    three = three_codes / SMALLEST_THREE_SCALE
    square = (three * three).sum(axis=1)
    valid = (square <= _MAX_THREE_SQUARE) & (three_codes > -SMALLEST_THREE_OFFSET).all(axis=1)
    index = (codes >> np.uint64(3 * SMALLEST_THREE_BITS)).astype(np.int64)
    rows = np.arange(len(codes))
    quats = np.empty((len(codes), 4))
    quats[rows[:, None], _OTHERS[index]] = three
    quats[rows, index] = np.sqrt(np.maximum(1.0 - square, 0.0))
    return quats, valid
