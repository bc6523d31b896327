"""``rotdrift completion``: commands and options by argcomplete, and the links, scenarios and files of this machine."""

from __future__ import annotations

import argparse
from typing import Any

SHELLS = ("bash", "zsh", "fish")
RECORDINGS = ("mcap", "csv", "txt", "tum", "parquet", "bag", "db3", "log", "asc", "blf", "trc")
FILES = {"FILE": RECORDINGS, "TRIAL": RECORDINGS, "IN": RECORDINGS, "LINK|FILE": RECORDINGS, "BUNDLE": ("zip",)}
"""Argument, as the help names it -> endings of the files that it can be."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "completion",
        help="complete commands with the Tab key",
        description=(
            "Print what your shell has to run to complete commands, options, links,\n"
            "scenarios and recordings:\n"
            "  bash   rotdrift completion bash >> ~/.bashrc\n"
            "  zsh    rotdrift completion zsh >> ~/.zshrc\n"
            "  fish   rotdrift completion fish > ~/.config/fish/completions/rotdrift.fish"
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or fish")


def run(args: argparse.Namespace) -> int:
    """Print the code."""
    from argcomplete.shell_integration import shellcode

    from host.output.lines import write_text

    write_text(shellcode(["rotdrift"], shell=args.shell))
    return 0


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell that asks for completions, and end."""
    import argcomplete

    subparsers = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    commands = [command for action in subparsers for command in action.choices.values()]
    for command in commands:
        for action in command._actions:
            completer = _completer(action)
            if completer is not None:
                action.completer = completer
    argcomplete.autocomplete(parser, always_complete_options="long")


def links(**_: object) -> list[str]:
    """Return the links that could be captured from now: ports of this machine, as ``rotdrift ports`` lists them."""
    from host.links.can.listing import list_can_ports
    from host.links.serial.listing import list_serial_ports

    ports = list_serial_ports()
    return [port.link for port in ports] + [port.link for port in list_can_ports(ports)]


def scenarios(**_: object) -> tuple[str, ...]:
    """Return the names of the shipped scenarios."""
    from emulator.scenario import scenario_names

    return scenario_names()


def _completer(action: argparse.Action) -> Any:  # noqa: ANN401 - argcomplete's are callables of any signature
    from argcomplete.completers import FilesCompleter

    metavar = str(action.metavar)
    if metavar == "NAME|FILE":
        return scenarios
    if action.option_strings:  # files to write, or of kinds of their own: those that the shell finds
        return None
    return links if metavar == "LINK" else FilesCompleter(FILES[metavar]) if metavar in FILES else None
