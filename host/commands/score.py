"""``rotdrift score``: score recordings, made here or elsewhere."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.results.any_file import ReadOptions, ScoredRecording
    from host.results.result import ScoreOptions

PLOT_FORMATS = (".png", ".svg", ".pdf")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    from host.results.arguments import add_exclude_arguments, add_read_arguments, add_window_arguments

    parser = subparsers.add_parser(
        "score",
        help="score recordings",
        description=(
            "Score a recording by the benchmark card: our own .mcap, the benchmark authors' CSV, CSV with named "
            "columns, TUM, x-IMU3, parquet, ROS bags, logs of CAN tools. The format is recognised from the content. "
            "Several files, or a folder, make one table, scored on all cores."
        ),
    )
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="what to score; folders are searched")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object, and nothing else")
    parser.add_argument("--csv", action="store_true", help="print CSV, a row per recording, and nothing else")
    parser.add_argument("--quiet", action="store_true", help="print the score alone")
    parser.add_argument(
        "--cycles", type=_rows, metavar="N|all", help="so many rows of the table of cycles (default: 12)"
    )
    parser.add_argument(
        "--endpoints",
        metavar="ROWS|FILE",
        help="end points chosen by hand: rows (1175,1639), times (12.5s,17.1s), or a file",
    )
    add_window_arguments(parser)
    add_exclude_arguments(parser)
    parser.add_argument(
        "--ignore-actions",
        action="store_true",
        help="score as if the operator had set no trial window and left no cycle out",
    )
    add_read_arguments(parser)
    parser.add_argument("--baseline", type=Path, metavar="FILE", help="static baseline of the sensor")
    parser.add_argument(
        "--plot", type=Path, metavar="IMAGE", help="draw the trial: rotation, steps, sensitivity (.png, .svg or .pdf)"
    )
    parser.add_argument("--as-published", action="store_true", help="also the benchmark authors' Euler figure")
    parser.add_argument(
        "--preceding",
        action="append",
        default=[],
        metavar="FILE[=ENDPOINTS]",
        help="a recording that the authors' script processed before this one, in its order; may be repeated",
    )


def run(args: argparse.Namespace) -> int:
    """Score one file, or many into one table.

    Raises
    ------
    UsageError
        End points or window that do not fit the recording.
    FileError
        A file cannot be scored; the message has the place and the reason.
    """
    from host.errors import UsageError
    from host.output.lines import write_json, write_text
    from host.results.any_file import SeveralInFileError, score_recording
    from host.results.arguments import window
    from host.results.batch import expand

    if args.endpoints is not None and window(args.start, args.end) is not None:
        raise UsageError("--endpoints and --from/--to both choose what to score", "give one of them")
    _check_plot(args.plot)
    files = expand(args.files)
    if len(files) > 1 or files != args.files:
        return _run_many(files, args)
    try:
        scored = score_recording(files[0], *_choices(args))
    except SeveralInFileError as error:
        # Sessions are trials of their own: each is scored. Of sensors, channels and nodes a person has to choose.
        if error.kind != "session" or _belongs_to_one(args):
            raise
        return _run_many(files, args)
    result = scored.result
    if args.plot is not None:
        _plot(args.plot, files[0], scored)
    if args.json:
        from analysis.scoring.result import result_text

        write_json(result_text(result))
    elif args.csv:
        from host.results.batch import BatchRow
        from host.results.csv_rows import results_csv

        write_text(results_csv([BatchRow(files[0], result, None, 0)]))
    else:
        from host.results.printout import MAX_ROWS, print_score

        also = () if args.plot is None else (("plot", str(args.plot)),)
        print_score(result, also=also, max_rows=args.cycles or MAX_ROWS, only_score=args.quiet)
    return 0 if result.valid else 1


def _run_many(files: list[Path], args: argparse.Namespace) -> int:
    """Score files into one table; return the exit code of the worst."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from analysis.scoring.result import result_text
    from host.errors import UsageError
    from host.output.drawings import open_error_console
    from host.output.lines import write_json, write_text
    from host.results.batch import BatchRow, score_many
    from host.results.csv_rows import results_csv
    from host.results.printout import print_batch

    if name := _belongs_to_one(args):
        raise UsageError(f"{name} belongs to one recording, here are {len(files)}", "score that one alone")
    console = open_error_console()
    with Progress(
        TextColumn("scoring"), BarColumn(), MofNCompleteColumn(), console=console, transient=True,
        disable=not console.is_terminal,
    ) as progress:  # fmt: skip
        bar = progress.add_task("scoring", total=len(files))

        def report(_row: BatchRow) -> None:
            progress.advance(bar)

        rows = score_many(files, report, *_choices(args))
    if args.json:
        results = [
            {"file": str(row.path), "error": row.error, "result": row.result}
            | ({} if row.session is None else {"session": row.session})
            for row in rows
        ]
        write_json(result_text({"results": results}))
    elif args.csv:
        write_text(results_csv(rows))
    else:
        print_batch(rows, only_scores=args.quiet)
    return max(row.exit_code for row in rows)


def _rows(text: str) -> int:
    if text == "all":
        return sys.maxsize
    if not text.isascii() or not text.isdigit() or not 2 <= int(text) < 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number from 2 on nor `all`")
    return int(text)


def _belongs_to_one(args: argparse.Namespace) -> str:
    """Return which option given makes sense for a single recording only; empty for none."""
    options = (
        ("--endpoints", args.endpoints),
        ("--plot", args.plot),
        ("--exclude", args.exclude),
        ("--preceding", args.preceding),
    )
    return next((name for name, value in options if value), "")


def _check_plot(path: Path | None) -> None:
    from host.errors import UsageError, already_there

    if path is None:
        return
    if path.suffix.lower() not in PLOT_FORMATS:
        raise UsageError(f"{path.name} is not a known kind of picture", f"end its name in {', '.join(PLOT_FORMATS)}")
    if path.exists():
        raise already_there(path, "give another name with --plot, or move it away")


def _plot(path: Path, source: Path, scored: ScoredRecording) -> None:
    """Draw a trial; one without a score still shows its motion."""
    import textwrap

    from analysis.reporting.figures import summary_figure
    from analysis.reporting.style import figure_bytes
    from host.errors import unwritable

    theta_deg = scored.result.theta_bar_deg
    if theta_deg is None:
        title = f"{source.name}: no score\n" + textwrap.fill("; ".join(scored.result.reasons), 110, max_lines=4)
    else:
        title = f"{source.name}: θ̄ = {theta_deg:.3f}° per cycle"
    figure = summary_figure(scored.series, scored.result, title)
    content = figure_bytes(figure, path.suffix.lower().removeprefix("."))
    try:
        with path.open("xb") as file:
            file.write(content)
    except OSError as error:
        raise unwritable(path, error) from error


def _choices(args: argparse.Namespace) -> tuple[ScoreOptions, ReadOptions]:
    """Return how to score, and how to read."""
    from analysis.scoring.choice import parse_endpoints
    from analysis.series import ReaderError
    from host.errors import UsageError
    from host.results.arguments import excluded, reading, window
    from host.results.preceding import preceding_endpoints
    from host.results.result import ScoreOptions

    how = reading(args.columns, args.rate, args.topic, args.node, args.sensor, args.channel, args.session)
    try:
        chosen = None if args.endpoints is None else parse_endpoints(args.endpoints)
    except ReaderError as error:
        raise UsageError(str(error)) from error
    options = ScoreOptions(
        window=window(args.start, args.end),
        endpoints=chosen,
        baseline=args.baseline,
        as_published=args.as_published or bool(args.preceding),
        honour_actions=not args.ignore_actions,
        excluded=excluded(args.exclude, args.because),
        preceding=preceding_endpoints(args.preceding, how),
        clock=args.json,
    )
    return options, how
