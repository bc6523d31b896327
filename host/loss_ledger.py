"""The account of every sample: produced = received + lost on the link + rejected + dropped by the device.

*Produced* counts from the first sample that could have come to the last one known of: samples received, or a STATUS
that says how many there were. What is missing between them was *dropped* by the device (its own counter says how many),
*rejected* here (a frame arrived with a wrong CRC or impossible values; there cannot be more of these samples than
missing ones), or *lost* on the way. A device reset closes the account of a segment and opens the next.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.packets import SEQUENCE_MODULUS, Status

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MAX_GAPS_KEPT = 4096
"""Gaps remembered one by one; a sample later than so many gaps is taken for a repeated one."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A run of missing samples."""

    first: int
    """Unwrapped number of the first missing sample."""
    missing: int
    """How many in a row."""

    @property
    def end(self) -> int:
        """Number of the sample after the gap."""
        return self.first + self.missing


@dataclass(frozen=True, slots=True)
class LossReport:
    """An account; ``produced == received + lost + rejected + dropped`` always."""

    produced: int = 0
    received: int = 0
    """Different samples; late ones count here, repeated ones do not."""
    lost: int = 0
    """On the link."""
    rejected: int = 0
    """Arrived damaged."""
    dropped: int = 0
    """By the device, because its link was full."""
    duplicates: int = 0
    """Samples that came again; not part of the sum."""
    reordered: int = 0
    """Received samples that came late; part of ``received``."""
    segments: int = 0
    """Accounts: one, and one more for each reset of the device or step of its clock."""
    exact: bool = True
    """Whether the division between lost and dropped is the device's own: False where no STATUS covers a gap."""

    @property
    def missing(self) -> int:
        """Samples that were produced and are not here."""
        return self.produced - self.received

    @property
    def share(self) -> float:
        """Missing samples as a share of those produced, 0-1."""
        return self.missing / self.produced if self.produced else 0.0

    def to_json(self) -> dict[str, Any]:
        """Turn into what a result file says of losses."""
        values: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        values["dropped_by_device"] = values.pop("dropped")
        return values | {"missing": self.missing, "share": round(self.share, 9)}


@dataclass(slots=True)
class _Account:
    """One segment."""

    first: int | None = None  # number of the first sample that could have come
    last: int = -1  # largest number received
    known_end: int = 0  # number after the last sample known to have been produced
    received: int = 0
    duplicates: int = 0
    reordered: int = 0
    gaps: deque[Gap] = field(default_factory=lambda: deque(maxlen=MAX_GAPS_KEPT))
    dropped_at_first: int | None = None
    dropped_now: int | None = None
    status_end: int | None = None  # number the last STATUS covers up to
    base: int | None = None  # samples_produced minus unwrapped number
    pending: tuple[Status, Status] | None = None  # the first and the last STATUS before the first sample

    @property
    def produced(self) -> int:
        return 0 if self.first is None else self.known_end - self.first

    @property
    def dropped(self) -> int:
        if self.dropped_now is None or self.dropped_at_first is None:
            return 0
        return max(0, min(self.dropped_now - self.dropped_at_first, self.produced - self.received))

    @property
    def exact(self) -> bool:
        if self.produced == self.received:
            return True
        end_of_last_gap = self.known_end if self.known_end > self.last + 1 else (self.gaps[-1].end if self.gaps else 0)
        return self.status_end is not None and self.status_end >= end_of_last_gap


class LossLedger:
    """Keeps the account while samples and STATUS come in wire order. Memory is bounded."""

    def __init__(self) -> None:
        self._closed = LossReport()
        self._account = _Account()

    def new_segment(self) -> None:
        """Close the account: the device was reset or its clock stepped, and its numbers cannot be compared."""
        if self._account.first is not None:
            self._closed = _sum(self._closed, _report(self._account))
        self._account = _Account()

    def expected_start(self) -> int | None:
        """Give the number of the next sample produced, where a STATUS told before the first sample came."""
        account = self._account
        if account.pending is None or account.first is not None:
            return None
        return account.pending[1].samples_produced

    def feed(self, numbers: IntArray) -> BoolArray:
        """Enter samples.

        Parameters
        ----------
        numbers : (n,) int64
            Unwrapped sample numbers in wire order, n >= 1.

        Returns
        -------
        (n,) bool
            False for samples that were here before: they must not be used again.
        """
        account = self._account
        if account.first is None:
            self._open(int(numbers[0]))
        n = len(numbers)
        last = int(numbers[-1])
        if last - account.last == n and (n == 1 or (numbers[1:] > numbers[:-1]).all()) and numbers[0] > account.last:
            account.received += n
            account.last = last
            account.known_end = max(account.known_end, last + 1)
            return np.ones(n, dtype=np.bool_)
        step = np.diff(numbers, prepend=account.last)
        if (step > 0).all():
            for index in np.flatnonzero(step > 1).tolist():
                missing = int(step[index]) - 1
                account.gaps.append(Gap(int(numbers[index]) - missing, missing))
            account.received += len(numbers)
            account.last = int(numbers[-1])
            keep = np.ones(len(numbers), dtype=np.bool_)
        else:
            keep = np.array([self._enter(number) for number in numbers.tolist()], dtype=np.bool_)
        account.known_end = max(account.known_end, account.last + 1)
        return keep

    def status(self, status: Status) -> None:
        """Enter the device's own counters."""
        account = self._account
        if account.first is None:
            first = account.pending[0] if account.pending else status
            if status.samples_produced < first.samples_produced:
                first = status  # reset before the first sample
            account.pending = (first, status)
            return
        if account.base is None:
            # The low 16 bits are the next number; which wrap it is, the samples around it tell.
            ahead = (status.samples_produced - (account.last + 1)) % SEQUENCE_MODULUS
            if ahead >= SEQUENCE_MODULUS // 2:
                ahead -= SEQUENCE_MODULUS
            account.base = status.samples_produced - (account.last + 1 + ahead)
            missing = account.produced - account.received + max(0, ahead)
            # Drops from before we listened cannot be told from those since, unless nothing is missing since.
            account.dropped_at_first = max(0, status.samples_dropped - missing)
        end = status.samples_produced - account.base
        account.known_end = max(account.known_end, end)
        account.status_end = end
        account.dropped_now = status.samples_dropped

    def report(self, damaged_frames: int = 0) -> LossReport:
        """Give the account over all segments.

        Parameters
        ----------
        damaged_frames : int
            Frames that arrived damaged: as many samples at most count as rejected, the rest as lost.
        """
        total = self._closed
        if self._account.first is not None:
            total = _sum(total, _report(self._account))
        unexplained = total.lost
        rejected = min(damaged_frames, unexplained)
        return _replace(total, lost=unexplained - rejected, rejected=rejected)

    def _open(self, number: int) -> None:
        account = self._account
        account.first = number
        if account.pending is not None and 0 <= number - account.pending[1].samples_produced < SEQUENCE_MODULUS // 2:
            first, last = account.pending
            account.first = first.samples_produced
            account.base = 0
            account.status_end = last.samples_produced
            account.dropped_at_first, account.dropped_now = first.samples_dropped, last.samples_dropped
        account.last = account.first - 1
        account.known_end = account.first

    def _enter(self, number: int) -> bool:
        """Enter one sample of a disturbed run; returns whether it is new."""
        account = self._account
        if number > account.last:
            if number > account.last + 1:
                account.gaps.append(Gap(account.last + 1, number - account.last - 1))
            account.last = number
            account.received += 1
            return True
        for index in range(len(account.gaps) - 1, -1, -1):
            gap = account.gaps[index]
            if gap.first <= number < gap.end:
                left = Gap(gap.first, number - gap.first)
                right = Gap(number + 1, gap.end - number - 1)
                account.gaps[index] = left if left.missing else right
                if left.missing and right.missing:
                    account.gaps.insert(index + 1, right) if len(account.gaps) < MAX_GAPS_KEPT else None
                elif not left.missing and not right.missing:
                    del account.gaps[index]
                account.received += 1
                account.reordered += 1
                return True
            if gap.end <= number:
                break
        account.duplicates += 1
        return False


def _report(account: _Account) -> LossReport:
    missing = account.produced - account.received
    return LossReport(
        produced=account.produced,
        received=account.received,
        lost=missing - account.dropped,
        dropped=account.dropped,
        duplicates=account.duplicates,
        reordered=account.reordered,
        segments=1,
        exact=account.exact,
    )


def _sum(one: LossReport, other: LossReport) -> LossReport:
    total = {
        item.name: getattr(one, item.name) + getattr(other, item.name)
        for item in fields(LossReport)
        if item.name != "exact"
    }
    return LossReport(**total, exact=one.exact and other.exact)


def _replace(report: LossReport, **changes: int) -> LossReport:
    values = {item.name: getattr(report, item.name) for item in fields(report)} | changes
    return LossReport(**values)
