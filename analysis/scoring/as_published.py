"""The benchmark authors' own figures for their recordings, so that old papers can be reconciled with θ̄.

Their scripts do not take the card's quaternion average but ‖mean of the differences of the Euler angles at successive
end points‖, and never clear the array of differences between motions: a motion with fewer cycles than an earlier one is
averaged with the rows that the earlier one left behind. Four of their nineteen published figures carry that fault
(−17 % … −55 %). The fault can be replayed only with the earlier recordings at hand, in the order of the script; the
mended figure needs nothing but the recording itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.geometry.euler_angles import to_euler_zyx
from analysis.series import FloatArray, SeriesError


@dataclass(frozen=True, eq=False)
class PublishedDrift:
    """Drift as the authors' scripts compute it. Degrees."""

    n_steps: int
    """Differences of the motion itself."""
    mended_deg: float
    """‖mean of the differences‖ of this motion alone: what the scripts meant to compute."""
    as_published_deg: float
    """The same with the rows that earlier motions left behind; equal to ``mended_deg`` where none did."""
    stale_of: tuple[int, ...]
    """How many rows each earlier motion left behind, in the order given. Without earlier motions, ``as_published_deg``
    holds only if no longer one came before."""
    differences_deg: FloatArray
    """(n−1, 3) differences of azimuth, elevation, roll."""

    @property
    def stale_rows(self) -> int:
        """How many rows were left behind by earlier motions."""
        return sum(self.stale_of)


def euler_differences_deg(quats_wxyz: npt.ArrayLike) -> FloatArray:
    """Differences of the Euler angles at successive end points, as the trackers report the angles.

    Both rigs report the same three angles: extrinsic x-y-z reversed is intrinsic z-y-x. They are not unwrapped, because
    the scripts do not.

    Parameters
    ----------
    quats_wxyz
        (n, 4) end points, n ≥ 2.

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
    """Reproduce the figure of the authors' scripts, with and without the fault.

    Parameters
    ----------
    quats_wxyz
        (n, 4) end points of the motion.
    preceding
        End points (m, 4) of the motions that the script worked through before, in its order.

    Returns
    -------
    PublishedDrift

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
    return PublishedDrift(
        n_steps=len(own),
        mended_deg=float(np.linalg.norm(own.mean(axis=0))),
        as_published_deg=float(np.linalg.norm(array.mean(axis=0))),
        stale_of=tuple(int(np.sum(owners == number)) for number in range(len(preceding))),
        differences_deg=own,
    )
