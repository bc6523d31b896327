"""The flat figures of a trial: rotation over time, steps, drift path, sensitivity, link.

``draw_...`` fills one paper column, a figure of its own or a part of another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import FigureBase
from matplotlib.ticker import MaxNLocator, NullFormatter

from analysis.geometry import rotations
from analysis.reporting import style
from analysis.reporting.clouds import turn_about_axis
from analysis.reporting.point_numbers import draw_numbers
from analysis.scoring.recorded_parts import Losses
from analysis.scoring.result import Result
from analysis.scoring.summary import vector_text
from analysis.series import FloatArray, OrientationSeries


@style.style()
def summary_figure(series: OrientationSeries, result: Result, title: str) -> style.PaperFigure:
    """Draw one trial on one page: rotation over time, steps, and how much θ̄ depends on choices.

    Without a score there are no steps and nothing that depends on them: rotation over time alone.
    """
    title_in, upper_in, lower_in = 0.16 * (2 + title.count("\n")), 2.1, max(1.9, sensitivity_height_in(result))
    if result.theta_bar_deg is None:
        lower_in = 0.0
    figure = style.new_figure(title_in + upper_in + lower_in, width_in=2.0 * style.COLUMN_IN)
    figure.suptitle(style.drawable(title), fontsize=8.5)
    if not lower_in:
        draw_rotation(figure.subfigures(1, 1, squeeze=False)[0, 0], series, result)
        return figure
    upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=[upper_in, lower_in])[:, 0]
    left, right = lower.subfigures(1, 2, squeeze=False)[0]
    draw_rotation(upper, series, result)
    draw_steps(left, result)
    draw_sensitivity(right, result)
    return figure


def draw_rotation(figure: FigureBase, series: OrientationSeries, result: Result) -> None:
    """Draw the angle about the motion axis over time, with window and numbered end points."""
    motion_axis = None if None in result.cycles.axis else np.array(result.cycles.axis, dtype=np.float64)
    angle_deg, axis = turn_about_axis(series, motion_axis)
    times_s = result.endpoint_times_s
    at_endpoints = np.interp(times_s, series.times_s, angle_deg)
    origin = at_endpoints[0] if len(at_endpoints) else 0.0
    start_s = float(series.times_s[0])
    ax = figure.subplots()
    if len(times_s):
        ends_s = times_s[[0, -1]] - start_s
        ax.axvspan(*ends_s, color=style.LIGHT, alpha=0.45, lw=0, label="first to last end point")
    line_s, line_deg = _thinned(series.times_s - start_s, angle_deg - origin)
    ax.plot(line_s, line_deg, color=style.BLUE, lw=0.7, label="object")
    if len(times_s):
        points = np.stack((times_s - start_s, at_endpoints - origin), axis=1)
        ax.plot(*points.T, "o", ms=3.4, mfc="white", mec=style.VERMILION, mew=1.1, label="end points")
        upper = np.median(at_endpoints) > np.median(angle_deg)
        away, side = (4, "bottom") if upper else (-4, "top")
        for number in numbers_shown(len(times_s), 12):
            ax.annotate(
                str(number + 1), points[number], xytext=(0, away), textcoords="offset points", ha="center", va=side,
                fontsize=6, color=style.VERMILION,
            )  # fmt: skip
    ax.margins(x=0.01, y=0.17)
    ax.set_xlabel("time since the first sample (s)")
    ax.set_ylabel("rotation about the\nmotion axis (°)")
    figure.legend(loc="outside upper center", ncols=3, handlelength=1.5)
    ax.set_title(f"motion axis {vector_text(axis)}, world frame", fontsize=6.5, color=style.GREY, loc="right", pad=2)


def draw_steps(figure: FigureBase, result: Result) -> None:
    """Draw the step angle of every cycle, with θ̄ and its interval."""
    ax = figure.subplots()
    steps_deg = np.array(result.steps_deg)
    numbers = np.arange(1, len(steps_deg) + 1)
    flagged = np.array([bool(flags) for flags in result.flags[1 : len(steps_deg) + 1]], dtype=bool)
    ax.bar(numbers, steps_deg, color=style.SKY, width=0.75, label="step of one cycle", zorder=2)
    if flagged.any():
        ax.bar(
            numbers[flagged], steps_deg[flagged], width=0.75, zorder=3, label="flagged as odd",
            color=style.ORANGE, hatch="////", edgecolor="white", lw=0,
        )  # fmt: skip
    if result.interval_deg is not None:
        low, high = result.interval_deg
        ax.axhspan(low, high, color=style.VERMILION, alpha=0.18, lw=0, zorder=4, label="95 % interval of θ̄")
    if result.theta_bar_deg is not None:
        ax.axhline(
            result.theta_bar_deg, color=style.VERMILION, lw=1.2, zorder=5, label=f"θ̄ = {result.theta_bar_deg:.3f}°"
        )
    ax.set_xlim(0.4, max(len(numbers), 1) + 0.6)
    ax.set_ylim(bottom=0.0)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.set_xlabel("cycle")
    ax.set_ylabel("step angle (°)")
    figure.legend(loc="outside upper center", ncols=2, handlelength=1.5)


def drift_figure(result: Result) -> style.PaperFigure:
    """Draw where the end points wander: numbered, in the plane of the largest drift, deg from the first one."""
    quats = result.endpoint_quats_wxyz
    figure = style.new_figure(2.1)
    ax = figure.subplots()
    vectors = np.degrees(rotations.log(rotations.difference(quats, quats[0])))
    # The plane of the two largest axes of the path; each axis with its largest part positive, so that no sign is
    # left to the processor.
    values, axes = np.linalg.eigh(vectors.T @ vectors)
    plane = axes[:, np.argsort(values)[::-1][:2]]
    plane = plane * np.where(plane[np.abs(plane).argmax(axis=0), [0, 1]] < 0, -1.0, 1.0)
    flat = vectors @ plane
    ax.plot(flat[:, 0], flat[:, 1], "-", color=style.GREY, lw=0.7, zorder=2)
    ax.scatter(
        flat[:, 0], flat[:, 1], s=16, c=np.arange(len(flat)), cmap="viridis", zorder=3, edgecolors="white", lw=0.4
    )
    arrow = {"arrowstyle": "->", "color": style.VERMILION, "lw": 1.0, "shrinkA": 3, "shrinkB": 3}
    ax.annotate("", flat[-1], flat[0], arrowprops=arrow, zorder=1)
    shares = np.sort(values)[::-1] / max(float(values.sum()), 1e-300)
    for set_label, column in ((ax.set_xlabel, 0), (ax.set_ylabel, 1)):
        set_label(f"rotation about{' ' if column == 0 else chr(10)}{vector_text(plane[:, column])} (°)")
    net = float(np.linalg.norm(vectors[-1]))
    ax.set_title(
        f"arrow: first to last end point, {net:.2f}° in {len(quats) - 1} cycles\n"
        f"{100 * shares[:2].sum():.0f} % of the wandering lies in this plane",
        fontsize=6.5,
        color=style.GREY,
    )
    middle, half = 0.5 * (flat.max(axis=0) + flat.min(axis=0)), 0.6 * max(float(np.ptp(flat, axis=0).max()), 1e-6)
    tall = max(0.65 * float(np.ptp(flat[:, 1])), 0.3 * half)
    ax.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - tall, middle[1] + tall))
    ax.set_aspect("equal", adjustable="box")
    style.settle(figure)
    draw_numbers(ax, flat)
    return figure


@dataclass(frozen=True)
class SensitivityRow:
    """One line of the sensitivity figure: a number, or a range."""

    label: str
    value: float | None
    """θ̄ in degrees; None where only a range makes sense."""
    low: float
    """Ends of the range, or the number itself, deg."""
    high: float
    is_score: bool = False


def sensitivity(result: Result) -> list[SensitivityRow]:
    """Return θ̄ and what it would be with other choices; empty without a score."""
    theta, diagnostics, other = result.theta_bar_deg, result.companions, result.other_extreme
    if theta is None or diagnostics is None:
        return []
    sweep = diagnostics.over_phase_deg
    low, high = result.interval_deg or (theta, theta)
    rows = [
        SensitivityRow("θ̄ by the card", theta, low, high, is_score=True),
        _row("without the first end point", diagnostics.without_first_deg),
        _row("without the last end point", diagnostics.without_last_deg),
        _row("each cycle left out in turn", diagnostics.leave_one_out_deg),
        _row("at the other extreme", None if other is None else other.theta_bar_deg),
        _row("at any phase of the cycle", None if sweep is None else (sweep.min, sweep.max)),
        _row("slope over all end points", diagnostics.slope_deg_per_cycle),
    ]
    return [row for row in rows if row is not None]


def _row(label: str, found: float | tuple[float, float] | None) -> SensitivityRow | None:
    """Return the row of a number or a range; None where it is not known."""
    if found is None:
        return None
    value, low, high = (None, *found) if isinstance(found, tuple) else (found, found, found)
    return SensitivityRow(label, value, low, high)


def sensitivity_height_in(result: Result) -> float:
    """Return how high a figure the rows need, inches."""
    return 0.55 + 0.2 * max(len(sensitivity(result)), 3)


def draw_sensitivity(figure: FigureBase, result: Result) -> None:
    """Draw θ̄ beside what it would be with other choices: ends left out, each cycle left out, other extreme, phase."""
    rows = sensitivity(result)
    ax = figure.subplots()
    for place, row in enumerate(rows):
        colour = style.VERMILION if row.is_score else style.BLUE
        if row.low != row.high:
            ax.plot([row.low, row.high], [place, place], "|-", color=colour, lw=1.6, ms=6)
        if row.value is not None:
            marker, size = ("o", 5) if row.is_score else ("D", 3.5)
            ax.plot(row.value, place, marker, ms=size, mec="white", mew=0.4, color=colour)
        text = f"{row.value:.3f}" if row.value is not None else f"{row.low:.3f} … {row.high:.3f}"
        ax.annotate(
            text, (1.02, place), xycoords=("axes fraction", "data"), va="center", fontsize=6, annotation_clip=False
        )
    if result.theta_bar_deg is not None:
        ax.axvline(result.theta_bar_deg, color=style.VERMILION, lw=0.6, ls=":")
    ax.set_yticks(range(len(rows)), [row.label for row in rows])
    ax.invert_yaxis()
    ax.set_xlim(0.0, 1.06 * max([row.high for row in rows], default=0.0) or 1.0)
    ax.spines["left"].set_visible(False)
    ax.tick_params(axis="y", length=0)
    ax.grid(axis="x", color=style.LIGHT, lw=0.4)
    ax.set_axisbelow(True)
    ax.set_xlabel("θ̄ (° per cycle)")


def link_figure(series: OrientationSeries, losses: Losses | None) -> style.PaperFigure:
    """Draw the quality of the samples: their distance over time, where some are missing, and the link's account."""
    figure = style.new_figure(1.45 if losses is None else 1.7)
    ax = figure.subplots()
    gaps_ms = np.diff(series.times_s) * 1000.0
    usual_ms = float(np.median(gaps_ms)) if len(gaps_ms) else 1.0
    since_s = series.times_s[1:] - series.times_s[0]
    line_s, line_ms = _thinned(since_s, gaps_ms)
    ax.plot(line_s, line_ms, "-", color=style.BLUE, lw=0.5)
    ax.axhline(usual_ms, color=style.GREY, lw=0.5, ls=":")
    missing = _missing(series, gaps_ms, usual_ms)
    where = missing > 0
    if where.any():
        ax.plot(since_s[where], gaps_ms[where], "v", color=style.VERMILION, ms=3, label="samples missing before")
        ax.legend(loc="upper right", fontsize=6)
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter("{x:g}")
    ax.yaxis.set_minor_formatter(NullFormatter())
    low, high = min(usual_ms / 3.0, float(gaps_ms.min(initial=usual_ms))), float(gaps_ms.max(initial=usual_ms))
    ax.set_ylim(min(max(low, usual_ms / 100.0) * 0.8, usual_ms / 11.0), max(high * 1.5, usual_ms * 11.0))
    ax.margins(x=0.01)
    ax.set_xlabel("time since the first sample (s)")
    ax.set_ylabel("sample\ndistance (ms)")
    rate = 1000.0 / usual_ms if usual_ms > 0 else float("nan")
    lost = int(missing.sum())
    ax.set_title(
        f"{len(series)} samples, {rate:.4g} Hz, {lost} missing ({100 * lost / max(len(series) + lost, 1):.2g} %)",
        fontsize=6.5,
        color=style.INK,
        loc="left",
    )
    if losses is not None:
        counts = [(name, getattr(losses, name)) for name in losses.__struct_fields__]
        counted = [
            f"{name.replace('_', ' ')} {count}"
            for name, count in counts
            if type(count) is int and (count or name != "damaged_in_file")  # of damaged recordings only
        ]
        figure.supxlabel(_wrapped(counted, 92), fontsize=6, color=style.GREY)
    return figure


def _missing(series: OrientationSeries, gaps_ms: FloatArray, usual_ms: float) -> FloatArray:
    """Return the (m−1,) number of samples missing before each sample but the first."""
    if series.index_kind == "sequence":
        return np.asarray(np.maximum(np.diff(series.index) - 1, 0), dtype=np.float64)
    return np.maximum(np.round(gaps_ms / usual_ms) - 1.0, 0.0) if usual_ms > 0 else np.zeros(len(gaps_ms))


def _thinned(times_s: FloatArray, values: FloatArray, most: int = 6000) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest value of each of ``most / 2`` parts: thinning hides no peak."""
    if len(times_s) <= most:
        return times_s, values
    starts = np.linspace(0, len(times_s), most // 2, endpoint=False).astype(np.int64)
    kept = []
    for first, last in zip(starts, np.append(starts[1:], len(times_s)), strict=True):
        part = values[first:last]
        kept += sorted({int(first + part.argmin()), int(first + part.argmax())})
    return times_s[kept], values[kept]


def numbers_shown(n: int, most: int) -> list[int]:
    """Return which of n end points carry their number: all, or every k-th with the last."""
    step = max(1, -(-n // most))
    shown = list(range(0, n, step))
    if n and shown[-1] != n - 1:
        if n - 1 - shown[-1] < step / 2:
            shown.pop()
        shown.append(n - 1)
    return shown


def _wrapped(parts: list[str], width: int) -> str:
    lines = [""]
    for part in parts:
        if lines[-1] and len(lines[-1]) + len(part) + 3 > width:
            lines.append("")
        lines[-1] += f" · {part}" if lines[-1] else part
    return "\n".join(lines)
