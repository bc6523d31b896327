"""Steps of a trial as CSV: the rotation from each end point to the next."""

from __future__ import annotations

import csv
import io

import numpy as np

from analysis.scoring.trial_score import TrialScore


def steps_csv_text(score: TrialScore) -> str:
    """Write one row per step: cycle, angle in deg, rotation vector in deg (world frame), flags of its end.

    Parameters
    ----------
    score
        The score; without a valid one only the header is written.
    """
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["cycle", "step_deg", "rx_deg", "ry_deg", "rz_deg", "flags"])
    if score.drift is not None:
        vectors = np.degrees(score.drift.step_rotvecs_rad).tolist()
        for number, (angle, vector) in enumerate(zip(score.drift.steps_deg.tolist(), vectors, strict=True), start=1):
            flags = "; ".join(score.endpoints[number].flags)
            writer.writerow([number, repr(angle), *map(repr, vector), flags])
    return buffer.getvalue()
