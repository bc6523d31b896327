"""The account of every sample: produced = received + lost on the link + rejected + dropped + damaged in the file.

*Produced* counts from the first sample that could have come to the last one known of: samples received, or a STATUS
that reports how many there were. What is missing between them was *dropped* by the device (by its own counter),
*rejected* here (a frame arrived in its place with a wrong CRC or impossible values), or *lost* on the way; or the
recording that they are read from lacks the records they were in: *damaged in the file*, which no live link has.

A device reset closes the account of a segment and opens the next; that a segment ends is decided by the assembler
(:mod:`host.stream.samples`). The sum holds at any moment because only ``produced``, ``received``, ``rejected`` and
``dropped`` are counted, and ``lost`` is what they leave.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from firmware_protocol.packets import Status
from host.losses.object_counts import ANY_ROOM, FirstCounts, ObjectCounts, Verdict
from host.losses.runs import MissingRun, MissingRuns

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

MAX_RUNS_KEPT = 4096
"""Runs of missing samples remembered one by one; a sample later than so many is taken for a repeated one."""


@dataclass(frozen=True, slots=True)
class LossReport:
    """An account; ``produced == received + lost + rejected + dropped + damaged_in_file`` always."""

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
    damaged_in_file: int = 0
    """In records that the recording lacks: it was damaged after the capture."""

    @property
    def missing(self) -> int:
        """Samples that were produced and are not here."""
        return self.produced - self.received

    @property
    def share(self) -> float:
        """Missing samples as a share of those produced, 0-1."""
        return self.missing / self.produced if self.produced else 0.0


@dataclass(slots=True)
class _Account:
    """One segment. Its numbers are those of the samples, unwrapped by the caller from an arbitrary first."""

    runs: MissingRuns
    first: int | None = None  # number of the first sample that could have come
    last: int = -1  # largest number received
    known_end: int = 0  # number after the last sample known to have been produced
    received: int = 0
    duplicates: int = 0
    reordered: int = 0
    damaged: int = 0  # frames since the last sample
    spare: int = 0  # frames before it that stand for no sample missing there
    file_gap: bool = False  # the file lacks records behind the largest number received
    counts: ObjectCounts = field(default_factory=ObjectCounts)
    before: FirstCounts = field(default_factory=FirstCounts)  # STATUS before the first sample

    @property
    def produced(self) -> int:
        return 0 if self.first is None else self.known_end - self.first

    @property
    def tail(self) -> MissingRun | None:
        """What is known to be missing behind the last sample."""
        missing = self.known_end - self.last - 1
        return MissingRun(self.last + 1, missing, self.damaged, file_gap=self.file_gap) if missing > 0 else None

    @property
    def exact(self) -> bool:
        if self.produced == self.received:
            return True
        run = self.tail or self.runs.newest
        return self.counts.end is not None and (run is None or self.counts.end >= run.end)


class LossLedger:
    """Keeps the account while samples and STATUS come in wire order.

    Memory is bounded: of each account, and of closed accounts together, ``max_runs`` runs are kept one by one.
    """

    def __init__(self, max_runs: int = MAX_RUNS_KEPT) -> None:
        self._max_runs = max_runs
        self._closed = LossReport()
        self._closed_runs: deque[MissingRun] = deque(maxlen=max_runs)
        self._account = _Account(MissingRuns(max_runs))
        self.refused = 0
        """STATUS packets whose counters could not be."""
        self._ending: tuple[_Account, int] | None = None  # the account before, until the next sample; and its shift

    @property
    def is_new(self) -> bool:
        """Whether the present account waits for its first sample."""
        return self._account.first is None

    @property
    def known_end(self) -> int:
        """Number after the last sample of this account known to have been produced; 0 before its first."""
        return 0 if self.is_new else self._account.known_end

    def new_segment(self, shift: int = 0) -> None:
        """Close the account: the device was reset or its clock stepped, and its numbers cannot be compared.

        Adding ``shift`` makes of this account's numbers those of :meth:`missing_runs`. Until the next sample, damaged
        frames belong to it still: whether they came before or after the reset, nothing shows.
        """
        if self._account.first is not None:
            self._end()
            self._ending = self._account, shift
        self._account = _Account(MissingRuns(self._max_runs))

    def missing_runs(self, shift: int = 0) -> list[MissingRun]:
        """Return every run of missing samples kept, in order, with why each is missing; ``shift`` as above."""
        ending = [] if self._ending is None else _shifted(*self._ending)
        return [*self._closed_runs, *ending, *_shifted(self._account, shift)]

    def expected_start(self) -> int | None:
        """Return the number of the next sample produced, where a STATUS reported it before the first sample came."""
        account = self._account
        return account.before.start if account.first is None else None

    def forget_start(self) -> None:
        """Refuse the STATUS packets before the first sample, which does not go on from what they counted."""
        self._account.before = FirstCounts()
        self.refused += 1

    def first_number(self, number: int) -> int:
        """Return where an account that opens with this sample starts: a STATUS may have reported samples before it."""
        earlier = self._account.before.before(number)
        return number if earlier is None else earlier[0]

    def damaged(self, n: int) -> None:
        """Enter frames that arrived damaged, behind all samples so far."""
        account = self._account if self._ending is None else self._ending[0]
        account.damaged += n

    def file_gap(self) -> None:
        """Note that the recording lacks records behind all samples so far: what is missing there is not the link's.

        Right behind a reset it may belong to either account.
        """
        self._account.file_gap = True
        if self._ending is not None:
            self._ending[0].file_gap = True

    def feed(
        self,
        numbers: IntArray,
        damaged: IntArray | None = None,
        statuses: Sequence[tuple[int, Status, int]] = (),
    ) -> BoolArray:
        """Enter samples, and the STATUS packets among them.

        Parameters
        ----------
        numbers : (n,) int64
            Unwrapped sample numbers in wire order, n >= 1.
        damaged : (n,) int64, optional
            Frames that arrived damaged just before each; none by default.
        statuses : sequence of (int, Status, int)
            STATUS packets in wire order: before which of the samples each came, the packet, and its room as of
            :meth:`status`.

        Returns
        -------
        (n,) bool
            False for samples that were here before: they must not be used again.
        """
        n = len(numbers)
        keep = np.ones(n, dtype=np.bool_)
        # Nearly all samples come one after the other; then only counters move, whatever their number. A STATUS has to
        # be entered between the samples around it, because it settles all that it covers.
        counts_on = damaged is None and self._counts_on(numbers)
        if not counts_on and not statuses:
            return self._feed_disturbed(numbers, np.zeros(n, np.int64) if damaged is None else damaged.copy())
        done = 0
        for position, status, room in (*statuses, (n, None, 0)):
            if counts_on:
                self._account.received += position - done
                self._account.last += position - done
                self._know_of_last()
            elif position > done:
                part = slice(done, position)
                keep[part] = self.feed(numbers[part], None if damaged is None else damaged[part])
            if status is not None:
                self.status(status, room)
            done = position
        return keep

    def _counts_on(self, numbers: IntArray) -> bool:
        """Return whether every sample follows the one before, and nothing waits for the run that it explains."""
        account, n = self._account, len(numbers)
        waits = account.damaged + account.spare or account.file_gap
        if account.first is None or waits or int(numbers[-1]) - account.last != n:
            return False
        return bool(numbers[0] > account.last and (n == 1 or (numbers[1:] > numbers[:-1]).all()))

    def _know_of_last(self) -> None:
        account = self._account
        account.known_end = max(account.known_end, account.last + 1)
        account.runs.settle(account.last + 1)

    def _feed_disturbed(self, numbers: IntArray, damaged: IntArray) -> BoolArray:
        account = self._account
        if account.first is None:
            self._open(int(numbers[0]))
        damaged[0] += account.damaged
        account.damaged = 0
        keep = np.ones(len(numbers), dtype=np.bool_)
        # Gaps alone can be entered run by run. Where a sample went back, or ever did, it may fill a run, so that what
        # is missing changes with every sample.
        missing = np.diff(numbers, prepend=account.last) - 1
        if account.reordered or (missing < 0).any():
            for index, (number, hits) in enumerate(zip(numbers.tolist(), damaged.tolist(), strict=True)):
                keep[index] = self._enter(number, hits)
        else:
            for index in np.flatnonzero(missing).tolist():
                gone, in_file = int(missing[index]), account.file_gap and index == 0
                account.runs.add(MissingRun(int(numbers[index]) - gone, gone, int(damaged[index]), file_gap=in_file))
            account.file_gap = False
            account.received += len(numbers)
            account.last = int(numbers[-1])
        self._know_of_last()
        return keep

    def status(self, status: Status, room: int = ANY_ROOM) -> None:
        """Enter the object's own counters, if they can be.

        Parameters
        ----------
        status : Status
            The packet.
        room : int, optional
            How many samples the object can have produced since the newest sample, or before the first one since the
            last STATUS.
        """
        account = self._account
        if account.first is None:
            self.refused += account.before.judge(status, room) is Verdict.REFUSED
            return
        counts, dropped_before = account.counts, account.counts.dropped
        is_first = counts.base is None
        verdict = counts.judge(status, account.last + 1, room)
        self.refused += verdict is Verdict.REFUSED
        end = counts.end
        if verdict is not Verdict.BELIEVED or end is None:
            return
        if is_first:
            missing = account.produced - account.received + max(0, end - account.last - 1)
            # The counter starts at boot: drops from before the account cannot be told apart from those since. What is
            # missing now bounds those since; the rest is taken for older, and only what is dropped from here on counts.
            dropped_before = max(0, status.samples_dropped - missing)
        elif counts.dropped != dropped_before:
            dropped_before = counts.dropped  # the counts before were wrong
        # A later STATUS that counts less takes back what an earlier one had too many.
        account.known_end = max(account.last + 1, end)
        account.runs.take_back(end)
        account.runs.mark(end, max(0, status.samples_dropped - (dropped_before or 0)))
        account.runs.settle(account.last + 1)
        counts.dropped = status.samples_dropped

    def report(self) -> LossReport:
        """Return the account over all segments."""
        closed = self._closed if self._ending is None else _total(self._closed, self._ending[0])
        return _total(closed, self._account)

    def _end(self) -> None:
        """Close the account before the present one for good."""
        if self._ending is not None:
            self._closed = _total(self._closed, self._ending[0])
            self._closed_runs.extend(_shifted(*self._ending))
            self._ending = None

    def _open(self, number: int) -> None:
        self._end()
        account, earlier = self._account, self._account.before.before(number)
        # Numbers count on from a STATUS before the first sample (see SampleAssembler).
        if earlier is not None and account.before.last is not None:
            _, end, dropped = earlier
            account.counts.start(account.before.last, end)
            account.runs.mark(end, dropped)
        account.first = account.known_end = self.first_number(number)
        account.last = account.first - 1

    def _enter(self, number: int, damaged: int) -> bool:
        """Enter one sample of a disturbed run, and the damaged frames before it; return whether it is new."""
        account = self._account
        missing = max(0, number - account.last - 1)
        spare, account.spare = account.spare, max(0, damaged - missing)
        if account.spare and account.reordered:
            # More frames were damaged than are missing here. Where frames change places, one may belong to the gap in
            # front of the last sample, or (kept as spare) behind the next; elsewhere they are noise.
            account.spare -= account.runs.explain(account.last, account.spare)
        else:
            account.spare = 0
        if missing:
            account.runs.add(MissingRun(account.last + 1, missing, damaged + spare, file_gap=account.file_gap))
        if number <= account.last:
            if not account.runs.fill(number):
                account.duplicates += 1
                return False
            account.reordered += 1
        else:  # what came late shows nothing of what is missing in front of the next
            account.file_gap = False
        account.last = max(account.last, number)
        account.received += 1
        return True


def _total(closed: LossReport, account: _Account) -> LossReport:
    """Return closed accounts and another one together."""
    if account.first is None:
        return closed
    missing = account.runs.totals(account.tail)
    return LossReport(
        produced=closed.produced + account.produced,
        received=closed.received + account.received,
        lost=closed.lost + (account.produced - account.received - missing.missing) + missing.lost,
        rejected=closed.rejected + missing.rejected,
        dropped=closed.dropped + missing.dropped,
        duplicates=closed.duplicates + account.duplicates,
        reordered=closed.reordered + account.reordered,
        segments=closed.segments + 1,
        exact=closed.exact and account.exact,
        damaged_in_file=closed.damaged_in_file + missing.damaged_in_file,
    )


def _shifted(account: _Account, shift: int) -> list[MissingRun]:
    return [replace(run, first=run.first + shift) for run in account.runs.all_runs(account.tail)]
