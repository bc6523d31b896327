"""``rotdrift capture``: record a trial live, watch the drift, score it."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.capture.run import FinishedCapture
    from host.capture.settings import CaptureSettings
    from host.results.result import ScoreOptions
    from host.screen.screens import Screen

ANOTHER_KIND = re.compile(r"\.[A-Za-z][A-Za-z0-9]{1,7}")
"""Ending of another kind of file; ``run_0.5`` has none."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    from host.commands import seconds

    parser = subparsers.add_parser(
        "capture",
        help="record a trial live and score it",
        description=(
            "Open the link, start the object, record everything it sends, show the drift per cycle, and score the "
            "trial at the end. Ctrl-C ends it in order: the recording is closed and the score printed."
        ),
    )
    parser.add_argument(
        "link",
        metavar="LINK",
        nargs="*",
        help="serial:/dev/ttyACM0, serial:COM3, serial:socket://HOST:PORT, can:INTERFACE:CHANNEL, ...; several: as "
        "many objects at once (default: `rotdrift config link`)",
    )
    parser.add_argument("--cycles", type=_whole, metavar="N", help="end after N cycles")
    parser.add_argument("--duration", type=seconds, metavar="S", help="end S seconds after the first sample")
    parser.add_argument(
        "--until",
        type=_until,
        metavar="ci=DEG",
        help="end when the interval of the drift is within ±DEG, e.g. ci=0.2deg",
    )
    parser.add_argument("--guide", action="store_true", help="lead through the trial: rest, start, cycles, rest")
    parser.add_argument("--rest", type=seconds, default=10.0, metavar="S", help="rest of a guided trial (default: 10)")
    parser.add_argument("--bell", action="store_true", help="ring at every alarm and at the end")
    parser.add_argument("--ascii", action="store_true", help="draw with ASCII only")
    parser.add_argument("--theme", choices=("auto", "dark", "light"), default="auto", help="background of the terminal")
    parser.add_argument("--plain", action="store_true", help="a line per cycle in place of the dashboard")
    parser.add_argument("--out", type=Path, metavar="FILE", help="recording to write (default: DATE in --folder)")
    parser.add_argument(
        "--folder",
        type=Path,
        metavar="DIR",
        help="where recordings go (default: rotdrift-trials; `rotdrift config folder`)",
    )
    parser.add_argument("--rate", type=_whole, metavar="HZ", help="orientation rate to ask the object for, 10-1000")
    parser.add_argument("--baseline", type=Path, metavar="FILE", help="static baseline of the sensor, for the score")
    parser.add_argument(
        "--reconnect",
        type=_wait,
        default=30.0,
        metavar="S",
        help="wait so long for a lost link to come back (default: 30; 0 ends the capture at once)",
    )
    parser.add_argument("--debug-link", type=Path, metavar="FILE", help="write down what crosses the link, in hex")
    parser.add_argument("--quiet", action="store_true", help="print the score alone at the end")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object, and nothing else")


def run(args: argparse.Namespace) -> int:
    """Capture and score."""
    from datetime import datetime

    from analysis.scoring.result import result_text
    from host.capture.guide import GuideSettings
    from host.capture.run import DEFAULT_FOLDER, default_recording, run_capture
    from host.capture.settings import CaptureSettings
    from host.errors import UsageError
    from host.output.lines import write_json
    from host.results.result import ScoreOptions
    from host.screen.choice import ScreenChoice, open_screen
    from host.stop_signals import stop_on_signals
    from host.stream.session import SessionSettings

    if args.rate is not None and not 10 <= args.rate <= 1000:
        raise UsageError(f"an object streams at 10 to 1000 Hz, not at {args.rate} Hz", "give another --rate")
    links = [args.link] if isinstance(args.link, str) else args.link  # one text: the default of a configuration
    if not links:
        raise UsageError("a capture needs a LINK", "`rotdrift ports` lists them; `rotdrift config link LINK` keeps one")
    recording = args.out or default_recording(datetime.now().astimezone(), args.folder or DEFAULT_FOLDER)
    if recording.suffix != ".mcap":
        if ANOTHER_KIND.fullmatch(recording.suffix):
            raise UsageError(
                f"{recording.name} is not a name for a recording",
                "end it in .mcap; `rotdrift convert` writes other formats",
            )
        recording = recording.with_name(recording.name + ".mcap")
    settings = CaptureSettings(
        cycles=args.cycles,
        duration_s=args.duration,
        session=SessionSettings(rate_hz=args.rate),
        reconnect_s=args.reconnect,
        debug_link=args.debug_link,
        until_half_width_deg=args.until,
        guide=GuideSettings(args.rest, args.cycles or GuideSettings().cycles) if args.guide else None,
    )
    screen = open_screen(args.json, choice=ScreenChoice(args.ascii, args.theme, args.bell, args.plain))
    options = ScoreOptions(baseline=args.baseline)
    if len(links) > 1:
        return _run_several(links, args.json, args.quiet, recording, settings, screen, options)
    with stop_on_signals() as stop:
        finished = run_capture(links[0], recording, settings, screen, stop, options)
    if args.json:
        write_json(result_text(finished.score))
    else:
        _print(finished, args.quiet)
    if finished.outcome.error is not None:
        raise finished.outcome.error
    return 0 if finished.score.valid else 1


def _print(finished: FinishedCapture, only_score: bool) -> None:
    from host.capture.snapshot import difference_fact
    from host.results.printout import print_score

    live_deg = finished.outcome.last_state.score.theta_bar_deg
    also = *difference_fact(live_deg, finished.score), *finished.places()
    print_score(finished.score, also=also, only_score=only_score)


def _run_several(
    links: list[str],
    as_json: bool,
    only_score: bool,
    recording: Path,
    settings: CaptureSettings,
    screen: Screen,
    options: ScoreOptions,
) -> int:
    """Capture several objects at once, each with a recording of its own."""
    from analysis.scoring.result import result_text
    from host.capture.several import capture_several
    from host.errors import UsageError
    from host.output.lines import write_json, write_lines, write_note
    from host.stop_signals import stop_on_signals

    if settings.debug_link is not None:
        raise UsageError("--debug-link writes down one link", "capture one object at a time with it")
    paths = [recording.with_stem(f"{recording.stem}-{number}") for number in range(1, len(links) + 1)]
    with stop_on_signals() as stop:
        outcomes = capture_several(links, paths, settings, screen, stop, options)
    if as_json:
        results = [
            {"link": item.link, "error": item.error and str(item.error), "result": item.result} for item in outcomes
        ]
        write_json(result_text({"results": results}))
    for item in outcomes:
        finished = item.finished
        if finished is None:
            write_note(f"{item.link}: {item.error}")
        elif not as_json:
            write_lines(("", item.link))
            _print(finished, only_score)
    return max(item.exit_code for item in outcomes)


def _until(text: str) -> float:
    kind, _, value = text.partition("=")
    if kind != "ci":
        raise argparse.ArgumentTypeError(f"{text!r} is not a valid target; give ci=0.2deg")
    try:
        angle_deg = float(value.removesuffix("deg").removesuffix("°"))
    except ValueError:
        angle_deg = 0.0
    if not 0 < angle_deg <= 180:
        raise argparse.ArgumentTypeError(f"{value!r} is not an angle above 0; give ci=0.2deg")
    return angle_deg


def _whole(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 0 < int(text) < 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def _wait(text: str) -> float:
    from host.commands import seconds

    return 0.0 if text == "0" else seconds(text)
