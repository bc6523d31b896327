"""What can go wrong on purpose: scenario table ``[faults]``, and the log that the truth keeps of every fault.

Two sorts. *Rates* act on each frame by chance, seeded, while the hand's timeline is between ``rates_from_s`` and
``rates_until_s``, or as the live command ``rates`` sets them. *Timed* faults (``[[faults.at]]``) happen once, at a time
of the hand's timeline. Replies (INFO, STATUS, ACK, ...) are spared by the faults on whole frames, so that a handshake
does not fail by chance; damage to bytes spares nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

from emulator import ScenarioError
from emulator.settings import Settings, choice, integer, number, tables

KINDS = ("stall", "unplug", "reset", "swap", "second-object", "wrong-version", "clock-step", "flood", "garbage")
_FOREVER_S = 1e9
_MAX_LOGGED = 20_000


@dataclass(frozen=True)
class TimedFault(Settings):
    """Scenario table ``[[faults.at]]``: one fault at one time."""

    kind: str = choice("stall", *KINDS)
    """stall: the link accepts nothing. unplug: the link vanishes and comes back. reset: the object loses power and is
    back with a new boot id, clock and sequence. swap: unplugged, and another object comes back. second-object: another
    object sends and answers on the same line. wrong-version: reset, and back with a firmware that speaks another major
    version. clock-step: the clock jumps. flood: samples at a multiple of the rate. garbage: bytes outside frames."""
    at_s: float = number(10.0, 0.0, _FOREVER_S)
    """When, s since the hand's timeline began."""
    for_s: float = number(1.0, 0.0, 86_400.0)
    """Stall, unplug, reset, swap, second-object, wrong-version, flood: for how long, s."""
    by_s: float = number(1.0, -5000.0, 5000.0)
    """Clock step: how far, s."""
    factor: float = number(10.0, 0.1, 100.0)
    """Flood: multiple of the rate."""
    count: int = integer(64, 1, 100_000)
    """Garbage: how many bytes."""
    major: int = integer(2, 0, 255)
    """Wrong-version: which major version."""


@dataclass(frozen=True)
class FaultSettings(Settings):
    """Scenario table ``[faults]``; the default is none."""

    rates_from_s: float = number(0.0, 0.0, _FOREVER_S)
    """Rates act from here, s since the hand's timeline began, ..."""
    rates_until_s: float = number(_FOREVER_S, 0.0, _FOREVER_S)
    """... to here, s."""
    drop_probability: float = number(0.0, 0.0, 1.0)
    """Of each sample's frame: it does not arrive."""
    duplicate_probability: float = number(0.0, 0.0, 1.0)
    """Of each sample's frame: it arrives twice."""
    reorder_probability: float = number(0.0, 0.0, 1.0)
    """Of each sample's frame: it changes places with the next one."""
    zero_quaternion_probability: float = number(0.0, 0.0, 1.0)
    """Of each ORIENTATION: all four numbers are zero, as a filter that fails with NaN sends them."""
    wrong_norm_probability: float = number(0.0, 0.0, 1.0)
    """Of each ORIENTATION: the quaternion has half its length."""
    sign_flip_probability: float = number(0.0, 0.0, 1.0)
    """Of each ORIENTATION: q is sent as −q, which is the same orientation."""
    bit_error_rate: float = number(0.0, 0.0, 0.5)
    """Of each bit of each frame, delimiters too."""
    burst_probability: float = number(0.0, 0.0, 1.0)
    """Of each frame: a run of ``burst_bits`` random bits in it."""
    burst_bits: int = integer(12, 2, 200)
    """Length of a burst, bits; its first and last bit are wrong, each between with chance one half."""
    truncate_probability: float = number(0.0, 0.0, 1.0)
    """Of each frame: its end is missing, from a random place on."""
    garbage_probability: float = number(0.0, 0.0, 1.0)
    """Before each frame: up to 40 random bytes."""
    garbage_before_bytes: int = integer(0, 0, 100_000)
    """Random bytes before the first frame that leaves."""
    command_loss_probability: float = number(0.0, 0.0, 1.0)
    """Of each command: it does not reach the object. Acts at any time."""
    delivery_interval_ms: float = number(0.0, 0.0, 1000.0)
    """Packets leave only at multiples of this: 1 as USB polls, 16 like an FTDI adapter, 30 like BLE; 0: at once."""
    delivery_jitter_ms: float = number(0.0, 0.0, 1000.0)
    """Each delivery is late by a random time up to this, ms; the order is kept."""
    at: tuple[TimedFault, ...] = tables(TimedFault)
    """Timed faults."""

    def __post_init__(self) -> None:
        super().__post_init__()
        total = self.zero_quaternion_probability + self.wrong_norm_probability + self.sign_flip_probability
        if total > 1.0 or self.drop_probability + self.duplicate_probability + self.reorder_probability > 1.0:
            raise ScenarioError("probabilities of faults that exclude each other must not sum to more than 1")


@dataclass(frozen=True)
class RateChange:
    """A live change of the rates of :class:`FaultSettings`, for some time or for good."""

    values: tuple[tuple[str, float], ...]
    """Name and value of each rate, checked."""
    for_s: float
    """How long; then the scenario's own rates act again. inf: until the next change."""

    def apply(self, settings: FaultSettings) -> FaultSettings:
        """Return settings with these rates.

        Raises
        ------
        ScenarioError
            A value out of range, or rates that exclude each other.
        """
        values: dict[str, Any] = dict(self.values)
        return replace(settings, **values)


RATES = tuple(
    field.name
    for field in fields(FaultSettings)
    if field.name not in ("rates_from_s", "rates_until_s", "garbage_before_bytes", "at")
)
"""What ``rates`` sets while the object runs."""
LiveFault: TypeAlias = TimedFault | RateChange
"""What can be typed while the object runs."""
_WHOLE = ("count", "burst_bits", "major")


def parse_fault_command(text: str) -> LiveFault:
    """Read a live command: a kind and settings, e.g. ``stall``, ``unplug for_s=2``, ``rates drop_probability=0.1``.

    Raises
    ------
    ScenarioError
        No such kind or setting, or a value out of range.
    """
    words = text.split()
    if not words:
        raise ScenarioError(f"a fault command is one of {', '.join(KINDS)} or rates, then settings such as for_s=2")
    known = ("for_s", *RATES) if words[0] == "rates" else ("for_s", "by_s", "factor", "count", "major")
    values: dict[str, Any] = {}
    for word in words[1:]:
        key, equals, value = word.partition("=")
        if not equals or key not in known:
            raise ScenarioError(f"unknown setting {word[:40]!r}: give {'=, '.join(known)}=")
        try:
            values[key] = int(value) if key in _WHOLE else float(value)
        except ValueError:
            raise ScenarioError(f"{key} must be a number, not {value[:40]!r}") from None
    if words[0] != "rates":
        return TimedFault(words[0], 0.0, **values)
    for_s = values.pop("for_s", math.inf)
    if not for_s > 0.0:
        raise ScenarioError(f"for_s must be above 0, not {for_s!r}")
    change = RateChange(tuple(values.items()), for_s)
    change.apply(FaultSettings())
    return change


class FaultLog:
    """Every fault that happened: the first 20 000 one by one, all by count."""

    def __init__(self) -> None:
        self.entries: list[dict[str, Any]] = []
        self.counts: Counter[str] = Counter()

    def add(self, kind: str, time_s: float, count: int = 1, **details: Any) -> None:  # noqa: ANN401
        """Note a fault at a time since power-up, s, with details ready for JSON.

        ``count`` is of how many bits, bytes or frames; 1 where there is only one thing it can happen to.
        """
        self.counts[kind] += 1
        if len(self.entries) < _MAX_LOGGED:
            self.entries.append({"kind": kind, "time_s": round(time_s, 6), "count": count, **details})
