"""Many results as one table for people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from host.plain_text import plain
from host.scoring.batch import BatchRow

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
