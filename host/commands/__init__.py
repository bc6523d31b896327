"""One module per subcommand.

The name of the module is the name of the subcommand. Each has ``add_parser(subparsers)``, which declares the arguments
and must import nothing heavy, and ``run(args) -> int``, which imports what it needs, raises
:class:`host.errors.HostError`, and returns the exit code.
"""

from __future__ import annotations

import argparse

COMMANDS = (
    "demo",
    "emulate",
    "ports",
    "capture",
    "baseline",
    "score",
    "replay",
    "init",
    "report",
    "keygen",
    "verify",
    "compare",
    "convert",
    "recover",
    "check",
    "doctor",
    "config",
    "completion",
)
"""Subcommands in the order of the help."""


def seconds(text: str) -> float:
    """Return an argument as a time above 0, s."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time in seconds above 0")
    return value
