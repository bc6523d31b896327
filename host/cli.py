"""The ``rotdrift`` command: finds the subcommand, runs it, and turns what goes wrong into one sentence.

Exit codes: 0 done, 1 ran but the result is not valid, 2 wrong use, 3 device or link, 4 file; 70 a fault of rotdrift
itself, 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any, NoReturn, Protocol, cast

from host.commands import COMMANDS
from host.errors import HostError, unreadable
from host.version import VERSION

OWN_FAULT = 70
INTERRUPTED = 130

EPILOG = """\
links:       serial:/dev/ttyACM0   serial:COM3
             serial:socket://127.0.0.1:5000
             can:socketcan:can0   replay:trial.mcap
exit codes:  0 done   1 ran, but the result is not valid   2 wrong use
             3 device or link   4 file
"""


class CommandModule(Protocol):
    """What a module in ``host/commands`` has."""

    Options: Callable[..., Any]
    """A frozen dataclass with a field for each argument."""

    def add_parser(self, subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
        """Declare the subcommand and its arguments."""

    def run(self, args: Any) -> int:  # noqa: ANN401 - each module has Options of its own
        """Run it with its Options; return the exit code."""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors look like all others: one sentence with what to do, on stderr, exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the arguments and leave."""
        self.exit(2, f"rotdrift: {message}; see `{self.prog} --help`\n")


def build_parser() -> Parser:
    """Assemble the parser of all subcommands; imports no numpy and no driver."""
    parser = Parser(
        prog="rotdrift",
        description="Measure how far a robot hand lets an object drift per cycle\n(Rotation Drift Benchmark).",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"rotdrift {VERSION}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser] = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=Parser
    )
    for name in COMMANDS:
        _command(name).add_parser(subparsers)
    for subparser in subparsers.choices.values():
        # Also after the subcommand, where one adds it to a line that just failed; not set there, it must not reset.
        subparser.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; ``sys.argv[1:]`` by default.

    Returns
    -------
    int
        The exit code.
    """
    # Read when numpy is first imported: nothing here gains from several threads, and idle ones spin for a while.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _make_output_safe()
    at_terminal = _at_terminal()
    try:
        parser = build_parser()
        args, unknown = parser.parse_known_args(arguments)
        if unknown:
            parser.prog = f"rotdrift {args.command}"  # whose --help says more
            parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    except SystemExit as leaving:  # argparse leaves after --help, --version and errors
        return leaving.code if isinstance(leaving.code, int) else 0
    values = vars(args)
    command, debug = _command(values.pop("command")), values.pop("debug")
    try:
        code = command.run(command.Options(**values))
        sys.stdout.flush()
    except HostError as error:
        return _report(error, str(error), error.exit_code, debug)
    except KeyboardInterrupt as error:
        return _report(error, "interrupted", INTERRUPTED, debug)
    except BrokenPipeError:
        # Whoever read our output has gone (`| head`); without this Python complains once more while it shuts down.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:  # noqa: BLE001 - the last line of defence
        if isinstance(error, OSError) and at_terminal and not _at_terminal():
            for stream in (sys.stdout, sys.stderr):  # nobody reads what is left; a capture's result is in its file
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            return 0
        if isinstance(error, OSError) and error.filename is not None:  # a name too long, a folder that has vanished
            from host.text import plain

            refused = unreadable(plain(error.filename), error)
            return _report(error, str(refused), refused.exit_code, debug)
        message = f"a fault of rotdrift itself ({type(error).__name__}: {error}): run again with --debug and report it"
        return _report(error, message, OWN_FAULT, debug)
    return code


def _command(name: str) -> CommandModule:
    return cast(CommandModule, importlib.import_module(f"host.commands.{name}"))


def _at_terminal() -> bool:
    """Whether the output goes to a terminal that is there: not to one closed meanwhile (window, ssh connection)."""
    try:
        return os.isatty(sys.stdout.fileno())
    except (OSError, ValueError):
        return False


def _report(error: BaseException, message: str, code: int, debug: bool) -> int:
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    print(f"rotdrift: {' '.join(message.split())}", file=sys.stderr)  # noqa: T201
    return code


def _make_output_safe() -> None:
    """Let a terminal that cannot show θ show a question mark instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
