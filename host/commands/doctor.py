"""``rotdrift doctor``: a report on machine and link, to read and to paste into a bug report."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from host.doctor.findings import Finding


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "doctor",
        help="check this machine, its ports and a link",
        description=(
            "Check versions, clock, disk and ports; with a LINK also the handshake with the object, then for some "
            "seconds rate, jitter, losses and clock skew. Exit code 0: all is well, 1: something is doubtful or bad, "
            "3: the link cannot be captured from."
        ),
    )
    parser.add_argument("link", metavar="LINK", nargs="?", help="serial:/dev/ttyACM0, can:socketcan:can0, ...")
    parser.add_argument("--seconds", type=float, default=5.0, metavar="S", help="how long to listen (default: 5)")
    parser.add_argument(
        "--folder", type=Path, default=Path(), metavar="DIR", help="where recordings go (default: here)"
    )
    parser.add_argument("--json", action="store_true", help="print the findings as a JSON list, and nothing else")


def run(args: argparse.Namespace) -> int:
    """Check machine and link, and print the findings.

    Raises
    ------
    UsageError
        --seconds is out of range, or LINK is not a link.
    """
    from host.doctor.findings import Verdict
    from host.doctor.link_check import check_link
    from host.doctor.machine_check import can_interfaces, clock_source, disk, serial_ports, versions
    from host.errors import UsageError
    from host.links.can.listing import list_can_ports
    from host.links.serial.listing import list_serial_ports
    from host.links.uri import parse_link_uri
    from host.output.lines import write_json
    from host.stop_signals import stop_on_signals

    if not 0.5 <= args.seconds <= 3600:
        raise UsageError(f"cannot listen for {args.seconds:g} s", "give --seconds from 0.5 to 3600")
    link = None if args.link is None else str(parse_link_uri(args.link))
    ports = list_serial_ports()
    machine = [*versions(), *clock_source(), *disk(args.folder)]
    machine += [*serial_ports(ports), *can_interfaces(list_can_ports(ports))]
    on_link: list[Finding] = []
    if link is not None:
        with stop_on_signals() as stop:
            on_link = check_link(link, args.seconds, stop)
    findings = machine + on_link
    if args.json:
        write_json(json.dumps([finding.to_json() for finding in findings], indent=2, ensure_ascii=False) + "\n")
    else:
        _print(findings)
    # With a link, only that link counts: a fault of a port that is not used does not matter.
    judged = on_link if link is not None else findings
    if any(finding.verdict is Verdict.BAD for finding in on_link):
        return 3
    return int(any(finding.verdict in {Verdict.DOUBTFUL, Verdict.BAD} for finding in judged))


def _print(findings: list[Finding]) -> None:
    from host.output.lines import write_line

    signs = {"info": " ", "ok": "+", "doubtful": "?", "bad": "!"}
    width = max(len(finding.topic) for finding in findings)
    for finding in findings:
        write_line(f"{signs[finding.verdict.value]} {finding.topic:{width}}  {finding.text}")
        if finding.remedy:
            write_line(f"  {'':{width}}  -> {finding.remedy}")
