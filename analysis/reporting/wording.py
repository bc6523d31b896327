"""The sentences and small tables of the report, written from a result: methods, trust, cycles."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.reporting.trial_report import TrialReport
from analysis.scoring.result import Result
from analysis.scoring.summary import degrees, doubt_text
from analysis.series import OrientationSeries

CARD_REFERENCE = "RAL-SI-2020-B19-0838.4-V1.0"
ABOUT = (
    "A robot hand holds an object and repeats one rotation. After each cycle the object should be back in the same "
    "orientation; it is not quite. The rotation drift θ̄ is the angle of the average rotation from one cycle's end "
    "point to the next, in degrees per cycle: 0 is a hand that brings the object back exactly."
)
"""What the number is, for a stranger."""


def missing_lines(trials: Sequence[TrialReport]) -> list[str]:
    """Return which required fields are missing where; trials that lack the same stand in one line."""
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
    """Return in a word or two what the result is."""
    if not trial.result.valid:
        return "no score"
    warnings = len(trial.result.warnings)
    parts = ("valid", doubt_text(trial.result), f"{warnings} warning{'s' if warnings > 1 else ''}" if warnings else "")
    return ", ".join(filter(None, parts))


CYCLE_COLUMNS = ("end point", "sample", "time (s)", "step (°)", "dwell (s)", "flags")


def cycle_rows(trial: TrialReport) -> list[tuple[str, ...]]:
    """Return the end points: number, name of the sample, time, step that ends here, dwell, flags."""
    result = trial.result
    start_s = float(trial.series.times_s[0]) if len(trial.series) else 0.0
    rows: list[tuple[str, ...]] = []
    for place, point in enumerate(result.endpoints):
        step = f"{result.steps_deg[place - 1]:.3f}" if 0 < place <= len(result.steps_deg) else ""
        flags = [*point.flags, *([f"chosen: {point.reason}"] if point.reason else [])]
        flags += [
            f"step left out by the operator: {cycle.reason or 'no reason given'}"
            for cycle in result.excluded_cycles
            if cycle.step == place - 1
        ]
        dwell = "" if point.dwell_s is None else f"{point.dwell_s:.2f}"
        time = f"{point.time_s - start_s:.3f}"
        rows.append((str(place + 1), str(point.index), time, step, dwell, ", ".join(flags)))
    return rows


def methods_text(trial: TrialReport) -> str:
    """Return the methods paragraph, from the settings that were used."""
    result = trial.result
    sentences = [_recorded(trial.series), _end_points(result)]
    if result.excluded_cycles:
        named = ", ".join(f"cycle {c.step + 1} ({c.reason or 'no reason given'})" for c in result.excluded_cycles)
        sentences.append(f"The operator left out {named}; what was left out stays in the tables and the figures.")
    sentences.append(
        f"θ̄ follows the benchmark card {CARD_REFERENCE}: r_i = q_(i+1) ⊗ q_i⁻¹ between successive end points (world "
        "frame), their average as the eigenvector of the largest eigenvalue of Σ r_i r_iᵀ, and θ̄ as the rotation angle "
        "of that average."
    )
    if result.interval is not None:
        sentences.append(
            f"The {100 * result.interval.level:g} % interval is a t interval on the larger of the jackknife and "
            f"delta-method standard errors, widened for a lag-1 correlation of {result.interval.correlation:.2f}; its "
            "lower end is 0 where Hotelling's test does not exclude that there is no drift."
        )
    if result.sensor is not None:
        sentences.append(f"Sensor: {result.sensor.note}.")
    return " ".join(sentences)


def _recorded(series: OrientationSeries) -> str:
    duration_s = float(series.times_s[-1] - series.times_s[0]) if len(series) > 1 else 0.0
    rate = (len(series) - 1) / duration_s if duration_s > 0 else float("nan")
    text = (
        f"Orientation was recorded for {duration_s:.1f} s at {rate:.4g} Hz ({len(series)} samples), read as "
        f"{series.convention}."
    )
    if series.times_measured:
        return text
    return f"{text} The file has no time stamps: all times follow from that rate, and missing samples cannot be seen."


def _end_points(result: Result) -> str:
    """Return how the end points were found, or that a person chose them."""
    cycles, settings = result.cycles, result.settings.cycles
    if result.window.kind == "endpoints":
        return f"The {result.n_endpoints} end points were chosen by hand ({result.window.source})."
    operator = result.window.kind == "from-to"
    chosen = "in a window given by the operator" if operator else "without any number set by hand"
    return (
        f"End points were found {chosen}: angular velocity on a {settings.rate_hz:g} Hz grid, period from its vector "
        f"autocorrelation ({degrees(result.period_s, 2)} s, confidence {degrees(cycles.period_confidence, 2)}), motion "
        f"axis from its windowed covariance (share {degrees(cycles.axis_share, 2)}), turning points of the angle about "
        f"that axis with a hysteresis of {settings.hysteresis:g} of the range of motion "
        f"({degrees(cycles.swing_deg, 1)}°). Each end point is the middle of the object's dwell at one extreme, its "
        "orientation the average of the samples around. Irregular cycles inside the trial are kept and flagged; only "
        "idle and irregular cycles at its two ends are left out."
    )
