"""``rotdrift ports``: the serial ports and CAN interfaces of this machine, as links to copy."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "ports",
        help="list the ports of this machine",
        description="List serial ports and CAN interfaces, with the link to give.",
    )
    parser.add_argument("--json", action="store_true", help="print a JSON list, and nothing else")
    parser.add_argument(
        "--probe",
        action="store_true",
        help="listen 2 s on each for an object; nothing is sent, ports held by other programs are left alone",
    )


def run(args: argparse.Namespace) -> int:
    """List the ports."""
    rows = _rows()
    if args.probe:
        from host.transports.object_probe import objects_on

        free = [row["link"] for row in rows if not row.get("owners") and row.get("state") != "down"]
        found = objects_on(free)
        for row in rows:
            row["objects"] = found.get(row["link"], [])
    if args.json:
        sys.stdout.write(json.dumps(rows, indent=2) + "\n")
    elif not rows:
        sys.stdout.write(
            "no serial ports or CAN interfaces here; plug the object in, or try `rotdrift demo` without one\n"
        )
    else:
        _print(rows, probed=args.probe)
    return 0


def _rows() -> list[dict[str, Any]]:
    from host.transports.can_listing import list_can_ports
    from host.transports.serial_listing import list_serial_ports

    serial_ports = list_serial_ports()
    rows = [{"kind": "serial", **port.to_json()} for port in serial_ports]
    return rows + [{"kind": "can", **port.to_json()} for port in list_can_ports(serial_ports)]


def _print(rows: list[dict[str, Any]], *, probed: bool) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    for name in ("link", "VID:PID", "what it is", "held by", *(["objects"] if probed else [])):
        table.add_column(name)
    for row in rows:
        state = f" ({row['state']})" if row.get("state") else ""
        cells = [row["link"], row.get("vid_pid", ""), row["description"] + state, ", ".join(row.get("owners", ()))]
        if probed:
            cells.append("\n".join(row["objects"]) or "none heard")
        table.add_row(*(Text(cell) for cell in cells))
    Console(highlight=False).print(table)
