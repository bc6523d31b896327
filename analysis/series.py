"""An orientation recording as arrays, and the checks every one of them passes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

NORM_TOLERANCE = 1e-2
"""A quaternion whose norm is further from 1 than this is refused, not silently normalised."""


class AnalysisError(Exception):
    """Base of everything this package raises on purpose.

    SeriesError           an orientation series is impossible: shape, NaN, norm, times going backwards
    ReaderError           a file is not what it should be: format, text in a number, no rows (names the line)
    """


class SeriesError(AnalysisError):
    """An orientation series that cannot be one; the message says which sample and why."""


@dataclass(frozen=True, eq=False)
class OrientationSeries:
    """n orientations over time; validated, float64, unit norm within rounding.

    Raises
    ------
    SeriesError
        Wrong shapes, NaN, times not strictly increasing, or a norm off by more than ``NORM_TOLERANCE``.
    """

    times_s: FloatArray
    """(n,) strictly increasing, s; the origin is the recording's own."""
    quats_wxyz: FloatArray
    """(n, 4) unit quaternions, scalar first, body to world."""
    index: IntArray
    """(n,) how each sample is named in its source: 0-based data row, or unwrapped sequence number."""
    index_kind: str = "row"
    """``"row"`` or ``"sequence"``."""
    positions_m: FloatArray | None = None
    """(n, 3) positions in the world frame, m, where the source has them."""
    source: str = ""
    """What the samples were read from, for people."""
    convention: str = "quaternion w,x,y,z, Hamilton, body to world"
    """The convention the samples were read with, for people."""
    notes: tuple[str, ...] = field(default=())
    """What the reader met and did: rate assumed, duplicates dropped, gaps."""

    def __post_init__(self) -> None:
        times_s = np.ascontiguousarray(self.times_s, dtype=np.float64)
        quats = np.ascontiguousarray(self.quats_wxyz, dtype=np.float64)
        index = np.ascontiguousarray(self.index, dtype=np.int64)
        n = len(times_s)
        if times_s.ndim != 1 or quats.shape != (n, 4) or index.shape != (n,):
            raise SeriesError(
                f"times {times_s.shape}, quaternions {quats.shape} and index {index.shape} do not fit together"
            )
        if self.positions_m is not None and np.shape(self.positions_m) != (n, 3):
            raise SeriesError(f"positions {np.shape(self.positions_m)} do not fit {n} samples")
        if not np.isfinite(times_s).all():
            raise SeriesError(f"the time of sample {int(np.argmin(np.isfinite(times_s)))} is not a number")
        if n > 1 and not (np.diff(times_s) > 0).all():
            first = int(np.argmin(np.diff(times_s) > 0)) + 1
            raise SeriesError(f"time does not increase at sample {first} ({times_s[first]:.6f} s)")
        norms = np.linalg.norm(quats, axis=1)
        bad = ~(np.abs(norms - 1.0) <= NORM_TOLERANCE)  # also true for NaN
        if bad.any():
            first = int(np.argmax(bad))
            raise SeriesError(
                f"the quaternion of sample {first} has norm {norms[first]:.4f}, not 1: wrong columns or units?"
            )
        object.__setattr__(self, "times_s", times_s)
        object.__setattr__(self, "quats_wxyz", quats / norms[:, None])
        object.__setattr__(self, "index", index)

    def __len__(self) -> int:
        return len(self.times_s)
