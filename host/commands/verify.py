"""``rotdrift verify``: check a submission against its own raw bytes."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path


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
            "uncompared": found.uncompared,
            "notes": found.notes,
        }
        sys.stdout.write(json.dumps(values, indent=2, ensure_ascii=False) + "\n")
        return 0 if found.equal else 1
    lines = [f"altered: {line}" for line in found.altered]
    lines += [f"differs: {line}" for line in found.differences]
    lines += list(found.notes)
    trials = f"{found.n_trials} trial{'s' * (found.n_trials != 1)}"
    n_compared = found.n_files - len(found.uncompared)
    if not found.equal:
        lines.append(
            f"not equal: {len(found.altered)} altered file{'s' * (len(found.altered) != 1)}, "
            f"{len(found.differences)} difference{'s' * (len(found.differences) != 1)}"
        )
    elif found.uncompared:
        lines.append(
            f"equal as far as compared: {n_compared} of {found.n_files} files; all numbers of {trials} "
            "scored again from the raw bytes"
        )
    else:
        lines.append(f"equal: {found.n_files} files, {trials} scored again from the raw bytes")
    lines.append(f"digest of the submission: {found.digest}")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0 if found.equal else 1
