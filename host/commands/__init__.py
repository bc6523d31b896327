"""One module per subcommand.

The name of the module is the name of the subcommand. Each has ``add_parser(subparsers)``, which declares the arguments
and must import nothing heavy, and ``run(args) -> int``, which imports what it needs, raises
:class:`host.errors.HostError`, and returns the exit code. Where the arguments go on to other functions they are a typed
record: a named tuple ``Options``, a field per argument (importing dataclasses would cost ``--help`` 20 ms).
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
