"""``rotdrift verify``: check a submission against its own raw bytes."""

from __future__ import annotations

import argparse
import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
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
            "Check the archive, the hashes and the layout of a submission, score its recordings again, and compare "
            "every file. Exit code 0: equal; 1: something differs, or the signature is not of the key given. Files "
            "that other versions made are named as not compared; with --strict that is exit code 1, too."
        ),
    )
    parser.add_argument("bundle", type=Path, metavar="BUNDLE", help="submission.zip, or the folder it was unpacked to")
    parser.add_argument("--no-drawings", action="store_true", help="do not make figures and reports again (faster)")
    parser.add_argument("--strict", action="store_true", help="exit code 1 unless every byte was compared")
    parser.add_argument(
        "--key", metavar="PUBKEY", help="check the signature with this public key: its file, or the key itself"
    )
    parser.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Verify one submission.

    Returns
    -------
    int
        0; 1 if something differs, if a key was given that did not sign it, or, with --strict, if anything was not
        compared byte by byte.

    Raises
    ------
    UsageError
        --key without the extra that checks signatures, or for a folder.
    FileError
        BUNDLE is not a submission, or it is refused; the key is not one.
    """
    from host.output.lines import write_json, write_lines
    from host.submission.signature import Standing, require_extra
    from host.submission.verification import verify_bundle

    key = None
    if args.key is not None:
        require_extra()
        from host.submission.signing_keys import load_public_key

        key = load_public_key(args.key)
    found = verify_bundle(args.bundle, drawings=not args.no_drawings, key=key)
    if args.json:
        write_json(json.dumps(_values(found), indent=2, ensure_ascii=False) + "\n")
    else:
        write_lines(_lines(found))
    signed_by_another = found.signature is not None and found.signature.standing is Standing.BAD
    return 0 if found.equal and not signed_by_another and (found.complete or not args.strict) else 1


def _values(found: Verification) -> dict[str, object]:
    signature = found.signature
    return {
        "equal": found.equal,
        "complete": found.complete,
        "digest": found.digest,
        "n_files": found.n_files,
        "n_trials": found.n_trials,
        "altered": found.altered,
        "differences": found.differences,
        "uncompared": list(found.uncompared),
        "rounded": found.rounded,
        "notes": [*found.notes, *_reasons(found)],
        "signature": signature
        and {"standing": signature.standing, "key_id": signature.key_id, "comment": signature.comment},
    }


def _lines(found: Verification) -> Iterator[str]:
    """Report what was not compared first: silence would read as agreement.

    Yields
    ------
    str
        Lines for a person.
    """
    from host.text import plain

    if not found.complete:
        yield f"NOT compared: {plain('; '.join(_not_compared(found)), 10**6)}"
        for reason, names in _by_reason(found):
            yield f"  {reason}:"
            yield from (f"    {line}" for line in _by_folder(names))
    yield from (f"altered: {line}" for line in found.altered)
    yield from (f"differs: {line}" for line in found.differences)
    yield from found.notes
    trials = f"{found.n_trials} trial{'s' * (found.n_trials != 1)}"
    if not found.equal:
        yield (
            f"not equal: {len(found.altered)} altered file{'s' * (len(found.altered) != 1)}, "
            f"{len(found.differences)} difference{'s' * (len(found.differences) != 1)}"
        )
    elif not found.complete:
        exact = found.n_files - len(found.uncompared) - len(found.rounded)
        yield (
            f"equal as far as compared: {exact} of {found.n_files} files byte by byte; "
            f"all numbers of {trials} scored again from the raw bytes"
        )
    else:
        yield f"equal: {found.n_files} files, {trials} scored again from the raw bytes"
    yield f"digest of the submission: {found.digest}"
    if found.signature is not None:
        yield found.signature.sentence


def _not_compared(found: Verification) -> Iterator[str]:
    """Name what was not compared in as few words as name all of it: of many trials a kind of file once.

    Yields
    ------
    str
        Parts of one line.
    """
    if found.uncompared:
        yield _kinds(found.uncompared)
    elif not found.drawings:
        yield "figures and reports"
    if found.rounded:
        yield f"the last digits of {_kinds(found.rounded)} (numbers equal within 1e-9)"
    if found.packing:
        yield f"how the archive is packed ({found.packing})"


def _kinds(names: Iterable[str]) -> str:
    """Name files, those of a folder of figures and those of every trial together."""
    kinds = Counter[str]()
    for name in names:
        kind = re.sub(r"^trials/[^/]+/", "trials/*/", name)
        kinds[f"{kind.rpartition('/')[0]}/" if "figures/" in kind else kind] += 1
    return ", ".join(f"{name} ({count} files)" if count > 1 else name for name, count in kinds.items())


def _reasons(found: Verification) -> list[str]:
    lines = [f"NOT compared: {len(names)} file{'s' * (len(names) != 1)} ({why})" for why, names in _by_reason(found)]
    return [*lines, *([f"NOT compared: how the archive is packed ({found.packing})"] if found.packing else [])]


def _by_reason(found: Verification) -> list[tuple[str, list[str]]]:
    reasons: dict[str, list[str]] = {}
    for name, reason in found.uncompared.items():
        reasons.setdefault(reason, []).append(name)
    return list(reasons.items())


def _by_folder(names: Iterable[str]) -> list[str]:
    """Name files with those of the same folder on one line."""
    from host.text import plain

    folders: dict[str, list[str]] = {}
    for name in names:
        folder, slash, file = name.rpartition("/")
        folders.setdefault(folder + slash, []).append(file)
    return [plain(f"{folder} {', '.join(files)}", 10**6) for folder, files in folders.items()]
