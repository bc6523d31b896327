"""Averages of rotations: the eigenvector of M = Σ wᵢ qᵢ qᵢᵀ with the largest eigenvalue; q and −q are the same in it.

Source: F. L. Markley et al., "Averaging quaternions", J. Guid. Control Dyn. 30(4), 2007; step 3 of the card.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from analysis.geometry import rotations
from analysis.geometry.rotations import FloatArray


def average(quats_wxyz: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> FloatArray:
    """Return the average of each group of quaternions; card step 3.

    Small groups belong in one call: what one costs alone is mostly numpy's own cost per call.

    Parameters
    ----------
    quats_wxyz : array_like
        (..., n, 4) unit, n ≥ 1; signs do not matter.
    weights : array_like, optional
        (..., n) ≥ 0, default all 1. Smaller groups are filled up with anything of weight 0, behind the first.

    Returns
    -------
    (..., 4) unit, scalar part ≥ 0.

    Raises
    ------
    ValueError
        No quaternions.
    """
    return _average(quats_wxyz, weights)[0]


def average_and_share(quats_wxyz: npt.ArrayLike) -> tuple[FloatArray, float]:
    """Return :func:`average` of one group (n, 4), and the largest eigenvalue as a share of the sum of all four.

    The share is 1 when all rotations agree and falls to 0.25 as they scatter; it is the mean cos² of half the angles
    to the average, so 0.98 is a scatter of 16 degrees.
    """
    mean, eigenvalues = _average(quats_wxyz)
    return mean, float(eigenvalues[-1] / eigenvalues.sum())


def _average(quats_wxyz: npt.ArrayLike, weights: npt.ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Return the averages (..., 4), and the eigenvalues (..., 4) of M in ascending order."""
    quats = rotations.checked_quats(quats_wxyz)
    if quats.ndim < 2 or quats.shape[-2] == 0:
        raise ValueError(f"an average needs (n, 4) quaternions with n >= 1, got shape {quats.shape}")
    # Averaged relative to the first, then turned back: the eigenvector of a nearly diagonal M loses no small angles,
    # and the result turns with the data to the last bit or two.
    relative = rotations.multiply(quats, rotations.conjugate(quats[..., :1, :]))
    weighted = relative if weights is None else relative * np.asarray(weights, dtype=np.float64)[..., None]
    eigenvalues, vectors = np.linalg.eigh(np.matrix_transpose(relative) @ weighted)
    mean = rotations.multiply(vectors[..., -1], quats[..., 0, :])
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    return np.where(mean[..., :1] < 0.0, -mean, mean), eigenvalues
