"""What the object itself counts, judged before it is believed.

A STATUS with a right checksum may still be wrong: a counter that was read while it was written, a memory fault, a
firmware's mistake. One absurd count would make a loss of millions of it. So the samples produced must fit the newest
sample and the time since, and those dropped must be among them. What does not fit is refused. Two STATUS in a row that
are refused and agree with each other are believed: then it was the one before them that was wrong.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from firmware_protocol.packets import MAX_RATE_HZ, SEQUENCE_MODULUS, Status

LATE_SAMPLES = 64
"""Samples that may overtake a STATUS on their way."""
SPARE_SAMPLES = 64
"""Samples that may have been produced beyond what the time explains."""
MAX_PRODUCED_HZ = 10 * MAX_RATE_HZ
"""No object produces more: ten times what the protocol allows."""
ANY_ROOM = 2**62
"""Where the time since the newest sample is not known."""

MAX_COUNT = 2**48
"""No object has produced so many samples: nine thousand years of the fastest."""
NO_ROOM = -(2**62)
"""Of a STATUS that cannot be the object's by its clock."""


def room_for(elapsed_us: float) -> int:
    """Return how many samples an object can have produced in some time of its clock, us."""
    return SPARE_SAMPLES + int(max(0.0, elapsed_us) * MAX_PRODUCED_HZ / 1e6)


class Verdict(enum.Enum):
    """What becomes of the counts of a STATUS."""

    BELIEVED = "they fit"
    STALE = "an older STATUS, which adds nothing"
    REFUSED = "they cannot be"


@dataclass(slots=True)
class ObjectCounts:
    """The believed counts of one account.

    A STATUS counts samples since boot, a sample carries 16 bits of that count. The account's own numbers are those of
    the samples, unwrapped by the caller from an arbitrary first; ``base`` is what lies between the two.
    """

    base: int | None = None
    """``samples_produced`` minus the account's number; None before the first STATUS among samples."""
    end: int | None = None
    """Number that the last STATUS covers up to."""
    dropped: int | None = None
    """As the last STATUS reported."""
    _uptime_us: int = 0
    _refused_base: int | None = None  # of the STATUS before, where it was refused

    def start(self, status: Status, end: int) -> None:
        """Begin with the last STATUS before the account's first sample, which covers up to number ``end``."""
        self.base, self.end = status.samples_produced - end, end
        self.dropped, self._uptime_us = status.samples_dropped, status.uptime_us

    def judge(self, status: Status, next_number: int, room: int) -> Verdict:
        """Judge a STATUS that came before sample ``next_number``, and keep it if it is believed.

        Parameters
        ----------
        room : int
            How many samples can have been produced since the newest one.
        """
        produced, dropped = status.samples_produced, status.samples_dropped
        # The low 16 bits are the next number; which wrap it is follows from the samples around it.
        ahead = (produced - next_number + SEQUENCE_MODULUS // 2) % SEQUENCE_MODULUS - SEQUENCE_MODULUS // 2
        base = produced - next_number - ahead
        end = produced - (base if self.base is None else self.base)
        is_older = self.end is not None and status.uptime_us <= self._uptime_us
        if is_older and self.end is not None and end <= self.end and dropped <= (self.dropped or 0):
            return Verdict.STALE
        fits = -LATE_SAMPLES <= end - next_number <= room and _are_counts(status)
        if self.end is not None and self.dropped is not None:
            fits = fits and dropped - self.dropped <= max(0, end - self.end)
        if not fits:
            agrees = self._refused_base == base and -LATE_SAMPLES <= ahead <= room and _are_counts(status)
            self._refused_base = base
            if not agrees:
                return Verdict.REFUSED
            # It was the STATUS believed before these two that was wrong. What they have dropped is not known from it.
            end, self.dropped = produced - base, dropped
            self.base = base
        self._refused_base = None
        self.base = base if self.base is None else self.base
        self.end, self._uptime_us = end, status.uptime_us
        return Verdict.BELIEVED


@dataclass(slots=True)
class FirstCounts:
    """The counts of STATUS packets that came before the first sample of an account."""

    first: Status | None = None
    last: Status | None = None
    _refused: Status | None = None

    def judge(self, status: Status, room: int) -> Verdict:
        """Judge one more, and keep it if it is believed; ``room`` is for samples since the one before."""
        last = self.last
        if not _are_counts(status):
            return Verdict.REFUSED
        if last is None:
            self.first = self.last = status
        elif _follows(last, status, room):
            self.last = status
        elif status.uptime_us < last.uptime_us and status.samples_produced < last.samples_produced:
            self.first = self.last = status  # the object was reset before the first sample
        elif self._refused is not None and _follows(self._refused, status, room):
            self.first, self.last = self._refused, status
        else:
            self._refused = status
            return Verdict.REFUSED
        self._refused = None
        return Verdict.BELIEVED

    @property
    def start(self) -> int | None:
        """Number of the next sample, as the object counts; None where no STATUS came."""
        return None if self.last is None else self.last.samples_produced

    def before(self, number: int) -> tuple[int, int, int] | None:
        """Return what was counted before a first sample of this number, if it goes on from there.

        Returns
        -------
        (int, int, int) or None
            Numbers of the first STATUS and of the last, and how many samples were dropped in between.
        """
        first, last, end = self.first, self.last, self.start
        if first is None or last is None or end is None or not 0 <= number - end < SEQUENCE_MODULUS // 2:
            return None
        produced = last.samples_produced - first.samples_produced
        return end - produced, end, min(produced, max(0, last.samples_dropped - first.samples_dropped))


def _follows(before: Status, status: Status, room: int) -> bool:
    produced = status.samples_produced - before.samples_produced
    dropped = status.samples_dropped - before.samples_dropped
    return 0 <= produced <= room and dropped <= produced


def _are_counts(status: Status) -> bool:
    return status.samples_dropped <= status.samples_produced < MAX_COUNT
