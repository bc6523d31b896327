"""Euler angles to and from quaternions; never without their order and intrinsic or extrinsic.

Extrinsic x-y-z with angles (a, b, c) is the same rotation as intrinsic z-y-x with (c, b, a).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from analysis.geometry.rotations import FloatArray, multiply

_AXES = {"x": 1, "y": 2, "z": 3}
_POLE = 1e-8  # cosine of an elevation too near to ±π/2 for azimuth and roll to be told apart


def is_order(axes: str) -> bool:
    """Return whether letters are an order of Euler angles: three of x, y, z, neighbours different."""
    return len(axes) == 3 and set(axes) <= set("xyz") and axes[0] != axes[1] != axes[2]


def from_euler(angles_rad: npt.ArrayLike, order: str, *, intrinsic: bool) -> FloatArray:
    """Turn Euler angles into unit quaternions.

    Parameters
    ----------
    angles_rad : array_like
        (..., 3) rad, in the order of ``order``.
    order : str
        E.g. ``"zyx"``; see :func:`is_order`.
    intrinsic : bool
        True: about the axes of the turning body (written Z-Y'-X''); false: about the fixed axes.

    Returns
    -------
    (..., 4) unit, scalar first.

    Raises
    ------
    ValueError
        An order that is not one.
    """
    if not is_order(order):
        raise ValueError(f"Euler order {order!r} is not three axes like 'xyz' or 'zxz'")
    half = 0.5 * np.asarray(angles_rad, dtype=np.float64)
    result = np.array([1.0, 0.0, 0.0, 0.0])
    for position, axis in enumerate(order):
        turn = np.zeros((*half.shape[:-1], 4))
        turn[..., 0] = np.cos(half[..., position])
        turn[..., _AXES[axis]] = np.sin(half[..., position])
        result = multiply(result, turn) if intrinsic else multiply(turn, result)
    return result


def to_euler_zyx(q: npt.ArrayLike) -> FloatArray:
    """Return intrinsic z-y-x angles (azimuth, elevation, roll); reversed, they are the extrinsic x-y-z angles.

    Parameters
    ----------
    q : array_like
        (..., 4) unit, scalar first.

    Returns
    -------
    (..., 3) rad; azimuth and roll in (−π, π], elevation in [−π/2, π/2]. At ±π/2, where only azimuth ∓ roll
    is defined, roll is 0.
    """
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    across, along = 2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)
    cosine, sine = np.hypot(across, along), 2.0 * (w * y - z * x)
    pole = cosine < _POLE  # nothing but rounding is left of across and along
    azimuth = np.where(pole, -np.sign(sine) * 2.0 * np.arctan2(x, w), np.arctan2(across, along))
    azimuth = np.arctan2(np.sin(azimuth), np.cos(azimuth))
    elevation = np.arctan2(sine, cosine)
    roll = np.where(pole, 0.0, np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    return np.stack((azimuth, elevation, roll), axis=-1)
