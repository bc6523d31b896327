"""``rotdrift check``: whether a recording is what was written, and what is damaged in it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "check",
        help="check whether a recording is damaged, and where",
        description=(
            "Check a recording record by record: format, checksums, counts against the file's own statistics, numbers, "
            "times, indexes, and what the raw channel decodes to. Any other MCAP file is checked as far as the format "
            "goes, and every recording in a submission. Exit code 0: sound; 1: damaged; 2: not a recording."
        ),
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="recording, any .mcap file, or submission.zip")
    parser.add_argument("--json", action="store_true", help="print what was found as one JSON object, and nothing else")


def run(args: argparse.Namespace) -> int:
    """Check one file.

    Raises
    ------
    UsageError
        FILE is not a recording; the message names what it is.
    FileError
        It cannot be read.
    """
    from host.output.lines import write_json, write_lines
    from host.submission.checked_file import check_file

    found = check_file(args.file)
    if args.json:
        values = {"file": args.file.name, "sound": all(report.sound for report in found.values())}
        reports = {name: report.to_json() for name, report in found.items()}
        write_json(json.dumps({**values, "recordings": reports}, indent=2, ensure_ascii=False) + "\n")
    else:
        for name, report in found.items():
            if len(found) > 1 or name != args.file.name:
                write_lines([name])
            write_lines(report.lines())
    return 0 if all(report.sound for report in found.values()) else 1
