"""Quaternion arithmetic in numpy: unit, scalar first, ``(..., 4)``, Hamilton product.

An orientation maps body to world: v_W = q v_B q*. q and −q are the same rotation everywhere. Angles are radians in
[0, π]. Euler angles are in :mod:`analysis.geometry.euler_angles`. Scalar-last quaternions exist only in
:func:`to_xyzw` and :func:`from_xyzw`, the border to scipy and to file formats. Long arrays are worked through in
blocks that stay in the cache, which is where the speed comes from.

Source: J. Solà, "Quaternion kinematics for the error-state Kalman filter", arXiv:1711.02508 (Hamilton convention, exp,
log). Averages are in :mod:`analysis.geometry.averages`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_BLOCK = 4096  # rows per block: all scratch of one block fits the second-level cache
_COLUMN_BLOCK = 16384  # where scratch is one column only
_SIGN_BITS = np.tile(np.array([0, 1, 1, 1], dtype=np.uint64) << np.uint64(63), _BLOCK)
_SMALL = 1e-8  # below this |v|, the first term of the series is exact in double precision


def checked_quats(q: npt.ArrayLike) -> FloatArray:
    """Return quaternions as float64 (..., 4); raises ValueError for another last axis."""
    return _checked(q, "quaternions", 4)


def _checked(values: npt.ArrayLike, what: str, width: int) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != width:
        raise ValueError(f"{what} need a last axis of {width}, got shape {array.shape}")
    return array


def _blocks(n: int, length: int = _BLOCK) -> Iterator[slice]:
    return (slice(start, min(start + length, n)) for start in range(0, n, length))


def _flat(a: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Broadcast to ``shape`` as contiguous rows; one shared row stays one row of stride 0."""
    if a.size == a.shape[-1] and len(shape) > 1:
        return np.broadcast_to(np.ascontiguousarray(a).reshape(1, -1), (int(np.prod(shape[:-1])), shape[-1]))
    return np.ascontiguousarray(np.broadcast_to(a, shape)).reshape(-1, shape[-1])


def multiply(p: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray:
    """Return the Hamilton product p ⊗ q: first q, then p, for body-to-world orientations.

    Parameters
    ----------
    p, q : array_like
        (..., 4) scalar first; broadcast against each other.

    Returns
    -------
    (..., 4) product; unit where both are.
    """
    left, right = checked_quats(p), checked_quats(q)
    shape = np.broadcast_shapes(left.shape, right.shape)
    # q = (w + x i) + (y + z i) j, so four complex products do the work of sixteen real ones.
    a, b = _flat(left, shape).view(np.complex128).T
    c, d = _flat(right, shape).view(np.complex128).T
    out = np.empty(shape)
    flat = out.reshape(-1, 4).view(np.complex128)
    for rows in _blocks(len(flat)):
        flat[rows, 0] = a[rows] * c[rows] - b[rows] * d[rows].conj()
        flat[rows, 1] = a[rows] * d[rows] + b[rows] * c[rows].conj()
    return out


def conjugate(q: npt.ArrayLike) -> FloatArray:
    """Return q* (..., 4), the inverse of unit quaternions (..., 4)."""
    quats = checked_quats(q)
    if quats.size < 4 * _BLOCK or not quats.flags.c_contiguous:
        out = np.negative(quats)
        out[..., 0] = quats[..., 0]
        return out
    # One pass over the memory, which is all the time it takes: turning signs round costs less than multiplying.
    out = np.empty(quats.shape)
    rows, result = quats.reshape(-1).view(np.uint64), out.reshape(-1).view(np.uint64)
    for part in _blocks(len(rows), 4 * _BLOCK):
        np.bitwise_xor(rows[part], _SIGN_BITS[: part.stop - part.start], out=result[part])
    return out


def difference(later: npt.ArrayLike, earlier: npt.ArrayLike) -> FloatArray:
    """Return the left difference r = q_later ⊗ q_earlier⁻¹ (..., 4) of orientations (..., 4); card step 2.

    It is the rotation, in world axes, that turns ``earlier`` into ``later``.
    """
    return multiply(later, conjugate(earlier))


def angle(q: npt.ArrayLike) -> FloatArray:
    """Return the rotation angle 2·atan2(|v|, |w|) in rad, in [0, π].

    acos(|w|) would be 0 below 1e-6 degrees; this keeps full relative precision at every angle.

    Parameters
    ----------
    q : array_like
        (..., 4) scalar first; the norm cancels.

    Returns
    -------
    (...) rad.
    """
    quats = checked_quats(q)
    rows = quats.reshape(-1, 4)
    out = np.empty(len(rows))
    scratch = np.empty(min(len(rows), _COLUMN_BLOCK))
    for part in _blocks(len(rows), _COLUMN_BLOCK):
        block, norm = rows[part], out[part]
        other = scratch[: len(norm)]
        np.square(block[:, 1], out=norm)
        np.add(norm, np.square(block[:, 2], out=other), out=norm)
        np.add(norm, np.square(block[:, 3], out=other), out=norm)
        np.sqrt(norm, out=norm)
        np.arctan2(norm, np.abs(block[:, 0], out=other), out=norm)
        np.multiply(norm, 2.0, out=norm)
    return out.reshape(quats.shape[:-1])


def distance(p: npt.ArrayLike, q: npt.ArrayLike) -> FloatArray:
    """Return the angle (...) of the rotation between orientations (..., 4), rad, in [0, π].

    It is the same for left and right differences.
    """
    return angle(difference(p, q))


def log(q: npt.ArrayLike) -> FloatArray:
    """Return the rotation vector (axis times angle) of q, by the shorter way round.

    Parameters
    ----------
    q : array_like
        (..., 4) unit, scalar first; q and −q give the same vector (at exactly π either sign of the axis is right).

    Returns
    -------
    (..., 3) rad, length in [0, π].
    """
    quats = checked_quats(q)
    rows = np.ascontiguousarray(quats).reshape(-1, 4)
    out = np.empty((len(rows), 3))
    for part in _blocks(len(rows)):
        columns = rows[part].T.copy(order="C")  # worked on in place: never the caller's own memory
        w, vector = columns[0], columns[1:]
        norm = np.sqrt(np.einsum("ij,ij->j", vector, vector))
        small = norm < _SMALL
        factor = 2.0 * np.arctan2(norm, np.abs(w))
        if small.any():  # at rest, or exactly the identity
            norm[small], factor[small] = 1.0, 2.0
        factor /= norm
        np.copysign(factor, w, out=factor)
        np.multiply(vector, factor, out=vector)
        out[part] = vector.T
    return out.reshape(*quats.shape[:-1], 3)


def exp(rotvec: npt.ArrayLike) -> FloatArray:
    """Turn a rotation vector into a unit quaternion; the inverse of :func:`log`.

    Parameters
    ----------
    rotvec : array_like
        (..., 3) axis times angle, rad; any length.

    Returns
    -------
    (..., 4) unit, scalar first.
    """
    vectors = _checked(rotvec, "vectors", 3)
    rows = np.ascontiguousarray(vectors).reshape(-1, 3)
    out = np.empty((len(rows), 4))
    for part in _blocks(len(rows)):
        vector = rows[part]
        half = 0.5 * row_lengths(vector)
        small = half < _SMALL
        out[part, 0] = np.cos(half)
        factor = np.sin(half)
        if small.any():
            half[small], factor[small] = 1.0, 1.0
        out[part, 1:] = vector * (0.5 * factor / half)[:, None]
    return out.reshape(*vectors.shape[:-1], 4)


def rotate(q: npt.ArrayLike, vector: npt.ArrayLike) -> FloatArray:
    """Return v_W = q v_B q*: body coordinates to world coordinates.

    Parameters
    ----------
    q : array_like
        (..., 4) unit, scalar first.
    vector : array_like
        (..., 3); broadcast against ``q``.

    Returns
    -------
    (..., 3) in the unit of ``vector``.
    """
    quats, vectors = checked_quats(q), _checked(vector, "vectors", 3)
    w, v = quats[..., :1], quats[..., 1:]
    twice = 2.0 * np.cross(v, vectors)
    return np.asarray(vectors + w * twice + np.cross(v, twice), dtype=np.float64)


def continuous_signs(quats_wxyz: npt.ArrayLike) -> FloatArray:
    """Choose q or −q in each of n rows (n, 4), so that neighbours are on the same side of the 3-sphere.

    The first row is unchanged.
    """
    quats = checked_quats(quats_wxyz)
    if len(quats) < 2:
        return quats.copy()
    flips = np.einsum("ij,ij->i", quats[1:], quats[:-1]) < 0.0
    odd = np.concatenate(([False], np.logical_xor.accumulate(flips)))
    return np.where(odd[:, None], -quats, quats)


def row_lengths(vectors: FloatArray) -> FloatArray:
    """Return lengths (n,) of n vectors (n, k): numpy's own norm takes several times as long over short rows."""
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def slerp(start: npt.ArrayLike, end: npt.ArrayLike, fraction: npt.ArrayLike) -> FloatArray:
    """Return the orientation a fraction of the shorter way from ``start`` to ``end``, at constant rate of turn.

    Parameters
    ----------
    start, end : array_like
        (..., 4) unit, scalar first.
    fraction : array_like
        (...) 0 gives ``start``, 1 gives ``end``.

    Returns
    -------
    (..., 4) unit.
    """
    part = np.asarray(fraction, dtype=np.float64)[..., None]
    return multiply(exp(part * log(difference(end, start))), start)


def to_xyzw(q_wxyz: npt.ArrayLike) -> FloatArray:
    """Return scalar-first quaternions (..., 4) as scalar-last ones, for scipy and for file formats."""
    return np.ascontiguousarray(checked_quats(q_wxyz)[..., [1, 2, 3, 0]])


def from_xyzw(q_xyzw: npt.ArrayLike) -> FloatArray:
    """Return scalar-last quaternions (..., 4), as scipy and many file formats have them, as scalar-first ones."""
    return np.ascontiguousarray(checked_quats(q_xyzw)[..., [3, 0, 1, 2]])
