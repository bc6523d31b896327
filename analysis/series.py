"""An orientation recording as arrays, and the checks every one of them passes."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_UNIT_ROUNDING = 1e-15
_BLOCK = 8192  # rows worked on at a time
NORM_TOLERANCE = 1e-2
"""A quaternion whose norm is further from 1 than this is refused, not silently normalised."""
GAP_FACTOR = 5.0
"""An interval longer than so many usual ones is a gap."""

LEFT_OUT_WARNING = 0.01
"""More than this share of a trial left out is a warning ..."""
LEFT_OUT_LIMIT = 0.10
"""... and more than this one makes the trial not valid, unless a person chose what to score."""


class AnalysisError(Exception):
    """Base of everything this package raises on purpose.

    SeriesError           an orientation series is impossible: shape, NaN, norm, times going backwards
    ReaderError           a file is not what it should be: format, text in a number, no rows (names the line)
    WriterError           a format cannot hold this recording, or needs a package that is not installed
    BaselineError         a static baseline cannot be measured (the object moved, too short) or its file is not one
    """


class SeriesError(AnalysisError):
    """An orientation series that is not valid; the message names the sample and the reason."""


class ReaderError(AnalysisError):
    """A file that cannot be read as orientations; one sentence with the line number and what to do."""


class WriterError(AnalysisError):
    """A format that cannot hold this recording; the message names what is missing."""


class BaselineError(AnalysisError):
    """A static baseline that is not valid; the message names the reason."""


@dataclass(frozen=True, eq=False)
class SetAside:
    """Samples of the source that time does not allow in the series (repeated and backward time stamps).

    They can still be named as end points by their row.
    """

    times_s: FloatArray
    """(k,) as found."""
    quats_wxyz: FloatArray
    """(k, 4) unit, scalar first, body to world."""
    index: IntArray
    """(k,) row or sequence number."""


@dataclass(frozen=True)
class LeftOut:
    """Rows of the source that are not in the series, and how much of the trial they are."""

    rows: int
    """How many."""
    of: int
    """Of how many."""
    share: float
    """Of the trial's length, 0 to 1."""
    reason: str
    """Why, after ``rows``: ``have no orientation``."""
    holes: bool = False
    """Whether they are rows without an orientation."""

    @property
    def sentence(self) -> str:
        """The account in words."""
        return (
            f"{self.rows} of {self.of} rows {self.reason} and are left out, {100.0 * self.share:.2g} % of the trial's "
            "length"
        )


@dataclass(frozen=True, eq=False)
class Sample:
    """One sample of a recording, found by its name."""

    time_s: float
    """Recording's own time, s."""
    index: int
    """Row or sequence number."""
    quat_wxyz: FloatArray
    """(4,) unit, scalar first, body to world."""


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
    notes: tuple[str, ...] = ()
    """What the reader met and did: rate assumed, duplicates dropped, gaps."""
    warnings: tuple[str, ...] = ()
    """What makes the data doubtful, e.g. data that contradict the declared convention; go into every result."""
    accelerations_mps2: FloatArray | None = None
    """(n, 3) specific force in the body frame, m/s², where the source has it: shows where up is."""
    times_measured: bool = True
    """False where the source has no time stamps: an even rate was taken, and missing samples cannot be seen."""
    set_aside: SetAside | None = None
    """Samples left out because of their time stamps."""
    left_out: tuple[LeftOut, ...] = ()
    """How much was left out, and why."""

    def __post_init__(self) -> None:
        times_s = np.ascontiguousarray(self.times_s, dtype=np.float64)
        quats = np.ascontiguousarray(self.quats_wxyz, dtype=np.float64)
        index = np.ascontiguousarray(self.index, dtype=np.int64)
        n = len(times_s)
        if times_s.ndim != 1 or quats.shape != (n, 4) or index.shape != (n,):
            raise SeriesError(
                f"times {times_s.shape}, quaternions {quats.shape} and index {index.shape} do not fit together"
            )
        for what, vectors in (("positions", self.positions_m), ("accelerations", self.accelerations_mps2)):
            if vectors is not None and np.shape(vectors) != (n, 3):
                raise SeriesError(f"{what} {np.shape(vectors)} do not fit {n} samples")
        if not np.isfinite(times_s).all():
            raise SeriesError(f"the time of sample {int(np.argmin(np.isfinite(times_s)))} is not a number")
        if not (times_s[1:] > times_s[:-1]).all():
            first = int(np.argmin(np.diff(times_s) > 0)) + 1
            raise SeriesError(f"time does not increase at sample {first} ({times_s[first]:.6f} s)")
        object.__setattr__(self, "times_s", times_s)
        object.__setattr__(self, "quats_wxyz", _normalised(quats))
        object.__setattr__(self, "index", index)

    def __len__(self) -> int:
        return len(self.times_s)

    def with_remarks(self, notes: tuple[str, ...] = (), warnings: tuple[str, ...] = ()) -> OrientationSeries:
        """Return the same samples with further notes and warnings; the arrays are shared and not checked again."""
        more = copy.copy(self)
        object.__setattr__(more, "notes", (*self.notes, *notes))
        object.__setattr__(more, "warnings", (*self.warnings, *warnings))
        return more

    @property
    def duration_s(self) -> float:
        """First to last sample, s."""
        return float(self.times_s[-1] - self.times_s[0]) if len(self) else 0.0

    @property
    def interval_s(self) -> float:
        """Usual interval between samples (the median), s; NaN with fewer than 2 samples."""
        return float(np.median(np.diff(self.times_s))) if len(self) > 1 else float("nan")

    def gaps(self) -> FloatArray:
        """Find where samples are missing: intervals longer than ``GAP_FACTOR`` times the usual one.

        Returns
        -------
        (g, 2) time of the sample before and of the sample after each gap, s.
        """
        if len(self) < 2:
            return np.empty((0, 2))
        wide = np.flatnonzero(np.diff(self.times_s) > GAP_FACTOR * self.interval_s)
        return np.stack((self.times_s[wide], self.times_s[wide + 1]), axis=1)

    def sample(self, index: int) -> Sample:
        """Find one sample by its row or sequence number, also one that was set aside.

        Raises
        ------
        SeriesError
            No such sample in the recording.
        """
        for part in (self, self.set_aside):
            if part is None:
                continue
            found = np.flatnonzero(part.index == index)
            if len(found):
                return Sample(float(part.times_s[found[0]]), index, part.quats_wxyz[found[0]])
        extent = f"{int(self.index[0])} to {int(self.index[-1])}" if len(self) else "no samples"
        raise SeriesError(f"there is no {self.index_kind} {index} in the recording ({extent})")


def _normalised(quats: FloatArray) -> FloatArray:
    """Return (n, 4) nearly unit quaternions as unit; the array itself where all are within rounding."""
    unit = quats  # worked on in blocks that stay in the cache: several times as fast
    for start in range(0, len(quats), _BLOCK):
        part = slice(start, start + _BLOCK)
        squares = np.square(quats[part])
        norms = np.sqrt(squares[:, 0] + squares[:, 1] + squares[:, 2] + squares[:, 3])
        off = np.abs(norms - 1.0)
        if not (off <= NORM_TOLERANCE).all():  # nor is NaN
            first = int(np.argmin(off <= NORM_TOLERANCE))
            raise SeriesError(
                f"the quaternion of sample {start + first} has norm {norms[first]:.4f}, not 1: wrong columns or units?"
            )
        is_unit = off <= _UNIT_ROUNDING
        if not is_unit.all():
            if unit is quats:
                unit = quats.copy()
            # Dividing what is unit already would move the last bits: a copy of a series must be the same series.
            norms[is_unit] = 1.0
            np.divide(quats[part], norms[:, None], out=unit[part])
    return unit
