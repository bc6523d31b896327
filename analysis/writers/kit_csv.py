"""The benchmark authors' own CSV layout (T42), so that their scripts can work on any recording.

Source: their published recordings: a header row, a running index, Unix time in s, position in m, Euler angles extrinsic
x-y-z in rad, and the quaternion x, y, z, w. Motor columns are left out: there are no motors here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis import rotations
from analysis.euler_angles import to_euler_zyx
from analysis.series import OrientationSeries
from analysis.writers.tum import NO_POSITIONS

HEADER = ",ts,tx,ty,tz,rx,ry,rz,qx,qy,qz,qw"


def write_kit_csv(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write the T42 layout; positions that are not known are written as zeros, and that is said."""
    del result
    positions = np.zeros((len(series), 3)) if series.positions_m is None else series.positions_m
    # Intrinsic z-y-x angles, read from the other end, are the extrinsic x-y-z angles.
    angles = to_euler_zyx(series.quats_wxyz)[:, ::-1]
    table = np.column_stack(
        (np.arange(len(series)), series.times_s, positions, angles, rotations.to_xyzw(series.quats_wxyz))
    )
    with path.open("x", encoding="utf-8") as file:
        np.savetxt(file, table, fmt=["%d", "%.9f", *["%.17g"] * 10], delimiter=",", header=HEADER, comments="")
    return (NO_POSITIONS,) if series.positions_m is None else ()
