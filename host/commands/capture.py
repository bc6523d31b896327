"""``rotdrift capture``: record a trial live, watch the drift, score it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "capture",
        help="record a trial live and score it",
        description=(
            "Open the link, start the object, record everything it sends, show the drift per cycle, and score the "
            "trial at the end. Ctrl-C ends it in order: the recording is closed and the score printed."
        ),
    )
    parser.add_argument("link", metavar="LINK", help="serial:/dev/ttyACM0, serial:COM3, serial:socket://HOST:PORT, ...")
    parser.add_argument("--cycles", type=_whole, metavar="N", help="end after N cycles")
    parser.add_argument("--duration", type=_seconds, metavar="S", help="end S seconds after the first sample")
    parser.add_argument("--out", type=Path, metavar="FILE", help="recording to write (default: rotdrift-trials/DATE)")
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
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object, and nothing else")


def run(args: argparse.Namespace) -> int:
    """Capture and score.

    Raises
    ------
    HostError
        What went wrong, with the mend.
    """
    from datetime import datetime

    from host.capture import CaptureSettings
    from host.capture_run import default_recording, run_capture
    from host.errors import UsageError
    from host.result import ScoreOptions, result_text
    from host.screen import open_screen
    from host.session import SessionSettings
    from host.stop_signals import StopSignals

    if args.rate is not None and not 10 <= args.rate <= 1000:
        raise UsageError(f"an object streams at 10 to 1000 Hz, not at {args.rate} Hz", "give another --rate")
    recording = args.out or default_recording(datetime.now().astimezone())
    if recording.suffix != ".mcap":
        recording = recording.with_name(recording.name + ".mcap")
    settings = CaptureSettings(
        cycles=args.cycles,
        duration_s=args.duration,
        session=SessionSettings(rate_hz=args.rate),
        reconnect_s=args.reconnect,
        debug_link=args.debug_link,
    )
    with StopSignals() as signals:
        finished = run_capture(
            args.link,
            recording,
            settings,
            open_screen(args.json),
            signals.stop,
            ScoreOptions(baseline=args.baseline),
        )
    if args.json:
        sys.stdout.write(result_text(finished.score))
    else:
        from host.score_view import print_score

        print_score(finished.score)
        sys.stdout.write(f"recording  {finished.recording}\nresult     {finished.result}\n")
    sys.stdout.flush()
    if finished.outcome.error is not None:
        raise finished.outcome.error
    return 0 if finished.score.valid else 1


def _whole(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 0 < int(text) < 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time in seconds above 0")
    return value


def _wait(text: str) -> float:
    return 0.0 if text == "0" else _seconds(text)
