"""``rotdrift ports``: the serial ports and CAN interfaces of this machine, as links to copy."""

from __future__ import annotations

import argparse
import json
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
        help="listen 2 s on each for an object; nothing is sent on a bus or to a serial device, and ports held by "
        "other programs are left alone",
    )


def run(args: argparse.Namespace) -> int:
    """List the ports."""
    from host.output.lines import write_json, write_line

    rows = _rows()
    if args.probe:
        from host.doctor.object_probe import objects_on

        for row in rows:
            row["not_probed"] = _why_not(row)
        found = objects_on([row["link"] for row in rows if not row["not_probed"]])
        for row in rows:
            row["objects"] = found.get(row["link"], [])
    if args.json:
        write_json(json.dumps(rows, indent=2) + "\n")
    elif not rows:
        write_line("no serial ports or CAN interfaces here; plug the object in, or try `rotdrift demo` without one")
    else:
        _print(rows)
        if args.probe:
            _print_objects(rows)
    return 0


def _rows() -> list[dict[str, Any]]:
    from dataclasses import asdict

    from host.links.can.listing import list_can_ports
    from host.links.serial.listing import list_serial_ports

    serial_ports = list_serial_ports()
    rows = [{"kind": "serial", **asdict(port)} for port in serial_ports]
    return rows + [{"kind": "can", **asdict(port)} for port in list_can_ports(serial_ports)]


def _why_not(row: dict[str, Any]) -> str:
    """Return why a link is not listened to; empty where it is."""
    from host.links.can.listing import SLCAN_ADAPTERS

    if row.get("owners"):
        return "held by " + ", ".join(row["owners"])
    if row.get("state") == "down":
        return "down"
    if row.get("vid_pid") in SLCAN_ADAPTERS:
        return "an SLCAN adapter: its CAN link is listened to"
    if not row.get("can_listen", True):
        return "opening it could disturb what is there"
    return ""


def _print(rows: list[dict[str, Any]]) -> None:
    from rich.table import Table
    from rich.text import Text

    from host.output.drawings import open_console
    from host.text import one_line

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", pad_edge=False)
    for name in ("link", "VID:PID", "what it is", "held by"):
        table.add_column(name, no_wrap=True)
    for row in rows:
        state = f" ({row['state']})" if row.get("state") else ""
        cells = [row["link"], row.get("vid_pid", ""), row["description"] + state, ", ".join(row.get("owners", ()))]
        table.add_row(*(Text(one_line(cell)) for cell in cells))
    # As wide as it needs: a link is there to be copied.
    console = open_console()
    wide = console.measure(table, options=console.options.update(max_width=1000)).maximum
    open_console(width=max(console.width, wide)).print(table)


def _print_objects(rows: list[dict[str, Any]]) -> None:
    from host.output.lines import write_lines

    heard = [link for row in rows for link in row["objects"]]
    listened = sum(not row["not_probed"] for row in rows)
    lines = ["", "objects heard:", *(f"  {link}" for link in heard)]
    if not heard:
        lines = [
            "",
            f"no object was heard on {listened} link{'s' * (listened != 1)}; objects send something every second",
        ]
    skipped = [f"  {row['link']}  ({row['not_probed']})" for row in rows if row["not_probed"]]
    if skipped:
        lines += ["", "not listened to:", *skipped]
    write_lines(lines)
