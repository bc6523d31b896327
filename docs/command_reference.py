"""``docs/commands.md``, made from the parsers: ``python -m docs.command_reference`` writes it.

A test compares the document with what this makes.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from docs.source_reading import filled
from host.cli import build_parser

PAGE = Path(__file__).with_name("commands.md")


def commands() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of every command, in the order of the help."""
    (subparsers,) = (item for item in build_parser()._actions if isinstance(item, argparse._SubParsersAction))
    return dict(subparsers.choices)


def section(name: str, parser: argparse.ArgumentParser) -> str:
    """Return what there is to know of one command, as Markdown."""
    lines = [f"## {name}", "", _prose(parser.description or ""), "", "```text", _usage(name, parser), "```", ""]
    rows = list(_rows(parser))
    if rows:
        lines += ["| argument | meaning |", "|---|---|", *rows, ""]
    if parser.epilog:
        lines += ["```text", parser.epilog.rstrip(), "```", ""]
    return "\n".join(lines).rstrip()


def fill(document: str) -> str:
    """Return a document with its marked place filled from the parsers."""
    sections = [section(name, parser) for name, parser in commands().items()]
    return filled(document, {"commands": "\n\n".join(sections)})


def _rows(parser: argparse.ArgumentParser) -> Iterator[str]:
    for action in parser._actions:
        if action.help in {None, argparse.SUPPRESS} or action.dest == "help":
            continue
        value = action.metavar or ("|".join(map(str, action.choices)) if action.choices else "")
        if action.nargs == 0:
            value = ""
        names = ", ".join(f"`{f'{name} {value}'.strip()}`" for name in action.option_strings) or f"`{value}`"
        yield f"| {names.replace('|', chr(92) + '|')} | {_cell(action.help or '', parser, action)} |"


def _cell(text: str, parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    expanded = text % {**vars(action), "prog": parser.prog}
    return " ".join(expanded.split()).replace("|", "\\|")


def _usage(name: str, parser: argparse.ArgumentParser) -> str:
    # Not argparse's own: its line breaks differ between versions of Python.
    shapes = {None: "{0}", "?": "[{0}]", "*": "[{0} ...]", "+": "{0} [{0} ...]"}
    places = [
        shapes[action.nargs if isinstance(action.nargs, str) else None].format(action.metavar)
        for action in parser._actions
        if not action.option_strings
    ]
    return " ".join([name, *places, "[options]"])


def _prose(text: str) -> str:
    """Return a description as a paragraph; lines that are set in by hand stay as they are, as code."""
    lines = text.splitlines()
    free = [line for line in lines if not line.startswith("  ")]
    fixed = [line for line in lines if line.startswith("  ")]
    paragraph = re.sub(r"\s+", " ", " ".join(free)).strip()
    return paragraph + ("\n\n```sh\n" + "\n".join(line.strip() for line in fixed) + "\n```" if fixed else "")


if __name__ == "__main__":
    PAGE.write_text(fill(PAGE.read_text()))
