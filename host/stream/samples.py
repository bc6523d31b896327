"""Packets in, orientation samples out: the one path for live capture, replay and scoring of a recording.

The time axis is the device's own clock, unwrapped, in seconds since the first sample. The host clock only decides how
many times the device clock wrapped, and where a new segment lies after a reset. So a recording gives the very same
samples as the capture that made it.

Here, and nowhere else, device time and sample numbers are unwrapped, and it is decided where a new segment starts:

- INFO carries another boot id: the object was reset.
- The device clock jumps (or falls back although the numbers go on) and the numbers fit the time that went by: the
  clock stepped, and the numbers count on.
- It jumps and they do not fit: clock and numbers started again.

The ledger, the clock estimate, the session and the recording's arrivals are informed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from firmware_protocol.items import StreamItem
from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US, SEQUENCE_MODULUS, Event, Info, OrientationBatch, Status
from host.clock.unwrap import ClockUnwrapper, changes
from host.losses.ledger import MAX_RUNS_KEPT, LossLedger, LossReport
from host.losses.runs import MissingRun
from host.stream.blocks import RESET, RESTARTED, STEPPED, SampleBlock, UnwrappedSamples
from host.stream.damage import DamagePlaces
from host.stream.held_samples import HeldSamples, Meeting
from host.stream.numbers import SequenceUnwrapper
from host.stream.time_axis import TimeAxis

IntArray = npt.NDArray[np.int64]

CROWDED = "two objects send on this line at once (or one that starts again and again): its samples are left out"
CONTINUES_WITHIN = 0.1
"""After a step of the device clock the numbers count on if they fit the host's time to this share ..."""
CONTINUES_SAMPLES = 64.0
"""... or to so many samples."""


@dataclass(frozen=True, slots=True)
class TimedStatus:
    """A STATUS among samples: before which of them it came, and when its chunk was received."""

    position: int
    status: Status
    host_time_ns: int


class SampleAssembler:
    """Orders packets of one object into samples: unwraps time and number, drops repeated ones, keeps the ledger.

    Of missing samples it remembers ``max_runs`` runs one by one.
    """

    def __init__(self, max_runs: int = MAX_RUNS_KEPT) -> None:
        self.status: Status | None = None
        """Its last STATUS."""
        self.on_segment: list[Callable[[str], object]] = []
        """Called with the reason where it is decided that a new segment starts with the next sample."""
        self.on_samples: list[Callable[[UnwrappedSamples], object]] = []
        """Called with all samples that are placed, in order."""
        self._ledger = LossLedger(max_runs)
        self._clock = ClockUnwrapper()
        self._numbers = SequenceUnwrapper()
        self._axis = TimeAxis()
        self.segments = self._axis.segments
        """Where each segment starts."""
        self._held = HeldSamples()
        self._damage = DamagePlaces()
        self._newest: tuple[int, int] | None = None  # number and device time of the last sample, as on the wire
        self._index_shift = 0  # index within the capture minus number within the segment
        self._next_index = 0

    @property
    def info(self) -> Info | None:
        """The object as it last introduced itself."""
        return self._held.info

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of who sends here."""
        return (CROWDED,) if self._held.crowded else ()

    @property
    def doubtful(self) -> bool:
        """Whether the clock jumped and samples are held back until the object introduces itself again: ask it."""
        return self._held.doubts_clock

    def reopened(self) -> None:
        """Note that the link was lost and opened again: another object may be there now.

        An object that once introduced itself must do so again; until then its samples are held back, bounded by
        :data:`host.stream.held_samples.HELD_NS` and :data:`host.stream.held_samples.MAX_HELD`.
        """
        self._held.reopened()

    def feed(self, items: Iterable[StreamItem], host_time_ns: int) -> list[SampleBlock]:
        """Process the packets of one chunk in wire order, received at ``host_time_ns``; return the new samples.

        Of packets that are no samples, INFO and STATUS count.
        """
        blocks: list[SampleBlock] = []
        for item in items:
            if isinstance(item, OrientationBatch):
                self._damage.n_came += len(item)
            if isinstance(item, Info):
                blocks += self._feed_info(item)
            elif isinstance(item, OrientationBatch | Status) and not self._held.foreign:
                if self._held.holding:
                    blocks += self._hold(item, host_time_ns)
                else:
                    blocks += self._feed_item(item, host_time_ns)
            if not self._held.holding:
                self._damage.pass_over()
        return blocks

    def damaged(self, places: Iterable[int]) -> None:
        """Note after how many samples, of all ever fed, damaged frames came (ascending), before those are fed."""
        self._damage.add(places)

    def feed_run(
        self, batch: OrientationBatch, host_time_ns: IntArray, statuses: Sequence[TimedStatus] = ()
    ) -> SampleBlock | None:
        """Process the samples of many chunks at once, where nothing about them is in doubt.

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
            The new samples, the same as :meth:`feed` returns chunk by chunk. None, and nothing is taken into account,
            where a segment starts, samples are held back, or the clock may jump: then feed the chunks one by one.
        """
        if self._held.holding or self._held.foreign or not self._axis.is_open or self._falls_back(batch):
            return None
        # An object that has introduced itself answers for its STATUS: see _feed_status.
        if self.info is not None and not all(
            self._clock.is_plain(item.status.uptime_us, item.host_time_ns) for item in statuses
        ):
            return None
        times_us = self._clock.unwrap_many(batch.device_time_us, host_time_ns)
        if times_us is None:
            return None
        self._damage.n_came += len(batch)
        if statuses:
            self.status = statuses[-1].status
        among = [(item.position, item.status) for item in statuses]
        return self._place(batch, times_us, int(host_time_ns[-1]), among)

    def release(self) -> list[SampleBlock]:
        """Count samples still held back as the object's own; return them."""
        blocks = []
        for item, host_time_ns in self._held.release():
            if not self._held.crowded:
                blocks += self._feed_item(item, host_time_ns, believed=True)
        return blocks

    def locate_us(self, device_time_us: int, host_time_ns: int) -> int | None:
        """Unwrap a reading of the device clock; see :meth:`host.clock.unwrap.ClockUnwrapper.locate`."""
        return self._clock.locate(device_time_us, host_time_ns)

    def locate_s(self, event: Event, host_time_ns: int) -> float | None:
        """Place an event on the time axis; None where no sample of its segment has come."""
        located_us = self._clock.locate(event.device_time_us, host_time_ns)
        return None if located_us is None or not self._axis.is_open else self._axis.at_s(located_us)

    def losses(self) -> LossReport:
        """Return the account so far, over all segments."""
        self._enter_damage()
        return self._ledger.report()

    def missing_runs(self) -> list[MissingRun]:
        """Return the runs of missing samples, numbered as :attr:`SampleBlock.index`, with why each is missing."""
        self._enter_damage()
        return self._ledger.missing_runs(self._index_shift)

    def _enter_damage(self) -> None:
        """Enter the damaged frames behind the last sample into the ledger."""
        self._ledger.damaged(self._damage.take_behind())

    def _hold(self, item: StreamItem, host_time_ns: int) -> list[SampleBlock]:
        return self.release() if self._held.hold(item, host_time_ns) else []

    def _feed_info(self, info: Info) -> list[SampleBlock]:
        meeting = self._held.meet(info)
        if meeting is Meeting.ANOTHER:
            return []
        if meeting is Meeting.RESET:
            self._clock.new_segment()
            self._start_segment(RESET)
        elif self._held.wait_for_another():
            return []
        return self.release()

    def _feed_item(self, item: StreamItem, host_time_ns: int, *, believed: bool = False) -> list[SampleBlock]:
        """Process samples or a STATUS; unless ``believed``, a jump of the clock puts a known object in doubt."""
        doubts = self.info is not None and not believed
        if isinstance(item, OrientationBatch):
            return self._feed_batch(item, host_time_ns, doubts)
        if isinstance(item, Status):
            return self._feed_status(item, host_time_ns, doubts)
        return []

    def _feed_status(self, status: Status, host_time_ns: int, doubts: bool) -> list[SampleBlock]:
        # One whose clock cannot be that of the samples may be another object's.
        if doubts and self._axis.is_open and self._clock.locate(status.uptime_us, host_time_ns) is None:
            self._held.start(doubts_clock=True)
            return self._hold(status, host_time_ns)
        self.status = status
        self._ledger.status(status)
        return []

    def _feed_batch(self, batch: OrientationBatch, host_time_ns: int, doubts: bool) -> list[SampleBlock]:
        """Place the samples of a batch, piece by piece from one jump of the clock to the next.

        Where ``doubts``, only up to the first: what comes from there on may be another object's, and is held back
        before the clock or the numbers have taken it into account.
        """
        blocks: list[SampleBlock] = []
        falls = self._falls_back(batch)
        stop = falls[0] if doubts and falls else len(batch)
        start, jumped = 0, False
        while start < len(batch):
            times_us = self._clock.unwrap(batch.device_time_us[start:stop], host_time_ns)
            end = start + len(times_us)
            for first, last in pairwise(sorted({start, *(k for k in falls if start < k < end), end})):
                piece_us = times_us[first - start : last - start]
                if first in falls or (jumped and first == start):
                    self._judge_jump(int(batch.sequence[first]), int(piece_us[0]), host_time_ns)
                    if self._held.crowded:
                        return blocks
                piece = batch if last - first == len(batch) else batch.part(slice(first, last))
                block = self._place(piece, piece_us, host_time_ns)
                if len(block):
                    blocks.append(block)
            if end < len(batch):
                if doubts:
                    self._held.start(doubts_clock=True)
                    return blocks + self._hold(batch.part(slice(end, None)), host_time_ns)
                self._clock.new_segment()
            start, jumped = end, True
        return blocks

    def _falls_back(self, batch: OrientationBatch) -> list[int]:
        """Find samples that are newer by their number than the one before, but older by the device clock.

        Such a step of the clock may be too small for the unwrapping, which takes it for a late sample.
        """
        if len(batch) == 1 and self._newest is not None:  # most of what comes live
            sequence, time_us = self._newest
            on = (int(batch.sequence[0]) - sequence) % SEQUENCE_MODULUS
            back = (time_us - int(batch.device_time_us[0])) % DEVICE_CLOCK_MODULUS_US
            return [0] if 0 < on < SEQUENCE_MODULUS // 2 and 0 < back < DEVICE_CLOCK_MODULUS_US // 2 else []
        before = self._newest or (int(batch.sequence[0]), int(batch.device_time_us[0]))
        newer = changes(batch.sequence, before[0]).view(np.int16) > 0
        older = changes(batch.device_time_us, before[1]).view(np.int32) < 0
        found: list[int] = np.flatnonzero(newer & older).tolist()
        return found

    def _judge_jump(self, number: int, time_us: int, host_time_ns: int) -> None:
        """Decide what a jump of the device clock was: a step (the numbers count on) or a restart of both."""
        self._held.jumped(host_time_ns)
        period_us = self._numbers.period_us
        if period_us is not None and self._axis.is_open:
            expected = (host_time_ns - self._axis.newest_host_ns) / 1e3 / period_us
            change = (number - (self._next_index - 1 - self._index_shift)) % SEQUENCE_MODULUS
            if abs(change - expected) <= max(CONTINUES_SAMPLES, CONTINUES_WITHIN * expected):
                # The account and the numbers go on; only what the clock would have read at the last sample is new.
                self._numbers.rebase_time(int(time_us - change * period_us))
                self._inform(STEPPED)
                return
        self._start_segment(RESTARTED)

    def _start_segment(self, reason: str) -> None:
        """Let the next sample open a segment of which neither clock nor numbers compare with those before."""
        self._enter_damage()
        self._ledger.new_segment(self._index_shift)
        self._numbers.restart()
        self._newest = None
        self._inform(reason)

    def _inform(self, reason: str) -> None:
        self._axis.close(reason)
        for inform in self.on_segment:
            inform(reason)

    def _place(
        self,
        batch: OrientationBatch,
        times_us: IntArray,
        host_time_ns: int,
        statuses: Sequence[tuple[int, Status]] = (),
    ) -> SampleBlock:
        """Return the new ones of n >= 1 samples of unwrapped device time, numbered, timed and entered in the ledger."""
        if self._ledger.is_new:
            self._enter_damage()  # what came damaged before a segment's first sample is not the new segment's
        expected = self._ledger.expected_start()
        if expected is not None:
            self._numbers.restart(expected)
        numbers = self._numbers.feed(batch.sequence, times_us)
        if not self._axis.is_open:
            self._open_segment(int(times_us[0]), int(numbers[0]), host_time_ns)
        self._newest = int(batch.sequence[-1]), int(batch.device_time_us[-1])
        samples = UnwrappedSamples(self._damage.n_placed, times_us, batch.quats_wxyz, host_time_ns)
        keep = self._ledger.feed(numbers, self._damage.place(len(numbers)), statuses)
        for inform in self.on_samples:
            inform(samples)
        index = numbers + self._index_shift if self._index_shift else numbers
        self._next_index = max(self._next_index, int(index.max()) + 1)
        time_s = self._axis.place(times_us, host_time_ns)
        block = SampleBlock(index, time_s, batch.quats_wxyz, batch.flags, host_time_ns)
        return block if keep.all() else block.chosen(keep)

    def _open_segment(self, time_us: int, number: int, host_time_ns: int) -> None:
        # Where the account went on, so do the numbers, and the shift stays; unless they would meet those given before.
        if self.segments and (self._ledger.is_new or number + self._index_shift < self._next_index):
            self._index_shift = self._next_index - self._ledger.first_number(number)
        self._axis.open(time_us, host_time_ns)
