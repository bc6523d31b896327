"""``rotdrift config``: the defaults of a person or a project, and where each comes from."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.command_line.configuration import Chosen


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "config",
        help="show or set defaults: link, folder, baseline, ...",
        description=(
            "Show the defaults in force here and the file each comes from, or set one.\n"
            "An option on the command line counts before rotdrift.toml of this folder (or\n"
            "of the next one above that has it), and that before your own file."
        ),
        epilog="example: rotdrift config link serial:/dev/ttyACM0\n         rotdrift config --project hand hand.toml",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="which: link, folder, baseline, hand, theme, ascii")
    parser.add_argument("value", nargs="?", metavar="VALUE", help="the new default; without one, show it")
    parser.add_argument("--project", action="store_true", help="in rotdrift.toml here, not in your own file")
    parser.add_argument("--unset", action="store_true", help="take the setting out of the file")
    parser.add_argument("--json", action="store_true", help="print the settings as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Show or change settings.

    Raises
    ------
    UsageError
        No such setting, or a value that it cannot have.
    FileError
        A configuration file cannot be read or written.
    """
    from host.command_line.configuration import PROJECT_FILE, change, project_file, user_file
    from host.errors import UsageError
    from host.output.lines import write_line

    if args.unset and (args.name is None or args.value is not None):
        raise UsageError("--unset takes the name of one setting", "rotdrift config --unset link")
    if args.value is not None or args.unset:
        path = (project_file() or Path(PROJECT_FILE)) if args.project else user_file()
        change(path, args.name, args.value)
        if not args.json:
            write_line(path)
    _show(args.name, as_json=args.json)
    return 0


def _show(name: str | None, *, as_json: bool) -> None:
    from host.command_line.configuration import SETTINGS, chosen_settings, setting_of
    from host.output.lines import write_json, write_lines

    chosen = chosen_settings()
    settings = list(SETTINGS.values()) if name is None else [setting_of(name)]
    if as_json:
        values = {
            setting.name: {"value": _value(found.value), "source": str(found.source)} if found else None
            for setting in settings
            for found in [chosen.get(setting.name)]
        }
        write_json(json.dumps(values, indent=2, ensure_ascii=False) + "\n")
        return
    rows = [("setting", "value", "from")]
    for setting in settings:
        found = chosen.get(setting.name)
        rows.append((setting.name, setting.built_in, "-") if found is None else _row(setting.name, found))
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    write_lines(f"{one:{widths[0]}}  {value:{widths[1]}}  {source}" for one, value, source in rows)


def _value(value: object) -> str | bool:
    return value if isinstance(value, bool) else str(value)


def _row(name: str, found: Chosen) -> tuple[str, str, str]:
    from host.text import plain

    value = str(found.value).lower() if isinstance(found.value, bool) else str(found.value)
    return name, plain(value), plain(found.source)
