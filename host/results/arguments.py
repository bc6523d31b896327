"""Arguments that commands on recordings share: how to read a file, and which window of it counts."""

from __future__ import annotations

import argparse
import math
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analysis.scoring.result_parts import ExcludedCycle
    from host.results.any_file import ReadOptions
    from host.results.window import Bound, Window


def add_read_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare how to read a file that is not one of our recordings."""
    parser.add_argument("--columns", metavar="SPEC", help="meaning of the columns: t=time,qw=w,qx=x,qy=y,qz=z")
    parser.add_argument("--rate", type=float, metavar="HZ", help="sampling rate where a file has no time stamps")
    parser.add_argument("--topic", metavar="NAME", help="which topic of a bag, or station of a tracker's file")
    parser.add_argument(
        "--node", type=int, metavar="N", help="node id of the object in a CAN log; else the first heard"
    )
    parser.add_argument("--channel", metavar="NAME", help="which channel of a CAN log or an MCAP file holding several")
    parser.add_argument("--sensor", metavar="NAME", help="which sensor of a file holding several")
    parser.add_argument("--session", type=int, metavar="N", help="which session of a file holding several, from 1 on")


def reading(
    columns: str | None,
    rate_hz: float | None,
    topic: str | None,
    node: int | None,
    sensor: str | None,
    channel: str | None,
    session: int | None,
) -> ReadOptions:
    """Return how to read a file, as the arguments of :func:`add_read_arguments` choose."""
    from analysis.formats import StreamChoice
    from host.results.any_file import ReadOptions

    return ReadOptions(columns, rate_hz, topic, node, StreamChoice(sensor, channel, session))


def add_window_arguments(parser: argparse.ArgumentParser, note: str = "") -> None:
    """Declare the ends of a window; ``note`` goes behind the help of each."""
    parser.add_argument(
        "--from",
        dest="start",
        type=_parse_bound,
        metavar="S|MARKER",
        help=f"start of the window: seconds, or m1 for a marker{note}",
    )
    parser.add_argument("--to", dest="end", type=_parse_bound, metavar="S|MARKER", help=f"end of the window{note}")


def add_exclude_arguments(parser: argparse.ArgumentParser, note: str = "") -> None:
    """Declare cycles that are left out after the fact; ``note`` goes behind the help of the first."""
    parser.add_argument(
        "--exclude",
        type=_parse_cycles,
        action="extend",
        default=[],
        metavar="N[,N...]",
        help=f"leave these cycles out, by the numbers in the table of cycles{note}",
    )
    parser.add_argument("--because", metavar="TEXT", help="why they are left out; it stands in the result")


def excluded(cycles: list[int], because: str | None) -> tuple[ExcludedCycle, ...]:
    """Return the cycles that the arguments leave out.

    Raises
    ------
    UsageError
        A reason without cycles, or cycles without one.
    """
    from analysis.scoring.result_parts import ExcludedCycle
    from host.errors import UsageError
    from host.text import plain
    from host.trial.operator import MAX_TEXT

    reason = plain((because or "").strip(), MAX_TEXT)
    if bool(cycles) != bool(reason):
        missing = "--because needs cycles" if reason else "left-out cycles need a reason"
        raise UsageError(missing, "give both, e.g. --exclude 6 --because 'the table was bumped'")
    return tuple(ExcludedCycle.numbered(cycle, reason) for cycle in sorted(set(cycles)))


def window(start: Bound, end: Bound) -> Window | None:
    """Return the window that the arguments ask for; None where neither end was given."""
    return None if start is None and end is None else (start, end)


def _parse_cycles(text: str) -> list[int]:
    numbers = [part.strip() for part in text.split(",")]
    if not all(re.fullmatch(r"[1-9][0-9]{0,6}", number) for number in numbers):
        raise argparse.ArgumentTypeError(f"{text!r} is not a valid list of cycles (6 or 6,9), which count from 1")
    return [int(number) for number in numbers]


def _parse_bound(text: str) -> float | str:
    if re.fullmatch(r"m[0-9]{1,5}", text):
        return text
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise argparse.ArgumentTypeError(f"{text!r} is neither seconds (12.5) nor a marker (m1)")
    return seconds
