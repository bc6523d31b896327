"""The live screen: a picture of a :class:`~host.trial_state.TrialState`, drawn with rich.

:func:`render` is pure: the same state gives the same picture. Names come from devices and files, so every text is a
:class:`rich.text.Text`, never a markup string. Colour is never the only carrier of a meaning.
"""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from host.big_digits import big_text
from host.trial_state import CycleRow, TrialState

FALLBACK_HEIGHT = 24
FIXED_LINES = 15
"""Lines of the screen that are not rows of the cycle table."""
MIN_ROWS = 3
BAR_CELLS = 14

GOOD, DOUBTFUL, BAD, QUIET = "green", "yellow", "bold red", "dim"


def render(state: TrialState) -> RenderableType:
    """Draw a state; it fits the height and width it is given, from 80 x 24 on.

    Parameters
    ----------
    state : TrialState
        The moment to draw.
    """
    return _Screen(state)


class _Screen:
    """A picture that knows its height only when it is drawn."""

    def __init__(self, state: TrialState) -> None:
        self._state = state

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        height = options.height or FALLBACK_HEIGHT
        warnings = _warnings(self._state)[-3:]
        rows = max(MIN_ROWS, height - FIXED_LINES - len(warnings))
        yield Group(
            _score_panel(self._state, options.max_width),
            _cycle_table(self._state, rows),
            _status_panel(self._state),
            *(Text(f"! {warning}", style=DOUBTFUL, overflow="ellipsis", no_wrap=True) for warning in warnings),
        )


def _score_panel(state: TrialState, width: int) -> Panel:
    number = "-.--" if state.theta_bar_deg is None else f"{state.theta_bar_deg:.2f}"
    digits = big_text(f"{number}°")
    kind = "result" if state.finished else "so far"
    side = [
        Text(f"rotation drift θ̄ {kind}, per cycle", style="bold"),
        _interval(state),
        _progress(state),
    ]
    grid = Table.grid(padding=(0, 3))
    grid.add_row(Text("\n".join(digits), style="bold cyan", no_wrap=True), Group(*side))
    name = state.sensor.name or "sensorized object"
    title = Text(f" {state.title} · {name} ", style="bold", overflow="ellipsis", no_wrap=True)
    title.truncate(max(10, width - 8), overflow="ellipsis")
    return Panel(grid, title=title, title_align="left", border_style="cyan", padding=(0, 1))


def _interval(state: TrialState) -> Text:
    if state.interval_deg is None:
        missing = max(0, 4 - state.n_cycles)
        return Text(f"95 % interval: needs {missing} more cycles" if missing else "95 % interval: none", style=QUIET)
    low, high = state.interval_deg
    return Text(f"95 % interval {low:.2f}° to {high:.2f}°")


def _progress(state: TrialState) -> Text:
    minutes, seconds = divmod(int(state.elapsed_s), 60)
    target = "" if state.target_cycles is None else f" of {state.target_cycles}"
    until = "" if state.target_s is None else f" of {state.target_s:.0f} s"
    return Text(f"{state.n_cycles}{target} cycles · {minutes:02d}:{seconds:02d}{until}")


def _cycle_table(state: TrialState, n_rows: int) -> Table:
    table = Table(expand=True, box=None, padding=(0, 1), header_style="bold", pad_edge=True)
    table.add_column("cycle", justify="right", width=5)
    table.add_column("time", justify="right", width=9)
    table.add_column("period", justify="right", width=8)
    table.add_column("step", justify="right", width=8)
    table.add_column("", width=BAR_CELLS, no_wrap=True)
    table.add_column("θ̄", justify="right", width=7)
    table.add_column("", ratio=1, no_wrap=True, overflow="ellipsis")
    rows = state.cycles[-n_rows:]
    longest = max((row.step_deg or 0.0 for row in state.cycles), default=0.0)
    for row in rows:
        table.add_row(*_cells(row, longest))
    for number in range(n_rows - len(rows)):
        waiting = Text(_waiting(state), style=QUIET) if number == 0 and not rows else Text("")
        table.add_row(*[""] * 4, waiting, *[""] * 2)
    return table


def _cells(row: CycleRow, longest_deg: float) -> tuple[Text, ...]:
    flagged = DOUBTFUL if row.flags else ""
    share = 0.0 if row.step_deg is None or longest_deg <= 0 else row.step_deg / longest_deg
    return (
        Text(str(row.number) if row.number else "start"),
        Text(f"{row.time_s:.2f} s"),
        Text("" if row.period_s is None else f"{row.period_s:.3f} s"),
        Text("" if row.step_deg is None else f"{row.step_deg:.3f}°", style=flagged),
        Text("━" * max(1 if row.step_deg else 0, round(share * BAR_CELLS)), style=flagged or "cyan"),
        Text("" if row.theta_bar_deg is None else f"{row.theta_bar_deg:.3f}°"),
        Text(", ".join(row.flags), style=DOUBTFUL),
    )


def _waiting(state: TrialState) -> str:
    if state.sensor.orientation_wxyz is None:
        return "no data yet"
    return "waiting for cycles"


def _status_panel(state: TrialState) -> Panel:
    grid = Table.grid(padding=(0, 2), expand=True)
    grid.add_column(width=9, style=QUIET)
    grid.add_column(ratio=1, no_wrap=True, overflow="ellipsis")
    grid.add_row(Text("motion"), _motion_line(state))
    grid.add_row(Text("sensor"), _sensor_line(state))
    grid.add_row(Text("link"), _link_line(state))
    grid.add_row(Text("losses"), _loss_line(state))
    grid.add_row(Text("recording"), _recording_line(state))
    return Panel(grid, border_style=QUIET, padding=(0, 1))


def _motion_line(state: TrialState) -> Text:
    motion = state.motion
    parts = [motion.phase]
    if motion.period_s is not None:
        parts.append(f"period {motion.period_s:.2f} s")
    if motion.swing_deg is not None:
        parts.append(f"swing {motion.swing_deg:.1f}°")
    line = Text(" · ".join(parts))
    if motion.flags:
        line.append(" · " + ", ".join(motion.flags), style=DOUBTFUL)
    return line


def _sensor_line(state: TrialState) -> Text:
    sensor = state.sensor
    line = Text("no data" if sensor.still is None else "still" if sensor.still else "moving")
    if sensor.temperature_c is not None:
        line.append(f" · {sensor.temperature_c:.1f} °C")
    if sensor.battery_v is not None:
        line.append(f" · {sensor.battery_v:.2f} V")
    if sensor.saturated:
        line.append(" · SATURATED", style=BAD)
    return line


def _link_line(state: TrialState) -> Text:
    link = state.link
    rate = "- Hz" if link.rate_hz is None else f"{link.rate_hz:.1f} Hz"
    expected = "" if link.expected_rate_hz is None else f" of {link.expected_rate_hz:.0f}"
    off = (
        link.rate_hz is not None
        and link.expected_rate_hz is not None
        and abs(link.rate_hz / link.expected_rate_hz - 1) > 0.05
    )
    line = Text(f"{rate}{expected}", style=DOUBTFUL if off else "")
    if not link.connected:
        line.append(" · DISCONNECTED", style=BAD)
    elif link.silent_s > 1.0:
        line.append(f" · silent for {link.silent_s:.0f} s", style=BAD)
    if link.segments > 1:
        line.append(f" · {link.segments - 1} resets", style=DOUBTFUL)
    if link.one_way:
        line.append(" · does not answer", style=DOUBTFUL)
    if link.skew_ppm is not None:
        line.append(f" · clock {link.skew_ppm:+.1f} ppm")
    if link.jitter_p99_ms is not None:
        line.append(f" · jitter p99 {link.jitter_p99_ms:.2f} ms")
    line.append(f" · {link.name}", style=QUIET)
    return line


def _loss_line(state: TrialState) -> Text:
    losses, link = state.link.losses, state.link
    if not losses.missing and not link.overflow_chunks:
        line = Text(f"none of {losses.produced}", style=GOOD)
    else:
        line = Text(
            f"{losses.lost} lost · {losses.rejected} damaged · {losses.dropped} dropped · {100 * losses.share:.2f} %",
            style=BAD if losses.share > 0.01 else DOUBTFUL,
        )
    if link.overflow_chunks:
        line.append(f" · {link.overflow_chunks} chunks not taken in time", style=BAD)
    return line


def _recording_line(state: TrialState) -> Text:
    recording = state.recording
    line = Text(f"{recording.n_bytes / 1e6:.1f} MB")
    if recording.free_bytes is not None:
        line.append(f" · {recording.free_bytes / 1e9:.1f} GB free")
    line.append(f" · {recording.path}", style=QUIET)
    if recording.problem:
        line = Text(recording.problem, style=BAD)
    return line


def _warnings(state: TrialState) -> list[str]:
    warnings = list(state.warnings)
    if state.recording.problem:
        warnings.append(state.recording.problem)
    return warnings
