"""Averages of rotations: the eigenvector of Σ wᵢ qᵢ qᵢᵀ, in which q and −q are the same.

Source: F. L. Markley et al., "Averaging quaternions", J. Guid. Control Dyn. 30(4), 2007; step 3 of the card.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from analysis.geometry import rotations
from analysis.geometry.rotations import FloatArray


def average(quats_wxyz: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> FloatArray:
    """Return the eigenvector of M = Σ wᵢ qᵢ qᵢᵀ with the largest eigenvalue; card step 3.

    Parameters
    ----------
    quats_wxyz : array_like
        (n, 4) unit, n ≥ 1; signs do not matter.
    weights : array_like, optional
        (n,) ≥ 0, default all 1.

    Returns
    -------
    (4,) unit, scalar part ≥ 0.

    Raises
    ------
    ValueError
        No quaternions.
    """
    return average_and_share(quats_wxyz, weights)[0]


def average_and_share(quats_wxyz: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> tuple[FloatArray, float]:
    """Return :func:`average`, and the largest eigenvalue as a share of the sum of all four.

    The share is 1 when all rotations agree and falls as they scatter; it is the mean cos² of half the angles to the
    average, so 0.98 is a scatter of 16 degrees.

    Parameters
    ----------
    quats_wxyz : array_like
        (n, 4) unit, n ≥ 1; signs do not matter.
    weights : array_like, optional
        (n,) ≥ 0, default all 1.

    Returns
    -------
    average
        (4,) unit, scalar part ≥ 0.
    share
        In [0.25, 1].

    Raises
    ------
    ValueError
        No quaternions.
    """
    quats = rotations.checked_quats(quats_wxyz)
    if quats.ndim != 2 or len(quats) == 0:
        raise ValueError(f"an average needs (n, 4) quaternions with n >= 1, got shape {quats.shape}")
    # Averaged relative to the first, then turned back: the eigenvector of a nearly diagonal M loses no small angles,
    # and the result turns with the data to the last bit or two.
    relative = rotations.multiply(quats, rotations.conjugate(quats[0]))
    weighted = relative if weights is None else relative * np.asarray(weights, dtype=np.float64)[:, None]
    values, vectors = np.linalg.eigh(relative.T @ weighted)
    mean = rotations.multiply(vectors[:, -1], quats[0])
    mean /= np.linalg.norm(mean)
    return (-mean if mean[0] < 0.0 else mean), float(values[-1] / values.sum())


def average_each(quats_wxyz: npt.ArrayLike, weights: npt.ArrayLike) -> FloatArray:
    """Return :func:`average` of k groups at once: what one group costs alone is mostly numpy's own cost per call.

    Parameters
    ----------
    quats_wxyz : array_like
        (k, m, 4) unit; groups of fewer than m are filled up with anything of weight 0, behind the first.
    weights : array_like
        (k, m) ≥ 0.

    Returns
    -------
    (k, 4) unit, scalar part ≥ 0.
    """
    quats = rotations.checked_quats(quats_wxyz)
    relative = rotations.multiply(quats, rotations.conjugate(quats[:, :1]))
    weighted = relative * np.asarray(weights, dtype=np.float64)[:, :, None]
    _, vectors = np.linalg.eigh(relative.transpose(0, 2, 1) @ weighted)
    mean = rotations.multiply(vectors[:, :, -1], quats[:, 0])
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    return np.where(mean[:, :1] < 0.0, -mean, mean)
