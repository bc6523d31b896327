"""One module per subcommand.

Each has ``add_parser(subparsers)``, which must import nothing heavy, and ``run(args) -> int``, which imports what it
needs when it is called. The name of the module is the name of the subcommand; :data:`COMMANDS` is their order in the
help.
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
