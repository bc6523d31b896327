"""``rotdrift convert``: write a recording in the format of another tool."""

from __future__ import annotations

import argparse
from pathlib import Path

SUFFIXES = {".csv": "csv", ".tum": "tum", ".txt": "tum", ".parquet": "parquet", ".mat": "mat"}
"""Format by the name of the output, where ``--to`` is not given."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    from host.results.arguments import add_read_arguments

    parser = subparsers.add_parser(
        "convert",
        help="write a recording as CSV, TUM, parquet, .mat, ROS 2 bag",
        description="Write any recording that `rotdrift score` reads in another format. Nothing is\noverwritten.",
        epilog=(
            "formats: csv (named columns), endpoints (CSV for docs/rotdrift_score.m), tum,\n"
            "         parquet, mat, ros2 (bag, a folder), kit (the benchmark authors' layout)\n"
            "example: rotdrift convert trial.mcap trial.mat"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="what to convert")
    parser.add_argument("out", type=Path, metavar="OUT", help="what to write")
    parser.add_argument(
        "--to",
        choices=("csv", "endpoints", "tum", "parquet", "mat", "ros2", "kit"),
        help="format (default: by the name of OUT)",
    )
    add_read_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Read a recording, score it where the format holds end points, and write it.

    Raises
    ------
    UsageError
        The name of OUT does not show the format.
    FileError
        FILE cannot be read, or OUT cannot be written or exists.
    """
    from analysis.formats import FORMATS, write_series
    from analysis.series import WriterError
    from host.errors import UsageError, already_there, unwritable
    from host.output.lines import write_line, write_note
    from host.results.any_file import read_recording, score_recording
    from host.results.arguments import reading

    kind = args.to or SUFFIXES.get(args.out.suffix.lower())
    if kind is None:
        raise UsageError(
            f"the name {args.out.name} does not show a format", f"choose one with --to {{{','.join(FORMATS)}}}"
        )
    how = reading(args.columns, args.rate, args.topic, args.node, args.sensor, args.channel, args.session)
    result = None
    if kind in {"endpoints", "mat"}:
        scored = score_recording(args.file, None, how)
        series, result, damage = scored.series, scored.result.to_json(), scored.damage
    else:
        series, trial = read_recording(args.file, how)
        damage = () if trial is None else trial.damage
    try:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        notes = write_series(series, args.out, kind, result)
    except FileExistsError as error:
        raise already_there(args.out, "give another name, or move it away") from error
    except WriterError as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise unwritable(args.out, error) from error
    for note in (*damage, *notes):
        write_note(note)
    write_line(f"wrote {args.out}: {len(series)} samples, {FORMATS[kind][0]}")
    return 0
