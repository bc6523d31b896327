"""The benchmark authors' own figures for their recordings, so that old papers can be reconciled with θ̄.

Their scripts do not use the card's quaternion average but ‖mean of the differences of the Euler angles at successive
end points‖, and never clear the array of differences between motions: a motion with fewer cycles than an earlier one is
averaged with the rows that the earlier one left behind. Four of their nineteen published figures carry that fault
(−17 % … −55 %). The fault can be replayed only with the earlier recordings at hand, in the order of the script; the
corrected figure needs nothing but the recording itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from analysis.geometry.euler_angles import to_euler_zyx
from analysis.scoring.result_parts import PublishedDrift
from analysis.series import FloatArray, SeriesError


def euler_differences_deg(quats_wxyz: npt.ArrayLike) -> FloatArray:
    """Return the differences of the Euler angles at successive end points, as the trackers report the angles.

    Both rigs report the same three angles: extrinsic x-y-z reversed is intrinsic z-y-x. They are not unwrapped, because
    the scripts do not.

    Parameters
    ----------
    quats_wxyz : (n, 4) array_like
        End points, n ≥ 2.

    Returns
    -------
    (n−1, 3) deg, azimuth, elevation, roll.

    Raises
    ------
    SeriesError
        Fewer than 2 end points.
    """
    quats = np.asarray(quats_wxyz, dtype=np.float64)
    if quats.ndim != 2 or len(quats) < 2:
        raise SeriesError(f"the published figure needs at least 2 end points, got shape {quats.shape}")
    return np.diff(np.degrees(to_euler_zyx(quats)), axis=0)


def published_drift(quats_wxyz: npt.ArrayLike, preceding: Sequence[npt.ArrayLike] = ()) -> PublishedDrift:
    """Return the figure of the authors' scripts, with and without the fault.

    Parameters
    ----------
    quats_wxyz : (n, 4) array_like
        End points of the motion.
    preceding : sequence of array_like, optional
        End points (m, 4) of the motions that the script worked through before, in its order.

    Raises
    ------
    SeriesError
        Fewer than 2 end points in any of them.
    """
    own = euler_differences_deg(quats_wxyz)
    array, owners = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    for number, rows in enumerate((*(euler_differences_deg(quats) for quats in preceding), own)):
        array = np.concatenate((rows, array[len(rows) :]))
        owners = np.concatenate((np.full(len(rows), number), owners[len(rows) :]))
    stale_of = tuple(int(np.sum(owners == number)) for number in range(len(preceding)))
    return PublishedDrift(
        euler_drift_deg=float(np.linalg.norm(own.mean(axis=0))),
        euler_drift_as_published_deg=float(np.linalg.norm(array.mean(axis=0))),
        stale_rows=sum(stale_of),
        stale_of=stale_of,
        preceding=len(preceding),
        n_steps=len(own),
    )
