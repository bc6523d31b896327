"""A result for people, in the terminal: the number first, then how far to trust it, then the cycles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.as_published import PublishedDrift
from analysis.trial_score import TrialScore
from host.plain_text import plain
from host.score_batch import BatchRow

MAX_ROWS = 40
"""Longer tables show their beginning and their end."""


def render_score(score: TrialScore) -> RenderableType:
    """Draw a result.

    Parameters
    ----------
    score : TrialScore
        The result; texts in it may come from files and are shown as they are, never as markup.
    """
    parts: list[RenderableType] = [_headline(score), _trust(score)]
    if score.endpoints:
        parts += [Text(""), _cycles(score)]
    return Group(*parts)


def print_score(score: TrialScore, console: Console | None = None) -> None:
    """Print a result to standard output."""
    (console or Console(highlight=False, soft_wrap=False)).print(render_score(score))


def render_batch(rows: Sequence[BatchRow]) -> RenderableType:
    """Draw a table of many recordings, one line each, and below it why some have no score.

    Parameters
    ----------
    rows : sequence of BatchRow
        In the order to show.
    """
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    table.add_column("recording", overflow="fold")
    for name in ("θ̄", "95 % interval", "cycles", "period", "other end", "flags", "notes"):
        table.add_column(name, justify="right", no_wrap=True)
    reasons = []
    for row in rows:
        name = plain(_tail(row.path), 200)
        result = row.result or {}
        for reason in (row.error,) if row.error else result.get("reasons", ()):
            reasons.append(Text(f"{name}: {plain(str(reason), 300)}", style="yellow"))
        theta = result.get("theta_bar_deg")
        if theta is None:
            table.add_row(Text(name), Text("no score", style="red"), *[""] * 6)
            continue
        interval = result.get("interval_deg")
        other = (result.get("other_extreme") or {}).get("theta_bar_deg")
        table.add_row(
            Text(name),
            Text(f"{theta:.3f}°", style="bold"),
            "–" if interval is None else f"{interval[0]:.3f}° to {interval[1]:.3f}°",
            str(result["n_endpoints"] - 1),
            f"{result['period_s']:.2f} s",
            "–" if other is None else f"{other:.3f}°",
            str(sum(bool(flags) for flags in result.get("flags", ()))),
            str(len(result.get("warnings", ()))),
        )
    scored = sum((row.result or {}).get("theta_bar_deg") is not None for row in rows)
    summary = Text(f"\n{scored} of {len(rows)} recordings scored; `rotdrift score FILE` says more of one")
    return Group(table, *reasons, summary)


def _tail(path: Path) -> str:
    """Name a file by its folder and name: enough to tell recordings apart."""
    return str(Path(*path.parts[-2:]))


def _headline(score: TrialScore) -> Text:
    if score.theta_bar_deg is None:
        line = Text("no score", style="bold red")
        line.append(": " + "; ".join(plain(reason, 300) for reason in score.reasons), style="")
        return line
    line = Text(f"rotation drift θ̄ = {score.theta_bar_deg:.3f}° per cycle", style="bold")
    if score.interval_deg is not None:
        low, high = score.interval_deg
        line.append(f"   95 % interval {low:.3f}° to {high:.3f}°", style="")
    return line


def _trust(score: TrialScore) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in _facts(score):
        grid.add_row(Text(name), Text(value))
    shown = {"" if score.sensor is None else score.sensor.note}
    for warning in (warning for warning in score.warnings if warning not in shown):
        grid.add_row(Text("note", style="yellow"), Text(plain(warning, 400)))
    return grid


def _facts(score: TrialScore) -> Iterator[tuple[str, str]]:
    n = len(score.endpoints)
    motion = [f"{max(0, n - 1)} cycles ({n} end points)"]
    if score.period_s is not None:
        motion.append(f"period {score.period_s:.3f} s")
    if score.cycles.swing_deg:
        motion.append(f"swing {score.cycles.swing_deg:.1f}°")
    yield "motion", ", ".join(motion)
    if score.drift is not None:
        x, y, z = score.drift.axis
        yield "drift axis", f"({x:+.3f}, {y:+.3f}, {z:+.3f}) in the world frame"
    companions = score.companions
    if companions is not None:
        yield (
            "steps",
            f"mean {companions.mean_step_deg:.3f}°, median {companions.median_step_deg:.3f}°, "
            f"scatter {companions.dispersion_deg:.3f}°, net rotation {companions.net_rotation_deg:.2f}°",
        )
        if companions.without_first_deg is not None and companions.without_last_deg is not None:
            yield (
                "without",
                f"the first end point {companions.without_first_deg:.3f}°, the last {companions.without_last_deg:.3f}°",
            )
    if score.other is not None and score.other.drift is not None:
        yield "other end", f"θ̄ {score.other.drift.theta_bar_deg:.3f}° at the other extreme of the motion"
    if score.published is not None:
        yield "published", _published(score.published)
    if score.sensor is not None:
        yield "sensor", plain(score.sensor.note, 300)
    if score.losses is not None:
        yield "losses", _losses(score)
    if score.automatic is not None:
        theta = score.automatic.theta_bar_deg
        found = "no score" if theta is None else f"θ̄ {theta:.3f}°"
        yield "automatic", f"{found} with {score.automatic.n_endpoints} end points found by the search"
    yield "read as", plain(score.convention, 200)


def _published(published: PublishedDrift) -> str:
    text = f"{published.mended_deg:.4f}° by the authors' script, its array cleared; "
    if published.stale_rows:
        return (
            text + f"{published.as_published_deg:.4f}° with {published.stale_rows} steps of earlier motions left in it"
        )
    if published.preceding:
        return text + "the same as published: no earlier motion had more cycles"
    return text + "the same as published, unless a longer motion came before (--preceding)"


def _losses(score: TrialScore) -> str:
    losses = score.losses or {}
    missing = losses.get("missing", 0)
    if not missing:
        return f"none of {losses.get('produced', 0)} samples"
    return (
        f"{missing} of {losses.get('produced', 0)} samples ({100 * losses.get('share', 0):.2f} %): "
        f"{losses.get('lost', 0)} on the link, {losses.get('rejected', 0)} damaged, "
        f"{losses.get('dropped_by_device', 0)} dropped by the object"
    )


def _cycles(score: TrialScore) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    for name in ("cycle", score.index_kind, "time", "period", "step"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", overflow="ellipsis", no_wrap=True)
    times_s = np.array([point.time_s for point in score.endpoints])
    steps_deg = None if score.drift is None else score.drift.steps_deg
    shown = range(len(times_s))
    skipped = range(MAX_ROWS // 2, len(times_s) - MAX_ROWS // 2)
    for k in shown:
        if len(times_s) > MAX_ROWS and k in skipped:
            if k == skipped.start:
                table.add_row("…")
            continue
        point = score.endpoints[k]
        table.add_row(
            Text(str(k) if k else "start"),
            Text(str(point.index)),
            Text(f"{point.time_s - score.start_s:.3f} s"),
            Text(f"{times_s[k] - times_s[k - 1]:.3f} s" if k else ""),
            Text(f"{steps_deg[k - 1]:.3f}°" if k and steps_deg is not None else ""),
            Text(plain(", ".join([*point.flags, point.reason] if point.reason else point.flags)), style="yellow"),
        )
    return table
