"""Samples put in their places: numbered, timed, entered in the account of losses, each by the samples before it alone.

A sample whose number cannot be is refused, and counts as a damaged frame. Where the numbers go on from such a one, they
have started again: the account of a segment is closed and another opened, while the clock and the time axis go on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from firmware_protocol.packets import SEQUENCE_MODULUS, OrientationBatch, Status
from host.losses.ledger import LossLedger
from host.losses.object_counts import room_for
from host.stream.blocks import SampleBlock, UnwrappedSamples
from host.stream.damage import DamagePlaces
from host.stream.numbers import REFUSED, SequenceUnwrapper
from host.stream.time_axis import TimeAxis

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

START_US = 1e6
"""Before the first sample the time is the host's, and a STATUS may have come so much earlier than it was processed."""


class SamplePlaces:
    """Numbers of samples, their time axis and their account; of missing samples ``max_runs`` runs are kept."""

    def __init__(self, max_runs: int) -> None:
        self.ledger = LossLedger(max_runs)
        self.numbers = SequenceUnwrapper()
        self.axis = TimeAxis()
        self.damage = DamagePlaces()
        self.on_samples: list[Callable[[UnwrappedSamples], object]] = []
        self.newest: tuple[int, int] | None = None
        """Number and device time of the last sample, as on the wire."""
        self.index_shift = 0
        """Index within the capture minus number within the account."""
        self.next_index = 0
        self.n_refused = 0
        """Samples whose number could not be."""
        self._status_ns: int | None = None  # when the last STATUS was received that came alone

    @property
    def newest_number(self) -> int:
        """Number of the newest sample."""
        return self.next_index - 1 - self.index_shift

    def enter_damage(self) -> None:
        """Enter what came behind the last sample into the ledger: damaged frames, and a gap of the file."""
        self.ledger.damaged(self.damage.take_behind())
        self._enter_gap()

    def _enter_gap(self) -> None:
        if self.damage.take_gap():
            self.ledger.file_gap()

    def start_segment(self) -> None:
        """Let the next sample open an account whose numbers cannot be compared with those before."""
        self.enter_damage()
        # Samples that a STATUS knew of behind the last one are missing: the index leaves room for them.
        self.next_index = max(self.next_index, self.ledger.known_end + self.index_shift)
        self.ledger.new_segment(self.index_shift)
        self.numbers.restart()

    def status(self, status: Status, room: int, host_time_ns: int) -> None:
        """Enter the counters of a STATUS that came between samples."""
        self.ledger.status(status, room)
        self._status_ns = host_time_ns

    def room_at_start(self, host_time_ns: int) -> int:
        """Return how many samples can have been produced since the last STATUS, by the host's clock."""
        since_ns = 0 if self._status_ns is None else host_time_ns - self._status_ns
        return room_for(since_ns / 1e3 + START_US)

    def place(
        self,
        batch: OrientationBatch,
        times_us: IntArray,
        host_time_ns: Sequence[int] | IntArray,
        statuses: Sequence[tuple[int, Status, int]] = (),
    ) -> list[SampleBlock]:
        """Return the new ones of n >= 1 samples of unwrapped device time, numbered, timed and entered in the ledger.

        ``host_time_ns`` (n,) is the reception of each. There are as many blocks as parts with numbers of their own.
        """
        blocks, waiting, start = list[SampleBlock](), list(statuses), 0
        while start < len(batch):
            if self.ledger.is_new:
                self._start_numbers(int(batch.sequence[start]), int(host_time_ns[start]))
            sequence, rest_us = (batch.sequence[start:], times_us[start:]) if start else (batch.sequence, times_us)
            numbers = self.numbers.feed(sequence, rest_us)
            stop = start + len(numbers)
            if stop - start == len(batch) and not self.numbers.n_refused:  # as nearly always
                received_ns = int(host_time_ns[-1])
                self._open_with(int(times_us[0]), int(numbers[0]), int(host_time_ns[0]))
                keep = self._enter(batch, numbers, times_us, received_ns, statuses)
                blocks = [self._block(batch, numbers, times_us, keep, received_ns)]
                break
            if stop > start:
                is_last = stop == len(batch)
                here = [each for each in waiting if each[0] < stop or is_last]
                waiting = waiting[len(here) :]
                part = slice(start, stop)
                among = [(max(position - start, 0), status, room) for position, status, room in here]
                blocks.append(self._enter_good(batch.part(part), numbers, times_us[part], host_time_ns[part], among))
            if stop < len(batch):
                self.start_segment()  # the clock goes on
            start = stop
        self.newest = int(batch.sequence[-1]), int(batch.device_time_us[-1])
        return blocks

    def _start_numbers(self, sequence: int, host_time_ns: int) -> None:
        """Let the numbers of an account start where a STATUS before its first sample has it, if that can be."""
        self.enter_damage()  # what came damaged before a segment's first sample is not the new segment's
        expected = self.ledger.expected_start()
        if expected is None:
            return
        if (sequence - expected) % SEQUENCE_MODULUS > self.room_at_start(host_time_ns):
            self.ledger.forget_start()
        else:
            self.numbers.restart(expected)

    def _enter(
        self,
        batch: OrientationBatch,
        numbers: IntArray,
        times_us: IntArray,
        host_time_ns: int,
        statuses: Sequence[tuple[int, Status, int]],
    ) -> BoolArray:
        """Enter samples in the ledger, and return (n,) which are new."""
        samples = UnwrappedSamples(self.damage.n_placed, times_us, batch.quats_wxyz, host_time_ns)
        self._enter_gap()
        keep = self.ledger.feed(numbers, self.damage.place(len(numbers)), statuses)
        for inform in self.on_samples:
            inform(samples)
        self.next_index = max(self.next_index, int(numbers.max()) + self.index_shift + 1)
        return keep

    def _enter_good(
        self,
        batch: OrientationBatch,
        numbers: IntArray,
        times_us: IntArray,
        host_time_ns: Sequence[int] | IntArray,
        statuses: Sequence[tuple[int, Status, int]],
    ) -> SampleBlock:
        """Enter samples of which some are refused, these as damaged frames; return those that are new."""
        good = numbers != REFUSED
        keep, waiting = good.copy(), list(statuses)
        for start, stop in pairwise([0, *(np.flatnonzero(np.diff(good)) + 1).tolist(), len(good)]):
            here = [each for each in waiting if each[0] < stop or (stop == len(good) and each[0] >= stop)]
            waiting = waiting[len(here) :]
            among = [(position - start, status, room) for position, status, room in here]
            part = slice(start, stop)
            if good[start]:
                self._open_with(int(times_us[start]), int(numbers[start]), int(host_time_ns[start]))
                received_ns = int(host_time_ns[stop - 1])
                keep[part] = self._enter(batch.part(part), numbers[part], times_us[part], received_ns, among)
            else:
                self.n_refused += stop - start
                self.damage.refuse(stop - start)
                for _, status, room in among:
                    self.ledger.status(status, room)
        return self._block(batch, numbers, times_us, keep, int(host_time_ns[-1]))

    def _block(
        self, batch: OrientationBatch, numbers: IntArray, times_us: IntArray, keep: BoolArray, host_time_ns: int
    ) -> SampleBlock:
        time_s = self.axis.place(times_us, host_time_ns) if self.axis.is_open else np.zeros(len(numbers))
        index = numbers + self.index_shift if self.index_shift else numbers
        block = SampleBlock(index, time_s, batch.quats_wxyz, batch.flags, host_time_ns)
        return block if keep.all() else block.chosen(keep)

    def _open_with(self, time_us: int, number: int, host_time_ns: int) -> None:
        """Let a segment, or an account within one, open with a sample, where none is open."""
        if not self.axis.is_open:
            self._open_segment(time_us, number, host_time_ns)
        elif self.ledger.is_new:
            self._shift_index(number)

    def _open_segment(self, time_us: int, number: int, host_time_ns: int) -> None:
        # Where the account went on, so do the numbers, and the shift stays: the account knows which samples are new.
        if self.axis.segments and self.ledger.is_new:
            self._shift_index(number)
        self.axis.open(time_us, host_time_ns)

    def _shift_index(self, number: int) -> None:
        """Let the index go on behind all before it with an account that opens with this number."""
        self.index_shift = self.next_index - self.ledger.first_number(number)
