"""``rotdrift recover``: a clean recording from a cut or damaged one."""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "recover",
        help="make a clean recording of a cut or damaged one",
        description=(
            "Search a recording for everything that is whole, by the checksum of each record, and write it as a new "
            "recording. The recording of a killed capture does not need this: it replays and scores as it is."
        ),
    )
    parser.add_argument("source", metavar="IN", type=Path, help="the damaged recording")
    parser.add_argument("target", metavar="OUT", type=Path, help="the recording to write; must not exist")
    parser.add_argument("--json", action="store_true", help="print what was found as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Recover a recording.

    Raises
    ------
    FileError
        Nothing to recover, or the new file cannot be written.
    """
    from host.output.lines import write_json, write_lines
    from host.recording.recovery import recover

    found = recover(args.source, args.target)
    if args.json:
        write_json(json.dumps(found.to_json(), indent=2) + "\n")
    else:
        write_lines((*found.sentences(), f"written to {args.target}"))
    return 0
