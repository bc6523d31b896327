"""``rotdrift emulate``: a virtual object on a link."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import threading
    from queue import SimpleQueue

    from emulator.faults.definitions import LiveFault


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    parser = subparsers.add_parser(
        "emulate",
        help="run a virtual object on a link",
        description=(
            "Run a virtual sensorized object: a hand that turns it, a drift that is known, a sensor with faults, and "
            "the firmware of the real one. It runs until Ctrl-C, or for --duration."
        ),
    )
    parser.add_argument("--scenario", default="default", metavar="NAME|FILE", help="what happens (default: default)")
    parser.add_argument(
        "--link",
        metavar="LINK",
        help="needed: pty:PATH (the device to make), tcp:PORT here, file:PATH (bytes, in virtual time), "
        "can:slcan:pty, can:socketcand:PORT, can:udp_multicast:239.74.163.2, can:INTERFACE:CHANNEL",
    )
    parser.add_argument("--truth", metavar="FILE", help="write what really happened, as JSON")
    parser.add_argument("--duration", type=float, metavar="S", help="end after S seconds")
    parser.add_argument("--seed", type=int, metavar="N", help="another seed than the scenario's")
    parser.add_argument(
        "--faults-from-stdin",
        action="store_true",
        help="take faults as lines while it runs: stall for_s=2, unplug, reset, rates drop_probability=0.1, ...",
    )
    parser.add_argument(
        "--until-stdin-ends", action="store_true", help="end with the input: for a program that runs an object"
    )
    parser.add_argument("--list", action="store_true", help="list the scenarios")


def run(args: argparse.Namespace) -> int:
    """Run the virtual object until it is stopped.

    Raises
    ------
    UsageError
        Unknown scenario or impossible link.
    LinkError
        The link cannot be opened.
    """
    from emulator import EmulatorError, ScenarioError
    from emulator import LinkError as EmulatorLinkError
    from emulator.faults.frame_faults import byte_faults_in
    from emulator.links import open_link
    from emulator.runner import run as run_object
    from emulator.scenario import load_scenario, scenario_names
    from host.errors import FileError, LinkError, UsageError
    from host.output.lines import error_stream, write_line
    from host.stop_signals import stop_on_signals
    from host.text import plain

    if args.list:
        width = max(map(len, scenario_names()))
        for name in scenario_names():
            write_line(f"{name:{width}}  {plain(load_scenario(name).purpose)}")
        return 0
    _check(args)
    try:
        scenario = load_scenario(args.scenario)
        link = open_link(args.link)
    except (ScenarioError, EmulatorLinkError) as error:
        raise UsageError(str(error)) from error
    without_effect = () if link.carries_damage else byte_faults_in(scenario.faults)
    if without_effect:
        write_line(
            f"note: {', '.join(without_effect)} of the scenario have no effect on CAN: its controllers find damaged "
            "frames and send them again; to lose frames, set drop_probability",
            error_stream(),
        )
    if link.same_process:
        write_line(
            "note: a virtual bus ends in this process, so no other program can reach the object: for one on this "
            "machine, use can:udp_multicast:239.74.163.2 or can:slcan:pty",
            error_stream(),
        )
    try:
        with stop_on_signals() as stop:
            live_faults = _faults_from_stdin() if args.faults_from_stdin else None
            if args.until_stdin_ends:
                _stop_with_stdin(stop)
            run_object(
                scenario, link, args.duration, args.truth, stop, _report_ready, seed=args.seed, live_faults=live_faults
            )
    except ScenarioError as error:
        raise UsageError(str(error)) from error
    except EmulatorLinkError as error:
        raise LinkError(str(error)) from error
    except EmulatorError as error:
        raise FileError(str(error)) from error
    return 0


def _check(args: argparse.Namespace) -> None:
    """Check what the parser cannot."""
    from host.errors import UsageError, already_there

    if not args.link:
        raise UsageError("an object needs a link", "give --link pty:PATH or --link tcp:PORT")
    if args.duration is not None and not 0 < args.duration < 1e9:
        raise UsageError(f"{args.duration:g} s is not a valid duration", "give --duration in seconds, above 0")
    if args.seed is not None and not 0 <= args.seed < 2**32:
        raise UsageError(f"{args.seed} is not a valid seed", "give --seed from 0 to 4294967295")
    if args.faults_from_stdin and args.until_stdin_ends:
        raise UsageError("faults that are typed and the end of the input do not go together", "give one of the two")
    if args.truth is not None and Path(args.truth).exists():
        raise already_there(args.truth, "give another name with --truth, or move it away")


def _report_ready(host_uri: str) -> None:
    from host.output.lines import write_line

    write_line(f"ready: {host_uri}")


def _stop_with_stdin(stop: threading.Event) -> None:
    """Set ``stop`` when the input ends, as it does when whoever started us is gone, in whatever way."""
    import os
    import threading

    def wait() -> None:
        with contextlib.suppress(OSError):
            while os.read(0, 4096):  # not through sys.stdin, whose lock a thread must not hold when Python ends
                pass
        stop.set()

    threading.Thread(target=wait, name="rotdrift-stdin", daemon=True).start()


def _faults_from_stdin() -> SimpleQueue[LiveFault]:
    """Read fault commands in a thread of their own until the input ends; a wrong line is reported and passed over."""
    import threading
    from queue import SimpleQueue

    from emulator import ScenarioError
    from emulator.faults.definitions import parse_fault_command
    from host.output.lines import write_note
    from host.text import plain

    faults: SimpleQueue[LiveFault] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            if line.strip():
                try:
                    faults.put(parse_fault_command(line[:1000]))
                except ScenarioError as error:
                    write_note(plain(str(error), 300))

    threading.Thread(target=read, name="rotdrift-faults", daemon=True).start()
    return faults
