"""The sentences and small tables of the report, written from a result: methods, trust, cycles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from analysis.reporting import style as look
from analysis.reporting.result_view import number
from analysis.reporting.trial_report import TrialReport

CARD_REFERENCE = "RAL-SI-2020-B19-0838.4-V1.0"
ABOUT = (
    "A robot hand holds an object and repeats one rotation. After each cycle the object should be back in the same "
    "orientation; it is not quite. The rotation drift θ̄ is the angle of the average rotation from one cycle's end "
    "point to the next, in degrees per cycle: 0 is a hand that brings the object back exactly."
)
"""What the number is, for a stranger."""


def degrees(value: object, digits: int = 3) -> str:
    """Write a number of degrees; an em dash where there is none."""
    found = number(value)
    return "—" if found is None else f"{found:.{digits}f}"


def interval_text(trial: TrialReport) -> str:
    """Write the interval of θ̄ as ``low … high``; empty where there is none."""
    ends = trial.view.interval_deg
    return "" if ends is None else f"{ends[0]:.3f} … {ends[1]:.3f}"


def missing_lines(trials: Sequence[TrialReport]) -> list[str]:
    """Say which required fields are missing where; trials that lack the same stand in one line."""
    lacking: dict[tuple[str, ...], list[str]] = {}
    for trial in trials:
        if trial.missing:
            lacking.setdefault(trial.missing, []).append(trial.id)
    lines = []
    for fields, where in lacking.items():
        if len(trials) == 1:
            lines.append(", ".join(fields))
        else:
            which = "all trials" if len(where) == len(trials) else ", ".join(where)
            lines.append(f"{which}: {', '.join(fields)}")
    return lines


def verdict(trial: TrialReport) -> str:
    """Say in a word or two what the result is."""
    if not trial.view.valid:
        return "no score"
    warnings = len(trial.result.get("warnings") or [])
    return "valid" if not warnings else f"valid, {warnings} warning{'s' if warnings > 1 else ''}"


def trust_rows(trial: TrialReport) -> list[tuple[str, str, str]]:
    """List what stands beside θ̄: name, value with unit, what it means."""
    view = trial.view
    companions, sensor = view.companions, trial.result.get("sensor") or {}
    if not view.valid:
        return []
    rows: list[tuple[str, str, str]] = [
        (
            "mean step",
            degrees(companions.get("mean_step_deg")) + "°",
            "mean angle of single steps; far above θ̄: scatter",
        ),
        ("dispersion", degrees(companions.get("dispersion_deg")) + "°", "scatter of the steps about their average"),
        (
            "without first / last end point",
            f"{degrees(companions.get('without_first_deg'))}° / {degrees(companions.get('without_last_deg'))}°",
            "θ̄ rests on these two, to first order",
        ),
        (
            "other extreme",
            degrees((trial.result.get("other_extreme") or {}).get("theta_bar_deg")) + "°",
            "the same cycles at the other turning point",
        ),
        ("drift axis", axis_text(trial.result.get("axis")), "axis of the average step, world frame"),
        (
            "share along that axis",
            percent(companions.get("axis_share")),
            "100 %: a steady creep; a third or less: no common direction",
        ),
        ("net rotation", degrees(companions.get("net_rotation_deg"), 2) + "°", "first to last end point"),
    ]
    translation = number(companions.get("translation_drift_mm"))
    if translation is not None:
        rows.append(
            ("translation drift", f"{translation:.3f} mm per cycle", "mean displacement, as the authors' scripts")
        )
    if sensor:
        rows.append(
            (
                "sensor's own share",
                f"{degrees(sensor.get('per_cycle_deg'))}° per cycle"
                if number(sensor.get("per_cycle_deg"))
                else "unknown",
                str(sensor.get("note") or ""),
            )
        )
        if number(sensor.get("detectable_deg")) is not None:
            rows.append(
                (
                    "floor",
                    degrees(sensor.get("detectable_deg")) + "°",
                    "what a resting object would score at most (95 %)",
                )
            )
    return rows


CYCLE_COLUMNS = ("end point", "sample", "time (s)", "step (°)", "dwell (s)", "flags")


def cycle_rows(trial: TrialReport) -> list[tuple[str, ...]]:
    """List the end points: number, name of the sample, time, step that ends here, dwell, flags."""
    start_s = float(trial.series.times_s[0]) if len(trial.series) else 0.0
    rows: list[tuple[str, ...]] = []
    steps = trial.view.steps_deg
    for place, point in enumerate(trial.result.get("endpoints") or []):
        step = f"{steps[place - 1]:.3f}" if 0 < place <= len(steps) else ""
        dwell = number(point.get("dwell_s"))
        flags = [*(point.get("flags") or []), *([f"chosen: {point['reason']}"] if point.get("reason") else [])]
        flags += [
            f"step left out by the operator: {item.get('reason') or 'no reason given'}"
            for item in trial.result.get("excluded_cycles") or []
            if item.get("step") == place - 1
        ]
        rows.append(
            (
                str(place + 1),
                str(point.get("sequence", point.get("row", ""))),
                f"{point['time_s'] - start_s:.3f}",
                step,
                "" if dwell is None else f"{dwell:.2f}",
                ", ".join(flags),
            )
        )
    return rows


def methods_text(trial: TrialReport) -> str:
    """Write the methods paragraph from the settings that were used."""
    result, series = trial.result, trial.series
    cycles, window = result.get("cycles") or {}, result.get("window") or {}
    settings = (result.get("settings") or {}).get("cycles") or {}
    duration_s = float(series.times_s[-1] - series.times_s[0]) if len(series) > 1 else 0.0
    rate = (len(series) - 1) / duration_s if duration_s > 0 else float("nan")
    sentences = [
        f"Orientation was recorded for {duration_s:.1f} s at {rate:.4g} Hz ({len(series)} samples), read as "
        f"{series.convention}."
    ]
    if not series.times_measured:
        sentences.append(
            "The file has no time stamps: all times follow from that rate, and missing samples cannot be seen."
        )
    if window.get("kind") == "endpoints":
        sentences.append(f"The {result.get('n_endpoints')} end points were chosen by hand ({window.get('source')}).")
    else:
        chosen = (
            "in a window given by the operator" if window.get("kind") == "from-to" else "without any number set by hand"
        )
        sentences.append(
            f"End points were found {chosen}: angular velocity on a {settings.get('rate_hz', 100):g} Hz grid, "
            f"period from "
            f"its vector autocorrelation ({degrees(result.get('period_s'), 2)} s, confidence "
            f"{degrees(cycles.get('period_confidence'), 2)}), motion axis from its windowed covariance (share "
            f"{degrees(cycles.get('axis_share'), 2)}), turning points of the angle about that axis with a "
            f"hysteresis of "
            f"{settings.get('hysteresis', 0.4):g} of the range of motion "
            f"({degrees(cycles.get('swing_deg'), 1)}°). Each end "
            "point is the middle of the object's dwell at one extreme, its orientation the average of the "
            "samples around."
            " Irregular cycles inside the trial are kept and flagged; only idle and irregular cycles at its two "
            "ends are "
            "left out."
        )
    excluded = [item for item in result.get("excluded_cycles") or [] if item.get("step", -1) >= 0]
    if excluded:
        named = ", ".join(f"cycle {item['step'] + 1} ({item.get('reason') or 'no reason given'})" for item in excluded)
        sentences.append(f"The operator left out {named}; what was left out stays in the tables and the figures.")
    sentences.append(
        f"θ̄ follows the benchmark card {CARD_REFERENCE}: r_i = q_(i+1) ⊗ q_i⁻¹ between successive end points (world "
        "frame), their average as the eigenvector of the largest eigenvalue of Σ r_i r_iᵀ, and θ̄ as the "
        "rotation angle of "
        "that average."
    )
    interval = (result.get("companions") or {}).get("interval")
    if interval:
        sentences.append(
            f"The {100 * float(interval.get('level', 0.95)):g} % interval is a t interval on the larger of the "
            f"jackknife "
            f"and delta-method standard errors, widened for a lag-1 correlation of "
            f"{float(interval.get('correlation', 0.0)):.2f}; its lower end is 0 where Hotelling's test does not "
            f"exclude "
            "that there is no drift."
        )
    note = (result.get("sensor") or {}).get("note")
    if note:
        sentences.append(f"Sensor: {note}.")
    return " ".join(sentences)


def axis_text(axis: Any) -> str:  # noqa: ANN401 - whatever the JSON holds
    """Write a unit axis with signs; an em dash where there is none."""
    if not isinstance(axis, list) or len(axis) != 3 or None in axis:
        return "—"
    return look.vector(axis, 3)


def percent(value: object) -> str:
    """Write a share as a percentage; an em dash where there is none."""
    found = number(value)
    return "—" if found is None else f"{100 * found:.0f} %"
