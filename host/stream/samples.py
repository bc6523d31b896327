"""Packets in, orientation samples out: the one path for live capture, replay and scoring of a recording.

The time axis is the device's own clock, unwrapped, in seconds since the first sample. The host clock only says how many
times the device clock wrapped, and where a new segment lies after a reset. So a recording gives the very same samples
as the capture that made it.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from firmware_protocol.items import StreamItem
from firmware_protocol.packets import Event, Info, OrientationBatch, Status
from host.clock.device_clock import ClockUnwrapper
from host.clock.unwrap import changes
from host.losses.ledger import LossLedger, LossReport
from host.losses.runs import MissingRun
from host.stream.blocks import SampleBlock, SegmentStart, selected
from host.stream.numbers import SequenceUnwrapper

IntArray = npt.NDArray[np.int64]

HELD_NS = 3_000_000_000
"""How long samples are held back until a reopened link's object says who it is; later they are taken for its own."""
MAX_HELD = 10_000
"""And how many at most."""
DOUBT_NS = 300_000_000
"""How long samples are held back at least after a jump of the clock that nothing explains: a second object on the same
line, if it is one, has said by then who it is."""
CROWDED_JUMPS = 4
CROWDED_NS = 2_000_000_000
"""So many jumps of the clock within so long are two objects that send in turn, or one that starts again and again."""
CROWDED = "two objects send on this line at once (or one that starts again and again): its samples are left out"
CONTINUES_WITHIN = 0.1
"""After a step of the device clock the numbers count on if they fit the host's time to this share (or 64 samples)."""


@dataclass(frozen=True, slots=True)
class TimedStatus:
    """A STATUS among samples."""

    position: int
    """Before which of them it came."""
    status: Status
    host_time_ns: int
    """Reception of its chunk, monotonic."""


class SampleAssembler:
    """Orders packets of one object into samples: unwraps time and number, drops repeated ones, keeps the ledger.

    Parameters
    ----------
    ledger : LossLedger, optional
        New; one that keeps more runs of missing samples than usual.
    """

    def __init__(self, ledger: LossLedger | None = None) -> None:
        self.ledger = ledger or LossLedger()
        self.info: Info | None = None
        """The object as it last introduced itself."""
        self.status: Status | None = None
        """Its last STATUS."""
        self.segments: list[SegmentStart] = []
        self._clock = ClockUnwrapper()
        self._sequence = SequenceUnwrapper()
        self._segment = -1
        self._open_reason: str | None = "the capture began"
        self._origin_us = 0  # device time of the segment's first sample
        self._offset_s = 0.0  # where it lies on the time axis
        self._origin_host_ns: int | None = None  # reception of the capture's first sample
        self._newest_s = 0.0
        self._newest_host_ns = 0
        self._index_shift = 0
        self._next_index = 0
        self._newest: tuple[int, int] | None = None  # number and device time of the last sample, as on the wire
        self._n_given = self._n_fed = 0  # samples that came, and those of them that are not held back any more
        self._damage: deque[int] = deque()  # of damaged frames: after how many samples that came
        self._held: list[tuple[StreamItem, int]] | None = None  # until it is known who is there
        self._n_held = 0
        self._wait_ns = HELD_NS
        self._doubts_clock = self._releases = False
        self._reopened = False  # since the object last introduced itself
        self._foreign = self._crowded = False
        self._jumps_ns: deque[int] = deque(maxlen=CROWDED_JUMPS)

    @property
    def foreign(self) -> bool:
        """Whether another object answers now, or two at once; samples are left out then."""
        return self._foreign or self._crowded

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of who sends here."""
        return (CROWDED,) if self._crowded else ()

    @property
    def doubtful(self) -> bool:
        """Whether the clock jumped and samples are held back until the object says again who it is: ask it."""
        return self._doubts_clock and self._held is not None

    def reopened(self) -> None:
        """Take note that the link was lost and opened again: another object may be there now.

        An object that once said who it is must say so again; until then its samples are held back, bounded by
        :data:`HELD_NS` and :data:`MAX_HELD`.
        """
        self._reopened = True
        self._crowded = False
        self._jumps_ns.clear()
        if self.info is not None and self._held is None:
            self._begin_hold()

    def _begin_hold(self, doubts_clock: bool = False) -> None:
        self._held, self._n_held, self._wait_ns, self._doubts_clock = [], 0, HELD_NS, doubts_clock

    def feed(self, items: Iterable[StreamItem], host_time_ns: int) -> list[SampleBlock]:
        """Take the packets of one chunk in wire order; return the new samples.

        Parameters
        ----------
        items : iterable of StreamItem
            As the link decoded them; packets that are no samples are taken note of.
        host_time_ns : int
            Reception of the chunk, monotonic.
        """
        blocks: list[SampleBlock] = []
        for item in items:
            if isinstance(item, OrientationBatch):
                self._n_given += len(item)
            if isinstance(item, Info):
                blocks += self._feed_info(item)
            elif isinstance(item, OrientationBatch | Status) and not self.foreign:
                blocks += self._feed_item(item, host_time_ns) if self._held is None else self._hold(item, host_time_ns)
            if self._held is None:
                self._n_fed = self._n_given
        return blocks

    def damaged(self, places: Iterable[int]) -> None:
        """Take note of damaged frames, before the packets around them are fed.

        Parameters
        ----------
        places : iterable of int
            After how many samples, of all that were ever fed, each came; ascending.
        """
        self._damage.extend(places)

    def feed_run(
        self, batch: OrientationBatch, host_time_ns: IntArray, statuses: Sequence[TimedStatus] = ()
    ) -> SampleBlock | None:
        """Take the samples of many chunks at once, where nothing about them is in doubt.

        Parameters
        ----------
        batch : OrientationBatch
            n >= 1 samples in wire order.
        host_time_ns : (n,) int64
            Reception of each sample's chunk.
        statuses : sequence of TimedStatus
            The STATUS packets among them, in wire order; no other packet was.

        Returns
        -------
        SampleBlock or None
            The new samples, the same as :meth:`feed` gives chunk by chunk. None, and nothing is taken in, where a
            segment begins, samples are held back, or the clock may jump: then feed the chunks one by one.
        """
        if self._held is not None or self.foreign or self._open_reason is not None or self._steps_back(batch):
            return None
        # An object that has said who it is answers for its STATUS: see _is_anothers.
        if self.info is not None and not all(
            self._clock.is_plain(item.status.uptime_us, item.host_time_ns) for item in statuses
        ):
            return None
        times_us = self._clock.feed_many(batch.device_time_us, host_time_ns)
        if times_us is None:
            return None
        self._n_given += len(batch)
        if statuses:
            self.status = statuses[-1].status
        among = [(item.position, item.status) for item in statuses]
        return self._feed_piece(batch, times_us, slice(None), int(host_time_ns[-1]), among)

    def _feed_item(self, item: StreamItem, host_time_ns: int) -> list[SampleBlock]:
        if isinstance(item, OrientationBatch):
            return self._feed_batch(item, host_time_ns)
        if isinstance(item, Status):
            if self._is_anothers(item, host_time_ns):
                self._begin_hold(doubts_clock=True)
                return self._hold(item, host_time_ns)
            self.status = item
            self.ledger.status(item)
        return []

    def _is_anothers(self, status: Status, host_time_ns: int) -> bool:
        """Whether a STATUS tells of a clock that cannot be the one the samples have."""
        if self.info is None or self._releases or self._open_reason is not None:
            return False
        return self._clock.newest_us is not None and self._clock.locate(status.uptime_us, host_time_ns) is None

    def _hold(self, item: StreamItem, host_time_ns: int) -> list[SampleBlock]:
        assert self._held is not None
        self._held.append((item, host_time_ns))
        self._n_held += len(item) if isinstance(item, OrientationBatch) else 1
        overdue = self._n_held > MAX_HELD or host_time_ns - self._held[0][1] > self._wait_ns
        return self.release() if overdue else []

    def release(self) -> list[SampleBlock]:
        """Take samples still held back for the object's own; return them."""
        held, self._held = self._held or [], None
        self._releases = True
        blocks = [
            block for item, host_time_ns in held if not self._crowded for block in self._feed_item(item, host_time_ns)
        ]
        self._releases = False
        return blocks

    def locate_s(self, event: Event, host_time_ns: int) -> float | None:
        """Place an event on the time axis; None where no sample of its segment has come."""
        located_us = self._clock.locate(event.device_time_us, host_time_ns)
        if located_us is None or self._open_reason is not None:
            return None
        return self._offset_s + (located_us - self._origin_us) / 1e6

    def losses(self) -> LossReport:
        """Give the account so far; see :meth:`LossLedger.report`."""
        self._hand_over_damage()
        return self.ledger.report()

    def missing_runs(self) -> list[MissingRun]:
        """Give the runs of missing samples, numbered as :attr:`SampleBlock.index`, with why each is missing."""
        self._hand_over_damage()
        return self.ledger.missing_runs(self._index_shift)

    def _hand_over_damage(self) -> None:
        """Tell the ledger of damaged frames behind the last sample."""
        n = 0
        while self._damage and self._damage[0] <= self._n_fed:
            self._damage.popleft()
            n += 1
        if n:
            self.ledger.damaged(n)

    def _damaged_before(self, n: int) -> IntArray | None:
        """Count the damaged frames before each of the next n samples, and move on behind these; None without any."""
        first, self._n_fed = self._n_fed, self._n_fed + n
        if not self._damage or self._damage[0] >= self._n_fed:
            return None
        counts = np.zeros(n, np.int64)
        while self._damage and self._damage[0] < self._n_fed:
            counts[max(self._damage.popleft() - first, 0)] += 1
        return counts

    def _feed_info(self, info: Info) -> list[SampleBlock]:
        if self.info is not None and info.device_id != self.info.device_id:
            self._foreign, self._held = True, None
            self._crowded = self._crowded or not self._reopened
            return []
        self._foreign = self._reopened = False
        was_reset = self.info is not None and info.boot_id != self.info.boot_id
        if was_reset:
            self._clock.new_segment()
            self._begin_segment("the object was reset")
        self.info = info
        if self._held and self._doubts_clock and not was_reset:
            self._wait_ns = DOUBT_NS  # it is there; whether another one is too, it does not say
            return []
        return self.release()

    def _feed_batch(self, batch: OrientationBatch, host_time_ns: int) -> list[SampleBlock]:
        if not len(batch):
            return []
        before = None if self.info is None or self._releases else copy.copy(self._clock)
        steps_back = self._steps_back(batch)
        times_us = self._clock.feed(batch.device_time_us, host_time_ns)
        cuts = sorted({*steps_back, *(step.index for step in self._clock.take_steps())})
        if cuts and before is not None:
            before.take_steps()  # they are those of its copy
            self._clock = before
            return self._doubt(batch, cuts[0], host_time_ns)
        blocks = []
        bounds = sorted({0, *cuts, len(batch)})
        for start, end in pairwise(bounds):
            if start in cuts:
                self._clock_stepped(int(batch.sequence[start]), int(times_us[start]), host_time_ns)
            if self._crowded:
                break
            block = self._feed_piece(batch, times_us, slice(start, end), host_time_ns)
            if len(block):
                blocks.append(block)
        return blocks

    def _doubt(self, batch: OrientationBatch, index: int, host_time_ns: int) -> list[SampleBlock]:
        """Hold back what comes from ``index`` on, where the clock jumps: it may be another object's."""
        blocks = self._feed_batch(batch.part(slice(0, index)), host_time_ns)
        self._begin_hold(doubts_clock=True)
        return blocks + self._hold(batch.part(slice(index, None)), host_time_ns)

    def _steps_back(self, batch: OrientationBatch) -> list[int]:
        """Find samples that are newer by their number than the one before, but older by the device clock.

        Such a step of the clock may be too small for the unwrapping, which takes it for a late sample.
        """
        if len(batch) == 1 and self._newest is not None:  # most of what comes live
            sequence, time_us = self._newest
            on = (int(batch.sequence[0]) - sequence) % 65536
            back = (time_us - int(batch.device_time_us[0])) % 2**32
            return [0] if 0 < on < 32768 and 0 < back < 2**31 else []
        before = self._newest or (int(batch.sequence[0]), int(batch.device_time_us[0]))
        newer = changes(batch.sequence, before[0]).view(np.int16) > 0
        older = changes(batch.device_time_us, before[1]).view(np.int32) < 0
        found: list[int] = np.flatnonzero(newer & older).tolist()
        return found

    def _clock_stepped(self, number: int, time_us: int, host_time_ns: int) -> None:
        """Decide what a jump of the device clock was: a reset (numbers begin anew) or a step (they count on)."""
        self._jumps_ns.append(host_time_ns)
        if len(self._jumps_ns) == CROWDED_JUMPS and host_time_ns - self._jumps_ns[0] <= CROWDED_NS:
            self._crowded = True
        period_us = self._sequence.period_us
        last = self._next_index - 1 - self._index_shift
        if period_us is not None and self._open_reason is None:
            expected = (host_time_ns - self._newest_host_ns) / 1e3 / period_us
            change = (number - last) % 65536
            if abs(change - expected) <= max(64.0, CONTINUES_WITHIN * expected):
                self._sequence.rebase_time(int(time_us - change * period_us))
                self._open_reason = "the device clock stepped"
                return
        self._begin_segment("the device clock began anew")

    def _begin_segment(self, reason: str) -> None:
        self._hand_over_damage()
        self.ledger.new_segment(self._index_shift)
        self._sequence.restart()
        self._newest = None
        if self._open_reason is None:
            self._open_reason = reason

    def _feed_piece(
        self,
        batch: OrientationBatch,
        times_us: IntArray,
        piece: slice,
        host_time_ns: int,
        statuses: Sequence[tuple[int, Status]] = (),
    ) -> SampleBlock:
        times_us = times_us[piece]
        expected = self.ledger.expected_start()
        if expected is not None:
            self._sequence.restart(expected)
        numbers = self._sequence.feed(batch.sequence[piece], times_us)
        if self._open_reason is not None:
            self._open_segment(int(times_us[0]), int(numbers[0]), host_time_ns)
        last = (len(batch) if piece.stop is None else piece.stop) - 1
        self._newest = int(batch.sequence[last]), int(batch.device_time_us[last])
        keep = self.ledger.feed(numbers, self._damaged_before(len(numbers)), statuses)
        time_s = self._offset_s + (times_us - self._origin_us) / 1e6
        self._newest_s = max(self._newest_s, float(time_s.max()))
        self._newest_host_ns = host_time_ns
        index = numbers + self._index_shift if self._index_shift else numbers
        self._next_index = max(self._next_index, int(index.max()) + 1)
        block = SampleBlock(
            segment=self._segment,
            sequence=numbers,
            index=index,
            time_s=time_s,
            quats_wxyz=batch.quats_wxyz[piece],
            flags=batch.flags[piece],
            host_time_ns=host_time_ns,
        )
        return block if keep.all() else selected(block, keep)

    def _open_segment(self, time_us: int, number: int, host_time_ns: int) -> None:
        assert self._open_reason is not None
        self._segment += 1
        if self._origin_host_ns is None:
            self._origin_host_ns = host_time_ns
            self._offset_s, self._index_shift = 0.0, 0
        else:
            since_s = (host_time_ns - self._origin_host_ns) / 1e9
            self._offset_s = max(since_s, self._newest_s + 1e-3)
            if self.ledger.is_new or number + self._index_shift < self._next_index:
                self._index_shift = self._next_index - self.ledger.first_number(number)
        self._origin_us = time_us
        self.segments.append(SegmentStart(self._segment, self._offset_s, host_time_ns, self._open_reason))
        self._open_reason = None
