"""A result in a few lines of text: θ̄ with its interval, and what stands beside it. For reports and for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from analysis.scoring.card import rotation_drift
from analysis.scoring.interval import NO_DRIFT
from analysis.scoring.result import Result
from analysis.scoring.result_parts import SensorShare
from analysis.scoring.slip import Slip, find_slip
from analysis.series import FloatArray

_LEFT = "style='text-align:left'"


def degrees(value: float | None, digits: int = 3) -> str:
    """Return a number of degrees as text; an em dash where there is none."""
    return "—" if value is None else f"{value:.{digits}f}"


def vector_text(parts: Sequence[float] | FloatArray, digits: int = 2) -> str:
    """Return a vector as text, with signs, and with minus signs that are not hyphens."""
    return "(" + ", ".join(f"{part:+.{digits}f}" for part in parts).replace("-", "−") + ")"


def interval_text(result: Result) -> str:
    """Return the interval of θ̄ as ``low … high``; empty where there is none."""
    ends = result.interval_deg
    return "" if ends is None else f"{ends[0]:.3f} … {ends[1]:.3f}"


def doubt_text(result: Result) -> str:
    """Return what an interval that touches 0 means, in words; empty where it does not."""
    return NO_DRIFT if result.interval_deg is not None and result.interval_deg[0] <= 0.0 else ""


def slip_of(result: Result) -> Slip | None:
    """Return the steps of a valid result that are slips; None where there are none."""
    if result.theta_bar_deg is None:
        return None
    return find_slip(rotation_drift(result.endpoint_quats_wxyz, [item.step for item in result.excluded_cycles]))


def trust_rows(result: Result) -> list[tuple[str, str, str]]:
    """Return what stands beside θ̄, a row each: name, value with unit, what it means; empty without a valid score."""
    companions = result.companions
    if not result.valid or companions is None:
        return []
    without = f"{degrees(companions.without_first_deg)}° / {degrees(companions.without_last_deg)}°"
    other = None if result.other_extreme is None else result.other_extreme.theta_bar_deg
    axis = "—" if result.axis is None else vector_text(result.axis, 3)
    share = f"{100 * companions.axis_share:.0f} %"
    slip = slip_of(result)
    meaning = "100 %: all steps about one axis" if slip else "100 %: a steady creep"
    rows = [
        ("mean step", degrees(companions.mean_step_deg) + "°", "mean angle of single steps; far above θ̄: scatter"),
        ("dispersion", degrees(companions.dispersion_deg) + "°", "scatter of the steps about their average"),
        ("without first / last end point", without, "θ̄ rests on these two, to first order"),
        ("other extreme", degrees(other) + "°", "the same cycles at the other turning point"),
        ("drift axis", axis, "axis of the average step, world frame"),
        ("share along that axis", share, f"{meaning}; a third or less: no common direction"),
        ("net rotation", degrees(companions.net_rotation_deg, 2) + "°", "first to last end point"),
    ]
    if slip is not None:
        names = ", ".join(str(step + 1) for step in slip.steps)
        rows.insert(0, ("slip", f"cycle {names}: {degrees(slip.largest_deg, 2)}°", f"{slip.effect}: no steady creep"))
    drift_mm = companions.translation_drift_mm
    if drift_mm is not None:
        rows.append(("translation drift", f"{drift_mm:.3f} mm per cycle", "mean displacement, as the authors' scripts"))
    return [*rows, *_sensor_rows(result.sensor)]


def _sensor_rows(sensor: SensorShare | None) -> list[tuple[str, str, str]]:
    if sensor is None:
        return []
    share = f"{degrees(sensor.per_cycle_deg)}° per cycle" if sensor.per_cycle_deg else "unknown"
    rows = [("sensor's own share", share, sensor.note)]
    if sensor.detectable_deg is not None:
        rows.append(("floor", degrees(sensor.detectable_deg) + "°", "what a resting object would score at most (95 %)"))
    return rows


def result_html(result: Result) -> str:
    """Return a result as an HTML table for notebooks: the number first, then how far to trust it."""
    if result.valid:
        ends = interval_text(result)
        head = f"θ̄ = {degrees(result.theta_bar_deg)}° per cycle" + (f" ({ends})" if ends else "")
        head += f", {doubt_text(result)}" if doubt_text(result) else ""
    else:
        head = "no score: " + "; ".join(result.reasons)
    rows = [("end points", str(result.n_endpoints), ""), *trust_rows(result)]
    cells = "".join(
        f"<tr><th {_LEFT}>{escape(label)}</th><td>{escape(value)}</td><td {_LEFT}>{escape(why)}</td></tr>"
        for label, value, why in rows
    )
    warnings = "".join(f"<li>{escape(warning)}</li>" for warning in result.warnings)
    return f"<b>{escape(head)}</b><table>{cells}</table>" + (f"<ul>{warnings}</ul>" if warnings else "")
