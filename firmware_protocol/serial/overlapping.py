"""Bytes seen as records that start at every byte: copies many records that lie anywhere in a few calls."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def overlapping(data: memoryview, length: int) -> npt.NDArray[np.void]:
    """Return bytes as records of ``length`` that start at every byte: indexing it copies each record in one go."""
    return np.ndarray((max(len(data) - length + 1, 0),), f"V{length}", data, strides=(1,))
