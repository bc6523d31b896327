"""Table and plot of what was measured, with the machine and the versions."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks.measurement import COST, Curve, Row, Topic
from benchmarks.native import compiler_version

PACKAGES = ("numpy", "scipy", "construct", "cobs", "mcap", "python-can", "cantools", "pymavlink", "ximu3")


def _cpu() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor() or platform.machine()
    facts = dict(line.split(":", 1) for line in text.split("\n\n")[0].splitlines() if ":" in line)
    values = {key.strip(): value.strip() for key, value in facts.items()}
    name = values.get("model name", platform.machine())
    return f"{name} (family {values.get('cpu family', '?')}, model {values.get('model', '?')})"


def machine() -> dict[str, str]:
    """Name the CPU, the system, and every version that matters."""
    facts = {
        "CPU": f"{_cpu()}, {os.cpu_count()} cores",
        "system": f"{platform.system()} {platform.release()}",
        "Python": platform.python_version(),
        "compiler": compiler_version(),
    }
    for package in PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            facts[package] = "not installed"
    facts["load before"] = " ".join(f"{value:.1f}" for value in os.getloadavg())
    return facts


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _goal(row: Row) -> str:
    return "" if row.goal is None else f"{'≤' if row.sense == COST else '≥'} {_number(row.goal)}"


def _line(row: Row) -> str:
    has_range = row.low is not None and row.high is not None and row.low != row.high
    spread = f"{_number(row.low or 0.0)} – {_number(row.high or 0.0)}" if has_range else ""
    goal = _goal(row)
    met = {None: "", True: "yes", False: "**no**"}[row.met]
    return f"| {row.name} | {_number(row.value)} {row.unit} | {spread} | {goal} | {met} | {row.note} |"


def markdown(topics: list[Topic], facts: dict[str, str] | None = None) -> str:
    """Table of all topics."""
    lines: list[str] = []
    if facts:
        lines += [*(f"- {name}: {value}" for name, value in facts.items()), ""]
    for topic in topics:
        lines += [f"## {topic.title}", "", "| what | median | range | goal | met | |", "|---|---|---|---|---|---|"]
        lines += [_line(row) for row in topic.rows]
        lines += [""]
        lines += [f"Left out: {reason}." for reason in topic.left_out]
        if topic.text:
            lines += ["```text", topic.text, "```"]
        lines += [""]
    return "\n".join(lines).rstrip() + "\n"


def plot(topics: list[Topic], path: Path) -> None:
    """Draw what has a goal as how many times over it is reached, and every curve."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import LogLocator, NullFormatter

    named = [(topic.title.partition(":")[0], row) for topic in topics for row in topic.rows]
    goals = [(title, row) for title, row in named if row.goal and row.value > 0.0]
    groups: dict[tuple[str, str, str], list[Curve]] = {}
    for topic in topics:
        for curve in topic.curves:
            groups.setdefault((topic.title.partition(":")[0], curve.x_label, curve.y_label), []).append(curve)
    rows = 1 + (len(groups) + 1) // 2
    height = max(3.0, 0.28 * len(goals))
    figure = plt.figure(figsize=(11, height + 3.2 * (rows - 1)), layout="constrained")
    grid = figure.add_gridspec(rows, 2, height_ratios=[height, *[3.2] * (rows - 1)])
    axes = figure.add_subplot(grid[0, :])
    shares = [row.goal / row.value if row.sense == COST else row.value / row.goal for _, row in goals if row.goal]
    bars = axes.barh(range(len(goals)), shares, color=["tab:green" if row.met else "tab:red" for _, row in goals])
    axes.bar_label(
        bars, [f"{_number(row.value)} {row.unit} (goal {_goal(row)})" for _, row in goals], padding=3, size=7
    )
    axes.axvline(1.0, color="black", linewidth=1)
    axes.set_yticks(range(len(goals)), [f"{title}: {row.name}" for title, row in goals], fontsize=8)
    axes.set_ylim(-0.7, len(goals) - 0.3)
    axes.invert_yaxis()
    axes.set_xscale("log")
    axes.set_xlim(min([0.5, *shares]) / 1.1, 5.0 * max([1.0, *shares]))
    axes.set_xlabel("how many times over the goal is reached (1: just; green: met, red: missed)")
    panels = [axes]
    for k, ((title, x_label, y_label), curves) in enumerate(groups.items()):
        axes = figure.add_subplot(grid[1 + k // 2, k % 2])
        for curve in curves:
            axes.loglog(curve.x, curve.y, marker="o", markersize=3, label=curve.name)
        low, high = axes.get_ylim()
        if high / low < 20:  # flat has to look flat
            middle = (high * low) ** 0.5
            axes.set_ylim(middle / 5, middle * 5)
        axes.set(title=f"{title}: {y_label} against {x_label}", xlabel=x_label, ylabel=y_label)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
        panels.append(axes)
    for axes in panels:
        for axis in (axes.xaxis, axes.yaxis) if axes.get_yscale() == "log" else (axes.xaxis,):
            low, high = axis.get_view_interval()
            if high / low < 200:
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(
                lambda value, _: f"{value:,g}" if value < 1e5 else f"{value:.0e}".replace("e+0", "e")
            )
            axis.set_minor_formatter(NullFormatter())
    figure.savefig(path, dpi=110)
    plt.close(figure)
