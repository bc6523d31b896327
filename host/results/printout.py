"""A result for the terminal: the cycles, how far to trust the number, and last, where the eye is, the number itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.scoring.interval import NO_DRIFT
from analysis.scoring.recorded_parts import Losses
from analysis.scoring.result import Result
from analysis.scoring.result_parts import Diagnostics, PublishedDrift
from analysis.scoring.summary import doubt_text
from host.output.drawings import draw, open_console
from host.results.batch import BatchRow
from host.text import plain

MAX_ROWS = 12
"""Longer tables of cycles show their start and their end, unless all are asked for."""
MAX_LEFT_OUT = 4
"""Turning points left out that are named; the result has all."""
_BELOW_FLOOR = {
    "baseline": "below the sensor's floor: it cannot be distinguished from no drift at all",
    "rests": "below the floor that the rests inside the trial set: only a static baseline can show that it is drift",
}


def _render_score(result: Result, also: Sequence[tuple[str, str]], max_rows: int) -> RenderableType:
    """Return a result as a drawing; texts in it may come from files and are shown as they are, never as markup."""
    parts: list[RenderableType] = []
    if result.endpoints:
        parts += [_cycles(result, max_rows), Text("")]
    return Group(*parts, _trust(result, also), Text(""), _headline(result))


def print_score(
    result: Result,
    console: Console | None = None,
    *,
    also: Sequence[tuple[str, str]] = (),
    max_rows: int = MAX_ROWS,
    only_score: bool = False,
) -> None:
    """Print a result to standard output; where that is a file or a pipe, without the blanks that fill up a line.

    ``also`` is what a command adds, a name and a text each. Of more than ``max_rows`` end points, the first and the
    last are shown.
    """
    drawing = _headline(result) if only_score else _render_score(result, also, max_rows)
    draw(drawing, console or open_console())


def _headline(result: Result) -> Text:
    if result.theta_bar_deg is None:
        line = Text("no score", style="bold red")
        line.append(": " + "; ".join(plain(reason, 300) for reason in result.reasons), style="")
        return line
    line = Text()
    if doubt := doubt_text(result):  # above the number: that stays the last line, for whoever takes it from there
        line.append(f"{doubt}: the interval touches 0\n", style="yellow")
    line.append(f"rotation drift θ̄ = {result.theta_bar_deg:.3f}° per cycle", style="bold")
    if result.interval_deg is not None:
        low, high = result.interval_deg
        line.append(f"   95 % interval {low:.3f}° to {high:.3f}°", style="")
    if result.sensor is not None and result.sensor.below_floor:
        line.append(f"\n{_BELOW_FLOOR[result.sensor.source]}", style="bold yellow")
    return line


def _trust(result: Result, also: Sequence[tuple[str, str]]) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, value in _facts(result):
        grid.add_row(Text(name), Text(value))
    shown = {"" if result.sensor is None else result.sensor.note, f"θ̄ {NO_DRIFT}: the interval touches 0"}
    for warning in (warning for warning in result.warnings if warning not in shown):
        grid.add_row(Text("note", style="yellow"), Text(plain(warning, 400)))
    for name, value in also:
        grid.add_row(Text(name), Text(plain(value, 4096)))
    return grid


def _facts(result: Result) -> Iterator[tuple[str, str]]:
    yield "motion", ", ".join(_motion(result))
    if result.axis is not None and result.companions is not None:
        x, y, z = result.axis
        share = f"{result.companions.axis_share:.0%} of the stepping is along it"
        yield "drift axis", f"({x:+.3f}, {y:+.3f}, {z:+.3f}) in the world frame; {share}"
        yield from _diagnostics(result, result.companions)
    if result.as_published is not None:
        yield "published", _published(result.as_published)
    if result.sensor is not None:
        yield "sensor", plain(result.sensor.note, 300)
    if result.losses is not None:
        yield "losses", _losses(result.losses)
    yield "window", _window(result)
    if automatic := result.window.automatic:
        theta = automatic.theta_bar_deg
        found = "no score" if theta is None else f"θ̄ {theta:.3f}°"
        yield "automatic", f"{found} with {automatic.n_endpoints} end points found by the search"
    yield "read as", plain("; ".join((result.recording.convention, *result.recording.notes)), 600)


def _motion(result: Result) -> Iterator[str]:
    n, cycles = result.n_endpoints, result.cycles
    yield f"{_number(max(0, n - 1), 'cycle')} ({_number(n, 'end point')})"
    if result.period_s is not None:
        yield f"period {result.period_s:.3f} s (confidence {cycles.period_confidence or 0.0:.2f})"
    if cycles.swing_deg:
        yield f"swing {cycles.swing_deg:.1f}°"
        yield f"{cycles.axis_share or 0.0:.0%} of it about one axis"
    if cycles.humps > 1:
        yield f"{cycles.humps} peaks a cycle"


def _number(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _diagnostics(result: Result, found: Diagnostics) -> Iterator[tuple[str, str]]:
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
    if result.other_extreme is not None and result.other_extreme.theta_bar_deg is not None:
        at.append(f"the other extreme {result.other_extreme.theta_bar_deg:.3f}°")
    if found.over_phase_deg is not None:
        at.append(f"any phase {found.over_phase_deg.min:.3f}° to {found.over_phase_deg.max:.3f}°")
    if at:
        yield "θ̄ at", ", ".join(at)
    if found.translation_drift_mm is not None:
        yield "position", f"translation drift {found.translation_drift_mm:.3f} mm per cycle"


def _window(result: Result) -> str:
    window, start_s = result.window, result.recording.start_s
    text = {"from-to": "as given", "endpoints": "end points as given"}.get(window.kind, window.kind)
    if window.source not in ("", "given"):
        text += f" by {plain(window.source, 80)}"
    if window.from_s is not None and window.to_s is not None:
        text += f", {window.from_s - start_s:.2f} s to {window.to_s - start_s:.2f} s"
    if window.left_out:
        left = "; ".join(f"{item.time_s - start_s:.2f} s, {item.reason}" for item in window.left_out[:MAX_LEFT_OUT])
        more = len(window.left_out) - MAX_LEFT_OUT
        text += f"; left out: {plain(left, 400)}" + (f"; {more} more" if more > 0 else "")
    return text


def _published(published: PublishedDrift) -> str:
    text = f"{published.euler_drift_deg:.4f}° by the authors' script, its array cleared; "
    if published.stale_rows:
        left = ", ".join(f"{count} of motion {k}" for k, count in enumerate(published.stale_of, 1) if count)
        uncleared_deg = published.euler_drift_as_published_deg
        return text + (
            f"{uncleared_deg:.4f}° with {published.stale_rows} steps of earlier motions left in it "
            f"({left} given with --preceding)"
        )
    if published.stale_of:
        return text + "the same as published: no earlier motion had more cycles"
    return text + "the same as published, unless a longer motion came before (--preceding)"


def _losses(losses: Losses) -> str:
    if not losses.missing:
        return f"none of {losses.produced} samples"
    in_file = f", {losses.damaged_in_file} damaged in the file" if losses.damaged_in_file else ""
    return (
        f"{losses.missing} of {losses.produced} samples ({100 * losses.share:.2f} %): {losses.lost} on the link, "
        f"{losses.rejected} damaged, {losses.dropped_by_device} dropped by the object{in_file}"
    )


def _cycles(result: Result, max_rows: int) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    for name in ("cycle", result.index_kind, "time", "period", "step"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", overflow="fold", min_width=12)  # the one column that may fold: numbers stay whole
    points, start_s = result.endpoints, result.recording.start_s
    shown_at_end = max_rows // 2
    skipped = range(max_rows - shown_at_end, len(points) - shown_at_end) if len(points) > max_rows else range(0)
    for k, point in enumerate(points):
        if k in skipped:
            if k == skipped.start:
                more = f"{len(skipped)} more (score --cycles all)"
                table.add_row("…", "", "", "", "", Text(more, style="dim"))
            continue
        table.add_row(
            Text(str(k) if k else "start"),
            Text(str(point.index)),
            Text(f"{point.time_s - start_s:.3f} s"),
            Text(f"{point.time_s - points[k - 1].time_s:.3f} s" if k else ""),
            Text(f"{result.steps_deg[k - 1]:.3f}°" if k and result.steps_deg else ""),
            Text(plain(", ".join([*point.flags, point.reason] if point.reason else point.flags)), style="yellow"),
        )
    return table


NARROW = 100
"""Terminals below this many columns get fewer figures, so that the names stay whole."""
UNBOUND = 160
"""Columns where the output is not a terminal: nothing is folded in a file."""

_WIDE_COLUMNS = ("θ̄", "95 % interval", "cycles", "period", "other end", "flags", "notes")
_COLUMNS = ("θ̄", "95 % interval", "cycles", "notes")


def print_batch(rows: Sequence[BatchRow], console: Console | None = None, *, only_scores: bool = False) -> None:
    """Print a table of many recordings to standard output."""
    console = console or open_console()
    if only_scores:
        for row in rows:
            line = Text(f"{plain(_tail(row.path), 200)}: ")
            line.append_text(Text(plain(row.error, 300)) if row.result is None else _headline(row.result))
            console.print(line, soft_wrap=True)
        return
    if not console.is_terminal:
        console.width = max(console.width, UNBOUND)
    console.print(_render_batch(rows, _COLUMNS if console.width < NARROW else _WIDE_COLUMNS))


def _render_batch(rows: Sequence[BatchRow], columns: Sequence[str]) -> RenderableType:
    """Return a table of many recordings, one line each, and below it why some have no result."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    table.add_column("recording", overflow="fold")
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    reasons: list[Text] = []
    for row in rows:
        name = plain(_tail(row.path), 200) + ("" if row.session is None else f" session {row.session}")
        result = row.result
        why = (row.error,) if row.error else () if result is None else result.reasons
        reasons += [Text(f"{name}: {plain(reason, 300)}", style="yellow") for reason in why]
        if result is None or result.theta_bar_deg is None:
            table.add_row(Text(name), Text("no score", style="red"), *[""] * (len(columns) - 1))
        else:
            cells = _cells(result, result.theta_bar_deg)
            table.add_row(Text(name), *(cells[column] for column in columns))
    doubtful = [plain(_tail(row.path), 200) for row in rows if row.result is not None and doubt_text(row.result)]
    if doubtful:
        reasons.append(Text(f"θ̄ {NO_DRIFT}: {', '.join(doubtful)}", style="yellow"))
    scored = sum(row.result is not None and row.result.theta_bar_deg is not None for row in rows)
    summary = Text(f"\n{scored} of {len(rows)} recordings scored; `rotdrift score FILE` shows more of one")
    return Group(table, *reasons, summary)


def _cells(result: Result, theta_bar_deg: float) -> dict[str, Text | str]:
    interval = result.interval_deg
    other = None if result.other_extreme is None else result.other_extreme.theta_bar_deg
    theta = Text(f"{theta_bar_deg:.3f}°", style="bold")
    if result.sensor is not None and result.sensor.below_floor:
        theta = Text("below floor ", style="yellow") + theta
    return {
        "θ̄": theta,
        "95 % interval": "–" if interval is None else f"{interval[0]:.3f}° to {interval[1]:.3f}°",
        "cycles": str(result.n_endpoints - 1),
        "period": f"{result.period_s:.2f} s",
        "other end": "–" if other is None else f"{other:.3f}°",
        "flags": str(sum(bool(flags) for flags in result.flags)),
        "notes": str(len(result.warnings)),
    }


def _tail(path: Path) -> str:
    """Return folder and name of a file: enough to distinguish recordings."""
    return str(Path(*path.parts[-2:]))
