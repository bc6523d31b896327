"""How the parts of a result are laid out as JSON; ``docs/benchmark.md`` lists the fields, angles in deg, times in s."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from analysis.cycles.search import CycleAnalysis, Run
from analysis.geometry import rotations
from analysis.scoring.as_published import PublishedDrift
from analysis.scoring.card import rotation_drift
from analysis.scoring.score_parts import AutomaticScore, OtherExtreme, ScoredEndpoint, SensorShare, Window


def endpoint_fields(points: tuple[ScoredEndpoint, ...], index_kind: str) -> list[dict[str, object]]:
    """Lay out end points; ``index_kind`` (``row`` or ``sequence``) names the field of their index."""
    return [
        {
            index_kind: point.index,
            "time_s": point.time_s,
            "quat_wxyz": point.quat_wxyz,
            "flags": list(point.flags),
            "dwell_s": point.dwell_s,
            "prominence_deg": point.prominence_deg,
            **({"reason": point.reason} if point.reason else {}),
        }
        for point in points
    ]


def other_fields(other: OtherExtreme, index_kind: str) -> dict[str, object]:
    """Lay out the score at the other extreme."""
    return {
        "theta_bar_deg": None if other.drift is None else other.drift.theta_bar_deg,
        "axis": None if other.drift is None else other.drift.axis,
        "n_endpoints": len(other.endpoints),
        "endpoints": endpoint_fields(other.endpoints, index_kind),
    }


def sensor_fields(sensor: SensorShare) -> dict[str, object]:
    """Lay out the sensor's own share."""
    return {
        "source": sensor.source,
        "per_cycle_deg": sensor.per_cycle_deg,
        "detectable_deg": sensor.detectable_deg,
        "below_floor": sensor.below_floor,
        "note": sensor.note,
        "baseline": None if sensor.baseline is None else asdict(sensor.baseline),
    }


def window_fields(window: Window, automatic: AutomaticScore | None) -> dict[str, object]:
    """Lay out which end points were taken, and what the automatic window gives beside an edited one."""
    return {
        "kind": window.kind,
        "from_s": window.from_s,
        "to_s": window.to_s,
        "source": window.source,
        "left_out": [{"time_s": at, "reason": reason} for at, reason in window.left_out],
        "automatic": None if automatic is None else asdict(automatic),
    }


def cycle_fields(found: CycleAnalysis) -> dict[str, object]:
    """Lay out the search for cycles."""
    return {
        "period_confidence": found.period_confidence,
        "axis": found.axis,
        "axis_share": found.axis_share,
        "swing_deg": found.swing_deg,
        "humps": found.humps,
        "likeness": found.likeness,
        "irregularity": found.irregularity,
        "active_s": found.active_s,
        "runs": [
            {
                "from_s": run.start_s,
                "to_s": run.end_s,
                "n_endpoints": len(run.endpoints),
                "net_rotation_deg": float(
                    np.degrees(rotations.distance(run.endpoints[-1].quat_wxyz, run.endpoints[0].quat_wxyz))
                ),
                "theta_bar_deg": _run_drift(run),
                "scored": run.scored,
            }
            for run in found.runs
        ],
    }


def _run_drift(run: Run) -> float | None:
    """θ̄ of one run; with few steps it says little, so it is only for comparison with the run that was scored."""
    if len(run.endpoints) < 2:
        return None
    return rotation_drift([point.quat_wxyz for point in run.endpoints]).theta_bar_deg


def published_fields(published: PublishedDrift) -> dict[str, object]:
    """Lay out the authors' own figure."""
    return {
        "euler_drift_deg": published.mended_deg,
        "euler_drift_as_published_deg": published.as_published_deg,
        "stale_rows": published.stale_rows,
        "stale_of": published.stale_of,
        "preceding": len(published.stale_of),
        "n_steps": published.n_steps,
    }
