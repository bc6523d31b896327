"""MATLAB and Octave files (version 5): one variable per array, names with units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis.series import OrientationSeries


def write_matlab(series: OrientationSeries, result: dict[str, Any] | None, path: Path) -> tuple[str, ...]:
    """Write ``t_s`` (n×1), ``q_wxyz`` (n×4), ``index``, ``position_m``; with a score also the end points and θ̄.

    Row and sequence numbers keep their meaning: rows count from 0, as in ``--endpoints``.
    """
    from scipy.io import savemat  # slow to import

    values: dict[str, Any] = {
        "t_s": series.times_s[:, None],
        "q_wxyz": series.quats_wxyz,
        "index": series.index[:, None].astype(np.float64),
        "index_kind": series.index_kind,
        "convention": series.convention,
    }
    if series.positions_m is not None:
        values["position_m"] = series.positions_m
    if result is not None:
        points = result.get("endpoints") or []
        values["endpoint_t_s"] = np.array([[point["time_s"]] for point in points], dtype=np.float64)
        values["endpoint_q_wxyz"] = np.array([point["quat_wxyz"] for point in points], dtype=np.float64).reshape(-1, 4)
        theta = result.get("theta_bar_deg")
        values["theta_bar_deg"] = np.nan if theta is None else float(theta)
        values["step_deg"] = np.array(result.get("steps_deg") or [], dtype=np.float64)[:, None]
    savemat(path, values, appendmat=False)
    return ()
