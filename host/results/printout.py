"""A result for the terminal: the number first, then how far to trust it, then the cycles; many as one table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.scoring.as_published import PublishedDrift
from analysis.scoring.trial_score import TrialScore
from host.results.batch import BatchRow
from host.text import plain

MAX_ROWS = 40
"""Longer tables show their beginning and their end."""
MAX_LEFT_OUT = 4
"""Turning points left out that are named; the result has all."""
_BELOW_FLOOR = {
    "baseline": "below the sensor's floor: it cannot be told from no drift at all",
    "rests": "below the floor that the rests inside the trial set: only a static baseline can tell it from no drift",
}


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
    """Print a result to standard output; where that is a file or a pipe, without the blanks that fill up a line."""
    console = console or Console(highlight=False, soft_wrap=False)
    if console.is_terminal:
        console.print(render_score(score))
        return
    with console.capture() as drawn:
        console.print(render_score(score))
    console.file.write("".join(f"{line.rstrip()}\n" for line in drawn.get().splitlines()))


def _headline(score: TrialScore) -> Text:
    if score.theta_bar_deg is None:
        line = Text("no score", style="bold red")
        line.append(": " + "; ".join(plain(reason, 300) for reason in score.reasons), style="")
        return line
    line = Text(f"rotation drift θ̄ = {score.theta_bar_deg:.3f}° per cycle", style="bold")
    if score.interval_deg is not None:
        low, high = score.interval_deg
        line.append(f"   95 % interval {low:.3f}° to {high:.3f}°", style="")
    if score.sensor is not None and score.sensor.below_floor:
        line.append(f"\n{_BELOW_FLOOR[score.sensor.source]}", style="bold yellow")
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
    yield "motion", ", ".join(_motion(score))
    if score.drift is not None:
        x, y, z = score.drift.axis
        share = "" if score.companions is None else f"; {score.companions.axis_share:.0%} of the stepping is along it"
        yield "drift axis", f"({x:+.3f}, {y:+.3f}, {z:+.3f}) in the world frame{share}"
    yield from _companions(score)
    if score.published is not None:
        yield "published", _published(score.published)
    if score.sensor is not None:
        yield "sensor", plain(score.sensor.note, 300)
    if score.losses is not None:
        yield "losses", _losses(score)
    yield "window", _window(score)
    if score.automatic is not None:
        theta = score.automatic.theta_bar_deg
        found = "no score" if theta is None else f"θ̄ {theta:.3f}°"
        yield "automatic", f"{found} with {score.automatic.n_endpoints} end points found by the search"
    yield "read as", plain("; ".join((score.convention, *score.notes)), 600)


def _motion(score: TrialScore) -> Iterator[str]:
    n, cycles = len(score.endpoints), score.cycles
    yield f"{_number(max(0, n - 1), 'cycle')} ({_number(n, 'end point')})"
    if score.period_s is not None:
        yield f"period {score.period_s:.3f} s (confidence {cycles.period_confidence:.2f})"
    if cycles.swing_deg:
        yield f"swing {cycles.swing_deg:.1f}°"
        yield f"{cycles.axis_share:.0%} of it about one axis"
    if cycles.humps > 1:
        yield f"{cycles.humps} humps a cycle"


def _number(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _companions(score: TrialScore) -> Iterator[tuple[str, str]]:
    found = score.companions
    if found is None:
        return
    yield (
        "steps",
        f"mean {found.mean_step_deg:.3f}°, median {found.median_step_deg:.3f}°, "
        f"dispersion {found.dispersion_deg:.3f}°; "
        f"top eigenvalue share {found.top_eigenvalue_share:.4f}",
    )
    yield (
        "poses",
        f"net rotation {found.net_rotation_deg:.2f}°, at most {found.max_excursion_deg:.2f}° from the first; "
        f"slope {found.slope_deg_per_cycle:.3f}° per cycle",
    )
    if found.without_first_deg is not None and found.without_last_deg is not None:
        text = f"the first end point {found.without_first_deg:.3f}°, the last {found.without_last_deg:.3f}°"
        if found.leave_one_out_deg is not None:
            text += ", any one step {:.3f}° to {:.3f}°".format(*found.leave_one_out_deg)
        yield "θ̄ without", text
    at = []
    if score.other is not None and score.other.drift is not None:
        at.append(f"the other extreme {score.other.drift.theta_bar_deg:.3f}°")
    if score.phase is not None:
        at.append(f"any phase {score.phase.theta_bar_deg.min():.3f}° to {score.phase.theta_bar_deg.max():.3f}°")
    if at:
        yield "θ̄ at", ", ".join(at)
    if score.translation_drift_mm is not None:
        yield "position", f"translation drift {score.translation_drift_mm:.3f} mm per cycle"


def _window(score: TrialScore) -> str:
    window = score.window
    text = {"from-to": "as given", "endpoints": "end points as given"}.get(window.kind, window.kind)
    if window.source not in ("", "given"):
        text += f" by {plain(window.source, 80)}"
    if window.from_s is not None and window.to_s is not None:
        text += f", {window.from_s - score.start_s:.2f} s to {window.to_s - score.start_s:.2f} s"
    if window.left_out:
        left = "; ".join(f"{at - score.start_s:.2f} s, {reason}" for at, reason in window.left_out[:MAX_LEFT_OUT])
        more = len(window.left_out) - MAX_LEFT_OUT
        text += f"; left out: {plain(left, 400)}" + (f"; {more} more" if more > 0 else "")
    return text


def _published(published: PublishedDrift) -> str:
    text = f"{published.mended_deg:.4f}° by the authors' script, its array cleared; "
    if published.stale_rows:
        left = ", ".join(f"{count} of motion {k}" for k, count in enumerate(published.stale_of, 1) if count)
        return (
            text + f"{published.as_published_deg:.4f}° with {published.stale_rows} steps of earlier motions left in it "
            f"({left} given with --preceding)"
        )
    if published.stale_of:
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
    table.add_column("", overflow="fold", min_width=12)  # the one column that may fold: numbers stay whole
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


NARROW = 100
"""Terminals below this many columns get fewer figures, so that the names stay whole."""
UNBOUND = 160
"""Columns where the output is no terminal: nothing is folded in a file."""

_WIDE_COLUMNS = ("θ̄", "95 % interval", "cycles", "period", "other end", "flags", "notes")
_COLUMNS = ("θ̄", "95 % interval", "cycles", "notes")


def print_batch(rows: Sequence[BatchRow], console: Console | None = None) -> None:
    """Print a table of many recordings to standard output."""
    console = console or Console(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, UNBOUND)
    console.print(render_batch(rows, console.width))


def render_batch(rows: Sequence[BatchRow], width: int = UNBOUND) -> RenderableType:
    """Draw a table of many recordings, one line each, and below it why some have no score.

    Parameters
    ----------
    rows : sequence of BatchRow
        In the order to show.
    width : int
        Columns of the terminal.
    """
    columns = _COLUMNS if width < NARROW else _WIDE_COLUMNS
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    table.add_column("recording", overflow="fold")
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    reasons = []
    for row in rows:
        name = plain(_tail(row.path), 200)
        result = row.result or {}
        for reason in (row.error,) if row.error else result.get("reasons", ()):
            reasons.append(Text(f"{name}: {plain(str(reason), 300)}", style="yellow"))
        if result.get("theta_bar_deg") is None:
            table.add_row(Text(name), Text("no score", style="red"), *[""] * (len(columns) - 1))
        else:
            cells = _cells(result)
            table.add_row(Text(name), *(cells[column] for column in columns))
    scored = sum((row.result or {}).get("theta_bar_deg") is not None for row in rows)
    summary = Text(f"\n{scored} of {len(rows)} recordings scored; `rotdrift score FILE` says more of one")
    return Group(table, *reasons, summary)


def _cells(result: dict[str, Any]) -> dict[str, Text | str]:
    interval = result.get("interval_deg")
    other = (result.get("other_extreme") or {}).get("theta_bar_deg")
    theta = Text(f"{result['theta_bar_deg']:.3f}°", style="bold")
    if (result.get("sensor") or {}).get("below_floor"):
        theta = Text("below floor ", style="yellow") + theta
    return {
        "θ̄": theta,
        "95 % interval": "–" if interval is None else f"{interval[0]:.3f}° to {interval[1]:.3f}°",
        "cycles": str(result["n_endpoints"] - 1),
        "period": f"{result['period_s']:.2f} s",
        "other end": "–" if other is None else f"{other:.3f}°",
        "flags": str(sum(bool(flags) for flags in result.get("flags", ()))),
        "notes": str(len(result.get("warnings", ()))),
    }


def _tail(path: Path) -> str:
    """Name a file by its folder and name: enough to tell recordings apart."""
    return str(Path(*path.parts[-2:]))
