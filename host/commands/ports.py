"""``rotdrift ports``: the ports of this machine, as links to copy."""

from __future__ import annotations

import argparse
import json
import sys


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "ports", help="list the ports of this machine", description="List serial ports, with the link to give."
    )
    parser.add_argument("--json", action="store_true", help="print a JSON list, and nothing else")


def run(args: argparse.Namespace) -> int:
    """List the ports."""
    from host.transports.serial_listing import list_serial_ports

    ports = list_serial_ports()
    if args.json:
        sys.stdout.write(json.dumps([port.to_json() for port in ports], indent=2) + "\n")
        return 0
    if not ports:
        sys.stdout.write("no serial ports here; plug the object in, or try `rotdrift demo` without one\n")
        return 0
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    for name in ("link", "VID:PID", "what it is", "held by"):
        table.add_column(name)
    for port in ports:
        table.add_row(Text(port.link), Text(port.vid_pid), Text(port.description), Text(", ".join(port.owners)))
    Console(highlight=False).print(table)
    return 0
