"""``rotdrift score``: score a recording, of ours or of anybody."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.trial_score import TrialScore


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "score",
        help="score a recording",
        description=(
            "Score a recording by the benchmark card: our own .mcap, the benchmark authors' CSV, CSV with named "
            "columns, TUM, x-IMU3, parquet, ROS bags, logs of CAN tools. The format is recognised from the content."
        ),
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="what to score")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object, and nothing else")
    parser.add_argument(
        "--endpoints", metavar="ROWS|CSV", help="end points chosen by hand: 1175,1639 (rows), 12.5s,17.1s, or a CSV"
    )
    parser.add_argument("--from", dest="start", type=float, metavar="S", help="begin of the window")
    parser.add_argument("--to", dest="end", type=float, metavar="S", help="end of the window")
    parser.add_argument("--columns", metavar="SPEC", help="what the columns are: t=time,qw=w,qx=x,qy=y,qz=z")
    parser.add_argument("--rate", type=float, metavar="HZ", help="sampling rate where the file has no time stamps")
    parser.add_argument("--topic", metavar="NAME", help="which topic of a bag")
    parser.add_argument(
        "--node", type=int, metavar="N", help="node id of the object in a CAN log; else the first heard"
    )
    parser.add_argument("--baseline", type=Path, metavar="FILE", help="static baseline of the sensor")
    parser.add_argument("--as-published", action="store_true", help="also the benchmark authors' Euler figure")


def run(args: argparse.Namespace) -> int:
    """Score one file.

    Raises
    ------
    UsageError
        End points or window that do not fit the recording.
    FileError
        Not a file that can be scored; says where and why.
    """
    from host.result import result_text

    score = score_file(args)
    if args.json:
        sys.stdout.write(result_text(score))
    else:
        from host.score_view import print_score

        print_score(score)
    return 0 if score.valid else 1


def score_file(args: argparse.Namespace) -> TrialScore:
    """Read and score what the arguments name; see :func:`run`."""
    from analysis.endpoint_choice import parse_endpoints
    from analysis.readers import read_series
    from analysis.series import AnalysisError, BaselineError, ReaderError, SeriesError
    from host.errors import FileError, UsageError
    from host.recorded_trial import load_trial
    from host.recording_reader import is_our_recording
    from host.result import ScoreOptions, score_plain, score_trial
    from host.transports.can_log_kind import can_log_kind

    path: Path = args.file
    window = None if args.start is None and args.end is None else (args.start, args.end)
    try:
        chosen = None if args.endpoints is None else parse_endpoints(args.endpoints)
    except ReaderError as error:
        raise UsageError(str(error)) from error
    options = ScoreOptions(window, chosen, args.baseline, args.as_published)
    try:
        if is_our_recording(path):
            return score_trial(load_trial(path), options)
        if can_log_kind(path) is not None:
            from host.can_log_trial import load_can_log  # loads python-can

            return score_trial(load_can_log(path, args.node), options)
        series = read_series(path, columns=args.columns, rate_hz=args.rate, topic=args.topic)
    except FileNotFoundError as error:
        raise FileError(f"there is no file {path}", "check the path") from error
    except OSError as error:
        raise FileError(f"{path} cannot be read ({(error.strerror or str(error)).lower()})") from error
    except SeriesError as error:
        raise (UsageError if chosen or window else FileError)(str(error)) from error
    except AnalysisError as error:
        raise FileError(str(error)) from error
    try:
        return score_plain(series, options)
    except BaselineError as error:
        raise FileError(str(error)) from error
    except AnalysisError as error:
        raise UsageError(str(error), "choose end points or a window inside the recording") from error
