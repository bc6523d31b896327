"""``rotdrift demo``: the whole job without hardware, beside the truth."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.scoring.result import Result


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "demo",
        help="capture from a virtual object and compare with the truth",
        description=(
            "Start a virtual object in a second process, on a real serial device (a pty; on Windows a TCP port), "
            "capture from it as from any other, and print the drift that was measured beside the true one."
        ),
    )
    parser.add_argument("--cycles", type=int, default=10, metavar="N", help="end after N cycles (default: 10)")
    parser.add_argument("--scenario", default="default", metavar="NAME|FILE", help="what the virtual object does")
    parser.add_argument("--fast", action="store_true", help="cycles of 0.8 s in place of 4 s: done in ten seconds")
    parser.add_argument("--out", type=Path, metavar="FILE", help="recording to write (default: rotdrift-trials/DATE)")


def run(args: argparse.Namespace) -> int:
    """Run the demonstration."""
    from datetime import datetime

    from emulator import ScenarioError
    from emulator.scenario import load_scenario
    from host.capture.run import default_recording, run_capture
    from host.capture.settings import CaptureSettings
    from host.errors import UsageError
    from host.output.lines import write_line
    from host.results.printout import print_score
    from host.screen.choice import open_screen
    from host.stop_signals import stop_on_signals
    from host.virtual_object_process import VirtualObjectProcess

    if not 3 <= args.cycles <= 1000:
        raise UsageError(f"{args.cycles} is not a valid number of cycles", "give --cycles from 3 to 1000")
    scenario = "fast" if args.fast else args.scenario
    try:
        heading_drift = load_scenario(scenario).imu.heading_drift_deg_per_min
    except ScenarioError as error:
        raise UsageError(str(error)) from error
    recording = args.out or default_recording(datetime.now().astimezone())
    write_line(f"starting a virtual object (scenario {scenario}) ...")
    with VirtualObjectProcess(scenario) as virtual:
        write_line(f"capturing {args.cycles} cycles from {virtual.link}; Ctrl-C ends it")
        with stop_on_signals() as stop:
            finished = run_capture(
                virtual.link, recording, CaptureSettings(cycles=args.cycles), open_screen(False), stop
            )
        truth = virtual.stop()
    print_score(finished.score, also=finished.places())
    _print_truth(finished.score, truth, heading_drift)
    if finished.outcome.error is not None:
        raise finished.outcome.error
    return 0 if finished.score.valid else 1


def _print_truth(score: Result, truth: dict[str, Any], heading_drift_deg_per_min: float) -> None:
    from rich.text import Text

    from host.output.drawings import open_console

    true_deg = true_drift_deg(score, truth)
    line = Text("\n")
    if true_deg is None or score.theta_bar_deg is None:
        line.append("the truth of the virtual object could not be compared", style="yellow")
    else:
        interval = "" if score.interval is None else f" ± {score.interval.half_width_deg:.3f}°"
        line.append(f"measured θ̄ = {score.theta_bar_deg:.3f}°{interval}", style="bold")
        line.append("    ")
        line.append(f"true θ̄ = {true_deg:.3f}°", style="bold green")
        line.append(f"    difference {score.theta_bar_deg - true_deg:+.3f}°")
        if heading_drift_deg_per_min and score.period_s is not None:
            share_deg = abs(heading_drift_deg_per_min) * score.period_s / 60.0
            line.append(f"\nof which up to {share_deg:.3f}° is the virtual sensor's own heading drift")
    open_console().print(line)


def true_drift_deg(score: Result, truth: dict[str, Any]) -> float | None:
    """Return the true θ̄, degrees, of the very end points that were scored, from what the virtual object recorded.

    None where the truth does not know as many end points there. End points name samples by sequence number.
    """
    from analysis.scoring.card import rotation_drift

    if len(score.endpoints) < 2:
        return None
    reach = 0.4 * (score.endpoints[1].index - score.endpoints[0].index)
    for extreme in (truth, truth.get("other_extreme") or {}):
        known = [point for point in extreme.get("endpoints", ()) if point.get("sequence") is not None]
        quats = [
            point["quat_wxyz"]
            for point in known
            if score.endpoints[0].index - reach <= point["sequence"] <= score.endpoints[-1].index + reach
        ]
        if len(quats) == len(score.endpoints):
            return rotation_drift(quats).theta_bar_deg
    return None
