"""``rotdrift keygen``: a pair of keys, to sign submissions with and to check them."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "keygen",
        help="make a pair of keys, to sign submissions",
        description=(
            "Write a secret key, for `rotdrift report --sign`, and beside it the public key, for `rotdrift verify "
            "--key`. Both are those of minisign. The secret key has no password: only its permissions (600) protect "
            "it. `minisign -C -s KEY` gives it one."
        ),
    )
    parser.add_argument("key", type=Path, metavar="KEY", help="the secret key, e.g. lab.key; the public one is lab.pub")


def run(args: argparse.Namespace) -> int:
    """Write both keys.

    Raises
    ------
    UsageError
        KEY is named like a public key, or the extra is not installed.
    FileError
        One of the files exists already, or cannot be written.
    """
    from host.errors import UsageError
    from host.output.lines import write_lines
    from host.submission.signature import require_extra
    from host.text import plain

    require_extra()
    from host.submission.signing_keys import PUBLIC_SUFFIX, write_keys

    if not args.key.name or args.key.suffix == PUBLIC_SUFFIX:
        raise UsageError(f"'{plain(args.key)}' is not a name for a secret key", "give one such as lab.key")
    public, text = write_keys(args.key)
    write_lines(
        (
            f"wrote {args.key}: secret, without password; keep it, and keep it to yourself",
            f"wrote {public}: public; publish it with the paper, or the key itself:",
            f"  {text}",
        )
    )
    return 0
