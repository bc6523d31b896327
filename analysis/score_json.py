"""A trial's result as JSON: the one place that names its fields. ``docs/benchmark.md`` lists them."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from analysis import rotations
from analysis.cycles import Run
from analysis.drift import rotation_drift
from analysis.trial_score import RESULT_FORMAT, Json, ScoredEndpoint, TrialScore, finite


def score_to_json(score: TrialScore) -> dict[str, Json]:
    """Lay out a result.

    Parameters
    ----------
    score
        The result.

    Returns
    -------
    Fields of ``docs/benchmark.md``, "The result as JSON"; angles in deg, times in s, null for what is unknown.
    """
    drift = score.drift
    fields: dict[str, object] = {
        "format": RESULT_FORMAT,
        "theta_bar_deg": score.theta_bar_deg,
        "axis": None if drift is None else drift.axis,
        "n_endpoints": len(score.endpoints),
        "interval_deg": score.interval_deg,
        "valid": score.valid,
        "reasons": score.reasons,
        "warnings": score.warnings,
        "endpoints": _endpoints(score.endpoints, score.index_kind),
        "steps_deg": [] if drift is None else drift.steps_deg,
        "flags": [list(point.flags) for point in score.endpoints],
        "period_s": score.period_s,
        "other_extreme": _other(score),
        "companions": _companions(score),
        "sensor": _sensor(score),
        "window": _window(score),
        "cycles": _cycles(score),
        "losses": score.losses,
        "recording": {
            "source": score.source,
            "convention": score.convention,
            "n_samples": score.n_samples,
            "start_s": score.start_s,
            "duration_s": score.duration_s,
            "notes": score.notes,
        },
        "settings": {"cycles": asdict(score.cycles.settings)},
        **({} if not score.excluded else {"excluded_cycles": [asdict(item) for item in score.excluded]}),
        **({} if score.published is None else {"as_published": _published(score)}),
        **score.extra,
    }
    result = finite(fields)
    assert isinstance(result, dict)
    return result


def _endpoints(points: tuple[ScoredEndpoint, ...], index_kind: str) -> list[dict[str, object]]:
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


def _other(score: TrialScore) -> dict[str, object] | None:
    if score.other is None:
        return None
    drift = score.other.drift
    return {
        "theta_bar_deg": None if drift is None else drift.theta_bar_deg,
        "axis": None if drift is None else drift.axis,
        "n_endpoints": len(score.other.endpoints),
        "endpoints": _endpoints(score.other.endpoints, score.index_kind),
    }


def _companions(score: TrialScore) -> dict[str, object] | None:
    companions, drift = score.companions, score.drift
    if companions is None or drift is None:
        return None
    values: dict[str, object] = asdict(companions)
    if score.phase is not None:
        sweep = score.phase.theta_bar_deg
        values["over_phase_deg"] = {
            "min": float(sweep.min()),
            "max": float(sweep.max()),
            "phases": score.phase.phases,
            "theta_bar_deg": sweep,
            "n_cycles": score.phase.n_cycles,
        }
    values["interval"] = None if score.interval is None else asdict(score.interval)
    values["translation_drift_mm"] = score.translation_drift_mm
    values["mean_rotation_wxyz"] = drift.mean_rotation_wxyz
    return values


def _sensor(score: TrialScore) -> dict[str, object] | None:
    sensor = score.sensor
    if sensor is None:
        return None
    return {
        "source": sensor.source,
        "per_cycle_deg": sensor.per_cycle_deg,
        "detectable_deg": sensor.detectable_deg,
        "below_floor": sensor.below_floor,
        "note": sensor.note,
        "baseline": None if sensor.baseline is None else asdict(sensor.baseline),
    }


def _window(score: TrialScore) -> dict[str, object]:
    window = score.window
    return {
        "kind": window.kind,
        "from_s": window.from_s,
        "to_s": window.to_s,
        "source": window.source,
        "left_out": [{"time_s": at, "reason": reason} for at, reason in window.left_out],
        "automatic": None if score.automatic is None else asdict(score.automatic),
    }


def _cycles(score: TrialScore) -> dict[str, object]:
    found = score.cycles
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


def _published(score: TrialScore) -> dict[str, object]:
    published = score.published
    assert published is not None
    return {
        "euler_drift_deg": published.mended_deg,
        "euler_drift_as_published_deg": published.as_published_deg,
        "stale_rows": published.stale_rows,
        "stale_of": published.stale_of,
        "preceding": len(published.stale_of),
        "n_steps": published.n_steps,
    }
