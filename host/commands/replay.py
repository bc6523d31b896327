"""``rotdrift replay``: a recording through the same path as a live capture."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "replay",
        help="run a recording through the live view and score it",
        description="Feed a recording through the same path as a live capture, and score it.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="recording (.mcap) that `rotdrift capture` wrote")
    parser.add_argument(
        "--speed", type=_speed, default=0.0, metavar="X", help="1: as fast as it was; default: as fast as it is read"
    )
    parser.add_argument("--ascii", action="store_true", help="draw with ASCII only")
    parser.add_argument("--theme", choices=("auto", "dark", "light"), default="auto", help="background of the terminal")
    parser.add_argument("--plain", action="store_true", help="a line per cycle in place of the dashboard")
    parser.add_argument("--quiet", action="store_true", help="print the score alone")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object, and nothing else")


def run(args: argparse.Namespace) -> int:
    """Replay and score.

    Raises
    ------
    FileError
        Not a recording.
    """
    from analysis.scoring.result import result_text
    from analysis.series import AnalysisError
    from host.capture.playback import play, recorded_actions, recorded_commands
    from host.capture.snapshot import difference_fact, finished_state
    from host.errors import FileError
    from host.output.lines import write_json
    from host.recording.load import load_trial, node_of
    from host.recording.replay_link import ReplayTransport
    from host.results.printout import print_score
    from host.results.result import ScoreOptions, score_trial
    from host.screen.choice import ScreenChoice, open_screen
    from host.screen.guarded_screen import guarded
    from host.stop_signals import stop_on_signals
    from host.trial.live import Trial

    with ReplayTransport(args.file, args.speed) as transport, stop_on_signals() as stop:
        screen = guarded(open_screen(args.json, choice=ScreenChoice(args.ascii, args.theme, plain_lines=args.plain)))
        then = recorded_actions(args.file), recorded_commands(args.file)
        trial = None
        node = node_of(transport.recording.header)
        screen.start()
        try:
            live = play(transport, Trial(node), screen, stop, args.speed, *then, title="rotdrift replay")
            trial = load_trial(args.file)
            score = score_trial(trial, ScoreOptions(clock=args.json))
            if live is not None:
                screen.update(finished_state(live, score))
        except AnalysisError as error:
            damaged = "" if trial is None else trial.why_unscored
            raise FileError(f"{args.file} cannot be scored ({error}){damaged}") from error
        finally:
            screen.stop()
    if args.json:
        write_json(result_text(score))
    else:
        also = () if live is None else difference_fact(live.score.theta_bar_deg, score)
        print_score(score, also=also, only_score=args.quiet)
    return 0 if score.valid else 1


def _speed(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is not a speed: 1 is real time, 0 as fast as possible")
    return value
