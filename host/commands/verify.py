"""``rotdrift verify``: check a submission against its own raw bytes."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.submission.verification import Verification


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "verify",
        help="check a submission: hashes, layout, every number again from the raw bytes",
        description=(
            "Check the hashes and the layout of a submission, score its recordings again, and compare every file. "
            "Exit code 0: equal; 1: something differs."
        ),
    )
    parser.add_argument("bundle", type=Path, metavar="BUNDLE", help="submission.zip, or the folder it was unpacked to")
    parser.add_argument("--no-drawings", action="store_true", help="do not make figures and reports again (faster)")
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Verify one submission.

    Raises
    ------
    FileError
        BUNDLE is not a submission, or it is refused.
    """
    from host.output.lines import write_json, write_lines
    from host.submission.verification import verify_bundle

    found = verify_bundle(args.bundle, drawings=not args.no_drawings)
    if args.json:
        values = {
            "equal": found.equal,
            "digest": found.digest,
            "n_files": found.n_files,
            "n_trials": found.n_trials,
            "altered": found.altered,
            "differences": found.differences,
            "uncompared": list(found.uncompared),
            "notes": [*found.notes, *(_uncompared_line(reason, names) for reason, names in _by_reason(found))],
        }
        write_json(json.dumps(values, indent=2, ensure_ascii=False) + "\n")
    else:
        write_lines(_lines(found))
    return 0 if found.equal else 1


def _lines(found: Verification) -> Iterator[str]:
    """Report what was not compared first: whoever reads on shall not take silence for agreement.

    Yields
    ------
    str
        Lines for a person.
    """
    for reason, names in _by_reason(found):
        yield _uncompared_line(reason, names)
        yield from (f"  {line}" for line in _by_folder(names))
    yield from (f"altered: {line}" for line in found.altered)
    yield from (f"differs: {line}" for line in found.differences)
    yield from found.notes
    trials = f"{found.n_trials} trial{'s' * (found.n_trials != 1)}"
    if not found.equal:
        yield (
            f"not equal: {len(found.altered)} altered file{'s' * (len(found.altered) != 1)}, "
            f"{len(found.differences)} difference{'s' * (len(found.differences) != 1)}"
        )
    elif found.uncompared:
        yield (
            f"equal as far as compared: {found.n_files - len(found.uncompared)} of {found.n_files} files; "
            f"all numbers of {trials} scored again from the raw bytes"
        )
    else:
        yield f"equal: {found.n_files} files, {trials} scored again from the raw bytes"
    yield f"digest of the submission: {found.digest}"


def _by_reason(found: Verification) -> list[tuple[str, list[str]]]:
    reasons: dict[str, list[str]] = {}
    for name, reason in found.uncompared.items():
        reasons.setdefault(reason, []).append(name)
    return list(reasons.items())


def _uncompared_line(reason: str, names: list[str]) -> str:
    return f"NOT compared: {len(names)} file{'s' * (len(names) != 1)} ({reason})"


def _by_folder(names: list[str]) -> list[str]:
    """Name files with those of the same folder on one line."""
    from host.text import plain

    folders: dict[str, list[str]] = {}
    for name in names:
        folder, slash, file = name.rpartition("/")
        folders.setdefault(folder + slash, []).append(file)
    return [plain(f"{folder} {', '.join(files)}", 10**6) for folder, files in folders.items()]
