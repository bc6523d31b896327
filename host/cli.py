"""The ``rotdrift`` command: finds the subcommand, runs it, and turns every error into one sentence.

Exit codes: 0 done, 1 ran but the result is not valid, 2 wrong use, 3 device or link, 4 file; 70 an internal
error, 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from host.command_line.parser import Parser
from host.commands import COMMANDS
from host.errors import HostError, no_memory, unreadable
from host.output.lines import write_note, write_text, write_traceback
from host.output.streams import discard_output, flush_output, install, installed, output_at_terminal
from host.text import plain
from host.version import VERSION

CONFIGURED = {"capture", "baseline", "replay", "report"}
"""Commands that may have defaults of the user and the project."""
INTERNAL_ERROR = 70
INTERRUPTED = 130

EPILOG = """\
help:        rotdrift help COMMAND
links:       serial:/dev/ttyACM0   serial:COM3
             serial:socket://127.0.0.1:5000
             can:socketcan:can0   can:slcan:/dev/ttyACM0
             can:socketcand:HOST:29536/can0
             can:udp_multicast:239.74.163.2   replay:trial.mcap
exit codes:  0 done   1 ran, but the result is not valid   2 wrong use
             3 device or link   4 file
"""


def build_parser() -> Parser:
    """Return the parser of all subcommands; imports no numpy and no driver."""
    parser = Parser(
        prog="rotdrift",
        description="Measure how far a robot hand lets an object drift per cycle\n(Rotation Drift Benchmark).",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-V", "--version", action="version", version=f"rotdrift {VERSION}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser] = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, parser_class=Parser
    )
    for name in COMMANDS:
        _command(name).add_parser(subparsers)
    for subparser in subparsers.choices.values():
        # Also after the subcommand, where one adds it to a line that just failed. Without SUPPRESS the default of the
        # subparser would overwrite a --debug that stands before the subcommand.
        subparser.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit code; the arguments are those of the process by default."""
    if arguments is not None:
        with installed():
            return _run(list(arguments))
    install()  # to the end of the process: what is printed while it ends passes as well
    return _run(sys.argv[1:])


def _run(words: list[str]) -> int:
    # numpy reads this when it is first imported. Nothing here gains from several threads, and idle ones keep spinning.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    at_terminal = output_at_terminal()
    debug = "--debug" in words  # until the arguments are parsed
    try:
        args = _parse(words)
        debug = args.debug
        code: int = _command(args.command).run(args)
        flush_output()
    except SystemExit as leaving:  # argparse leaves after --help, --version and errors
        return leaving.code if isinstance(leaving.code, int) else 0
    except HostError as error:
        return _report(error, str(error), error.exit_code, debug)
    except KeyboardInterrupt as error:
        return _report(error, "interrupted", INTERRUPTED, debug)
    except MemoryError as error:
        return _report(error, str(no_memory("this")), no_memory("this").exit_code, debug)
    except BrokenPipeError:
        # The reader of our output has gone (`| head`). Without this, Python reports it once more at shutdown.
        discard_output()
        return 0
    except Exception as error:  # noqa: BLE001 - the last line of defence
        if isinstance(error, OSError) and at_terminal and not output_at_terminal():
            discard_output(errors=True)  # the terminal has closed; a capture's result is in its file
            return 0
        if isinstance(error, OSError) and error.filename is not None:  # a name too long, a folder that has vanished
            refused = unreadable(plain(error.filename), error)
            return _report(error, str(refused), refused.exit_code, debug)
        message = f"internal error ({type(error).__name__}: {error}): run again with --debug and report it"
        return _report(error, message, INTERNAL_ERROR, debug)
    return code


def _parse(words: list[str]) -> argparse.Namespace:
    """Return the arguments, with the defaults of user and project for what was not given."""
    if words[:1] == ["help"]:
        words = [*words[1:2], "--help"]
    parser = build_parser()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what could come next
        from host.commands.completion import complete

        complete(parser)
    if not words:
        write_text(parser.format_help())
        parser.exit()
    args, unknown = parser.parse_known_args(words)
    (subparsers,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    command: Parser = subparsers.choices[args.command]
    if unknown:
        command.refuse_unknown(unknown)
    if args.command in CONFIGURED:
        from host.command_line.configuration import defaults_for

        command.set_defaults(**defaults_for(args.command))
        args = parser.parse_args(words)
    return args


def _command(name: str) -> ModuleType:
    return importlib.import_module(f"host.commands.{name}")


def _report(error: BaseException, message: str, code: int, debug: bool) -> int:
    if debug:
        write_traceback(error)
    write_note(" ".join(message.split()))
    return code
