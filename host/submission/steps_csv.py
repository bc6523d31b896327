"""Steps of a trial as CSV: the rotation from each end point to the next."""

from __future__ import annotations

import csv
import io

import numpy as np

from analysis.geometry import rotations
from analysis.scoring.card import step_rotations
from analysis.scoring.result import Result


def steps_csv_text(result: Result) -> str:
    """Return one row per step: cycle, angle in deg, rotation vector in deg (world frame), flags of its end.

    Without a valid score there is only the header.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["cycle", "step_deg", "rx_deg", "ry_deg", "rz_deg", "flags"])
    if result.steps_deg:
        vectors = np.degrees(rotations.log(step_rotations(result.endpoint_quats_wxyz))).tolist()
        for number, (angle, vector) in enumerate(zip(result.steps_deg, vectors, strict=True), start=1):
            writer.writerow([number, repr(angle), *map(repr, vector), "; ".join(result.flags[number])])
    return buffer.getvalue()
