"""One module per subcommand.

The name of the module is the name of the subcommand. Each has ``add_parser(subparsers)``, which declares the arguments
and must import nothing heavy, and ``run(args) -> int``, which imports what it needs, raises
:class:`host.errors.HostError`, and returns the exit code.
"""

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
    "verify",
    "compare",
    "convert",
    "recover",
    "doctor",
)
"""Subcommands in the order of the help."""
