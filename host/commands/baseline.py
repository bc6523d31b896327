"""``rotdrift baseline``: measure the sensor at rest, so that a score can state the sensor's own share."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.sensor.baseline import StaticBaseline
    from analysis.series import OrientationSeries

DEFAULT_DURATION_S = 60.0
PERIODS_S = (2.0, 5.0, 10.0)
"""Cycle lengths for which the sensor's share is shown; a trial shows its own."""
CYCLES_SHOWN = 10


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    from host.commands import seconds
    from host.results.arguments import add_read_arguments

    parser = subparsers.add_parser(
        "baseline",
        help="measure the sensor at rest",
        description=(
            "Put the object on a table and do not touch it: its heading drift and noise are measured, from a link or "
            "from a recording, and written to a small TOML file for the --baseline of `score`, `capture` and `report`."
        ),
        epilog="example: rotdrift baseline serial:/dev/ttyACM0 --duration 120 --out imu.toml",
    )
    parser.add_argument(
        "source",
        metavar="LINK|FILE",
        nargs="?",
        help="link to the object (default: `rotdrift config link`), or a recording of it at rest",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: print only)")
    parser.add_argument(
        "--duration", type=seconds, metavar="S", help=f"how long to listen (default: {DEFAULT_DURATION_S:.0f} s)"
    )
    add_read_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object, and nothing else")


def run(args: argparse.Namespace) -> int:
    """Measure a baseline, print it, and write it.

    Raises
    ------
    HostError
        The recording is too short for a baseline, or the object moved.
    FileError
        FILE is not a recording, or --out exists already.
    LinkError
        The link cannot be opened, or nothing came from it.
    """
    from analysis.sensor.baseline import measure_baseline
    from analysis.sensor.baseline_file import save_baseline
    from analysis.series import BaselineError
    from host.errors import HostError, UsageError, already_there, unwritable
    from host.output.lines import write_json, write_line

    if args.source is None:
        raise UsageError("a baseline needs a LINK or a FILE", "`rotdrift ports` lists the links")
    if args.out is not None and args.out.exists():
        raise already_there(args.out)
    path = Path(args.source)
    # A recording is a file, or the folder of a bag; a device is neither.
    is_recording = path.is_file() or path.is_dir()
    series, temperatures_c = _from_file(path, args) if is_recording else _from_link(args)
    try:
        baseline = measure_baseline(series, temperatures_c)
    except BaselineError as error:
        raise HostError(str(error)) from error
    if args.json:
        import dataclasses
        import json

        write_json(json.dumps(dataclasses.asdict(baseline), indent=2, allow_nan=False) + "\n")
    else:
        _print(baseline)
    if args.out is not None:
        try:
            args.out.parent.mkdir(parents=True, exist_ok=True)
            save_baseline(baseline, args.out)
        except OSError as error:
            raise unwritable(args.out, error) from error
        if not args.json:
            write_line(f"baseline   {args.out}")
    return 0


def _from_file(path: Path, args: argparse.Namespace) -> tuple[OrientationSeries, Sequence[float]]:
    from host.results.any_file import read_recording
    from host.results.arguments import reading

    how = reading(args.columns, args.rate, args.topic, args.node, args.sensor, args.channel, args.session)
    series, trial = read_recording(path, how)
    return series, () if trial is None else trial.temperatures_c


def _from_link(args: argparse.Namespace) -> tuple[OrientationSeries, Sequence[float]]:
    import tempfile
    from dataclasses import replace

    from analysis.series import SeriesError
    from host.capture.run import record
    from host.capture.settings import CaptureSettings
    from host.errors import LinkError
    from host.output.lines import error_stream, write_line
    from host.recording.load import load_trial
    from host.screen.screens import QuietScreen
    from host.stop_signals import stop_on_signals

    duration_s = args.duration or DEFAULT_DURATION_S

    class Patience(QuietScreen):
        def start(self) -> None:  # the link is open
            write_line(f"leave the object alone for {duration_s:.0f} s; Ctrl-C ends it early", error_stream())

    with tempfile.TemporaryDirectory(prefix="rotdrift-") as folder, stop_on_signals() as stop:
        recording = Path(folder) / "rest.mcap"
        settings = CaptureSettings(duration_s=duration_s)
        outcome = record(args.source, recording, settings, Patience(), stop)
        if outcome.error is not None:
            raise outcome.error
        try:
            trial = load_trial(recording, outcome.unwritten)
        except SeriesError as error:
            raise LinkError(f"the data from {args.source} give no baseline ({error})", "check the link") from error
    return replace(trial.series, source=args.source), trial.temperatures_c


def _print(baseline: StaticBaseline) -> None:
    from rich.table import Table
    from rich.text import Text

    from host.output.drawings import open_console
    from host.text import plain

    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column(overflow="fold")
    rates = ", ".join(
        f"{axis} {rate:+.3f} ± {error:.3f}"
        for axis, rate, error in zip("xyz", baseline.rate_deg_per_min, baseline.rate_error_deg_per_min, strict=True)
    )
    rows = [
        ("per axis", f"{rates} °/min (world frame, ± standard error)"),
        ("noise", f"{baseline.noise_deg:.4f}° per sample (root mean square)"),
        ("measured", f"{baseline.duration_s:.1f} s at rest, {baseline.n_samples} samples"),
    ]
    if baseline.temperature_c is not None:
        low, high = baseline.temperature_c
        rows.append(("sensor", f"{low:.1f} to {high:.1f} °C"))
    if baseline.allan:
        best = min(baseline.allan, key=lambda point: point.deviation_deg_per_min)
        deviation = f"Allan deviation of the rate {best.deviation_deg_per_min:.3f} °/min at {best.tau_s:.0f} s"
        rows.append(("stability", deviation))
    for period_s in PERIODS_S:
        share = (
            f"the sensor adds up to {baseline.per_cycle_deg(period_s):.4f}° per cycle; smallest drift that shows "
            f"above it in {CYCLES_SHOWN} cycles: {baseline.detectable_deg(period_s, CYCLES_SHOWN + 1):.4f}°"
        )
        rows.append((f"{period_s:.0f} s cycles", share))
    rows += [("note", plain(note, 300)) for note in baseline.notes]
    for name, value in rows:
        grid.add_row(Text(name), Text(value))
    console = open_console()
    console.print(Text(f"heading drift {baseline.total_rate_deg_per_min:.3f} °/min at rest", style="bold"))
    console.print(grid)
