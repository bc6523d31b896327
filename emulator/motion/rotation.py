"""Quaternion arithmetic for the virtual object: Hamilton, scalar first, shapes (..., 4); arrays broadcast.

The emulator has its own small copy on purpose: it is the truth that the analysis is tested against, so the two share no
code. Orientation ``q_wxyz`` maps body to world; a world-frame rotation multiplies from the left.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def multiply(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the Hamilton product left ⊗ right.

    Parameters
    ----------
    left, right : (..., 4)
        Quaternions, scalar first.

    Returns
    -------
    numpy.ndarray
        (..., 4).
    """
    a, b, c, d = left[..., 0], left[..., 1], left[..., 2], left[..., 3]
    e, f, g, h = right[..., 0], right[..., 1], right[..., 2], right[..., 3]
    return np.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ],
        axis=-1,
    )


def conjugate(quats: FloatArray) -> FloatArray:
    """Return the conjugates, which invert unit quaternions; (..., 4)."""
    inverse: FloatArray = quats * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def rotate(quats: FloatArray, vectors: FloatArray) -> FloatArray:
    """Rotate vectors: v' = q v q*.

    Parameters
    ----------
    quats : (..., 4)
        Unit quaternions, scalar first.
    vectors : (..., 3)
        To be rotated.

    Returns
    -------
    numpy.ndarray
        (..., 3).
    """
    scalar, vector = quats[..., :1], quats[..., 1:]
    twice = 2.0 * np.cross(vector, vectors)
    return vectors + scalar * twice + np.cross(vector, twice)


def from_rotation_vector(vectors_rad: FloatArray) -> FloatArray:
    """Return exp(v/2): the rotation about v by |v|.

    Parameters
    ----------
    vectors_rad : (..., 3)
        Rotation vectors, rad.

    Returns
    -------
    numpy.ndarray
        (..., 4) unit quaternions, scalar first.
    """
    half = 0.5 * np.asarray(vectors_rad, dtype=np.float64)
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle), half * np.sinc(angle / np.pi)], axis=-1)


def to_rotation_vector(quats: FloatArray) -> FloatArray:
    """Return the rotation vectors of unit quaternions, angle in [0, π] by 2·atan2(|v|, |w|).

    Parameters
    ----------
    quats : (..., 4)
        Unit quaternions, scalar first; the same for q and −q.

    Returns
    -------
    numpy.ndarray
        (..., 3) rad.
    """
    positive = np.where(quats[..., :1] < 0.0, -quats, quats)
    sine = np.linalg.norm(positive[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, positive[..., :1])
    scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
    vectors_rad: FloatArray = positive[..., 1:] * scale
    return vectors_rad
