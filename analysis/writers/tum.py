"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw``, s and m, as evo and most SLAM tools read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis import rotations
from analysis.series import OrientationSeries

NO_POSITIONS = "the recording has no positions; zeros are written"


def write_tum(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write a TUM trajectory; positions that are not known are written as zeros, and that is said."""
    del result
    positions = np.zeros((len(series), 3)) if series.positions_m is None else series.positions_m
    table = np.column_stack((series.times_s, positions, rotations.to_xyzw(series.quats_wxyz)))
    with path.open("x", encoding="utf-8") as file:
        np.savetxt(file, table, fmt=["%.9f", *["%.17g"] * 7], header="timestamp tx ty tz qx qy qz qw")
    return (NO_POSITIONS,) if series.positions_m is None else ()
