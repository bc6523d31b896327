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
from host.losses.ledger import MAX_RUNS_KEPT, LossReport
from host.losses.object_counts import NO_ROOM, room_for
from host.losses.runs import MissingRun
from host.stream.blocks import RESET, RESTARTED, STEPPED, SampleBlock, joined
from host.stream.held_samples import HeldSamples, Meeting
from host.stream.places import SamplePlaces

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
        self._places = SamplePlaces(max_runs)
        self.on_samples = self._places.on_samples
        """Called with all samples that are placed, in order."""
        self._clock = ClockUnwrapper()
        self._axis = self._places.axis
        self.segments = self._axis.segments
        """Where each segment starts."""
        self._held = HeldSamples()
        self._damage = self._places.damage

    @property
    def info(self) -> Info | None:
        """The object as it last introduced itself."""
        return self._held.info

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of who sends here."""
        return (CROWDED,) if self._held.crowded else ()

    @property
    def refused(self) -> tuple[str, ...]:
        """What came with a right checksum and cannot be, a sentence each."""
        n_samples, n_statuses = self._places.n_refused, self._places.ledger.refused
        found = (
            (n_samples, f"{n_samples} samples had numbers that cannot be: they count as damaged"),
            (n_statuses, f"{n_statuses} STATUS had counters that cannot be: these are left out"),
        )
        return tuple(sentence for count, sentence in found if count)

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

    def add_gap(self) -> None:
        """Note that the recording these packets are from lacks records here, behind all that were fed so far."""
        self._damage.add_gap()

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
        # One that is not by this clock may be another object's: see _feed_status.
        if not all(self._clock.is_plain(item.status.uptime_us, item.host_time_ns) for item in statuses):
            return None
        newest_us = self._clock.newest_us
        times_us = self._clock.unwrap_many(batch.device_time_us, host_time_ns)
        if times_us is None or newest_us is None:
            return None
        self._damage.n_came += len(batch)
        among, done = [], 0
        for item in statuses:
            if item.position > done:
                newest_us = max(newest_us, int(times_us[done : item.position].max()))
                done = item.position
            among.append((item.position, item.status, self._room(item.status, item.host_time_ns, newest_us)))
            self.status = item.status
        return joined(self._places.place(batch, times_us, host_time_ns, among))

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
        self._places.enter_damage()
        return self._places.ledger.report()

    def missing_runs(self) -> list[MissingRun]:
        """Return the runs of missing samples, numbered as :attr:`SampleBlock.index`, with why each is missing."""
        self._places.enter_damage()
        return self._places.ledger.missing_runs(self._places.index_shift)

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
        self._places.status(status, self._room(status, host_time_ns, self._clock.newest_us), host_time_ns)
        return []

    def _room(self, status: Status, host_time_ns: int, newest_us: int | None) -> int:
        """Return how many samples can have been produced since the newest one, or before the first since a STATUS.

        The object's own clock shows how long that is; by another clock, none can.
        """
        if newest_us is None:
            return self._places.room_at_start(host_time_ns)
        located_us = self._clock.locate(status.uptime_us, host_time_ns)
        return NO_ROOM if located_us is None else room_for(located_us - newest_us)

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
                received_ns = [host_time_ns] * (last - first)
                blocks += [block for block in self._places.place(piece, piece_us, received_ns) if len(block)]
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
        if len(batch) == 1 and self._places.newest is not None:  # most of what comes live
            sequence, time_us = self._places.newest
            on = (int(batch.sequence[0]) - sequence) % SEQUENCE_MODULUS
            back = (time_us - int(batch.device_time_us[0])) % DEVICE_CLOCK_MODULUS_US
            return [0] if 0 < on < SEQUENCE_MODULUS // 2 and 0 < back < DEVICE_CLOCK_MODULUS_US // 2 else []
        before = self._places.newest or (int(batch.sequence[0]), int(batch.device_time_us[0]))
        newer = changes(batch.sequence, before[0]).view(np.int16) > 0
        older = changes(batch.device_time_us, before[1]).view(np.int32) < 0
        found: list[int] = np.flatnonzero(newer & older).tolist()
        return found

    def _judge_jump(self, number: int, time_us: int, host_time_ns: int) -> None:
        """Decide what a jump of the device clock was: a step (the numbers count on) or a restart of both."""
        self._held.jumped(host_time_ns)
        period_us = self._places.numbers.period_us
        if period_us is not None and self._axis.is_open:
            expected = (host_time_ns - self._axis.newest_host_ns) / 1e3 / period_us
            change = (number - self._places.newest_number) % SEQUENCE_MODULUS
            if abs(change - expected) <= max(CONTINUES_SAMPLES, CONTINUES_WITHIN * expected):
                # The account and the numbers go on; only what the clock would have read at the last sample is new.
                self._places.numbers.rebase_time(int(time_us - change * period_us))
                self._inform(STEPPED)
                return
        self._start_segment(RESTARTED)

    def _start_segment(self, reason: str) -> None:
        """Let the next sample open a segment of which neither clock nor numbers compare with those before."""
        self._places.start_segment()
        self._places.newest = None
        self._inform(reason)

    def _inform(self, reason: str) -> None:
        self._axis.close(reason)
        for inform in self.on_segment:
            inform(reason)
